//! The learned parameters of a learner, without optimiser moments, random streams and counts.

use super::{CRITICS, Droq, actor_shape, critic_shape, tensors::TEMPERATURE};
use crate::{
    buffer::Buffer,
    env::ObservationLayout,
    network::Network,
    tensors::{Lookup, find, find_tensors},
};

/// Temperature for a policy without one, as a share of `initial_temperature`. Trainings converge to about a twentieth (`fast`, C-major
/// scale: from 0.1 to 0.005 after 100,000 steps). With the initial temperature the first updates would undo the policy: its entropy
/// rose from -27 to -3 nats in 4,000 steps. A temperature that is too low is corrected by the updates.
const SETTLED: f32 = 0.05;

/// Parameters with which another learner of the same shape can begin.
pub(crate) struct Knowledge {
    actor: Buffer,
    policy: Buffer,
    judgement: Option<Judgement>,
}

/// The critics, their targets and the temperature.
struct Judgement {
    critics: [Buffer; CRITICS],
    targets: [Buffer; CRITICS],
    log_temperature: f32,
}

impl Knowledge {
    /// Of a policy: the actor alone.
    pub(crate) fn of_policy(parameters: &Buffer) -> Self {
        Self { actor: parameters.clone(), policy: parameters.clone(), judgement: None }
    }

    /// Of a saved learner, whose tensors are named as in [`Droq::tensors`].
    pub(crate) fn of_learner(
        layout: ObservationLayout,
        action_len: usize,
        hidden: &[usize],
        lookup: &Lookup<'_>,
    ) -> Result<Self, String> {
        let values = |network: &Network, prefix: &str| {
            let mut buffer = network.parameters();
            find_tensors(&network.plan, prefix, lookup, &mut buffer).map(|()| buffer)
        };
        let actor = Network::new(actor_shape(layout, action_len, hidden));
        let critic = Network::new(critic_shape(layout, action_len, hidden));
        let judgement = Judgement {
            critics: [values(&critic, "critic0.parameters")?, values(&critic, "critic1.parameters")?],
            targets: [values(&critic, "critic0.target")?, values(&critic, "critic1.target")?],
            log_temperature: find(lookup, TEMPERATURE, &[3])?[0],
        };
        Ok(Self {
            actor: values(&actor, "actor.parameters")?,
            policy: values(&actor, "actor.policy")?,
            judgement: Some(judgement),
        })
    }

    /// Whether critics and temperature are included.
    pub(crate) fn has_critics(&self) -> bool {
        self.judgement.is_some()
    }
}

impl Droq {
    /// Takes over the parameters of another learner of the same shape. Without critics, the own ones stay.
    pub(crate) fn adopt(&mut self, knowledge: &Knowledge) {
        self.actor.parameters.copy_from_slice(&knowledge.actor);
        self.policy.copy_from_slice(&knowledge.policy);
        let Some(judgement) = &knowledge.judgement else {
            self.log_temperature[0] += SETTLED.ln();
            return;
        };
        let theirs = judgement.critics.iter().zip(&judgement.targets);
        for (ours, (parameters, target)) in self.critics.iter_mut().zip(theirs) {
            ours.learned.parameters.copy_from_slice(parameters);
            ours.target.copy_from_slice(target);
        }
        self.log_temperature[0] = judgement.log_temperature;
    }

    /// Whether updates from now on do not change the actor and the temperature, except their optimiser moments.
    pub(crate) fn hold_actor(&mut self, held: bool) {
        self.actor_held = held;
    }
}
