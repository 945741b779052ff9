//! Parameters with which a learner begins instead of random ones: those of a policy or of a saved
//! learner.

use super::{CRITICS, Droq, actor_shape, critic_shape, tensors::TEMPERATURE};
use crate::{
    buffer::Buffer,
    env::ObservationLayout,
    network::Network,
    tensors::{Lookup, find, find_tensors},
};

/// Temperature for a policy without one, as a share of `initial_temperature`. Trainings converge to
/// about a twentieth (`fast`, C-major scale: from 0.1 to 0.005 after 100,000 steps). With the
/// initial temperature the first updates would undo the policy: its entropy rose from -27 to -3
/// nats in 4,000 steps. A temperature that is too low is corrected by the updates.
const SETTLED_TEMPERATURE: f32 = 0.05;

/// Parameters without optimiser moments, random streams and counts.
pub(crate) struct InitialParameters {
    actor: Buffer,
    policy: Buffer,
    /// Of each critic and its target; none of a policy.
    critics: Vec<[Buffer; 2]>,
    log_temperature: Option<f32>,
}

impl InitialParameters {
    /// Of a policy: the actor alone.
    pub(crate) fn of_policy(parameters: &Buffer) -> Self {
        let (actor, policy) = (parameters.clone(), parameters.clone());
        Self { actor, policy, critics: Vec::new(), log_temperature: None }
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
            find_tensors(&network.parameter_layout, prefix, lookup, &mut buffer).map(|()| buffer)
        };
        let actor = Network::new(actor_shape(layout, action_len, hidden));
        let critic = Network::new(critic_shape(layout, action_len, hidden));
        let with_target = |name: String| -> Result<[Buffer; 2], String> {
            Ok([values(&critic, &format!("{name}.parameters"))?, values(&critic, &format!("{name}.target"))?])
        };
        Ok(Self {
            actor: values(&actor, "actor.parameters")?,
            policy: values(&actor, "actor.policy")?,
            critics: (0..CRITICS)
                .map(|index| with_target(format!("critic{index}")))
                .collect::<Result<_, _>>()?,
            log_temperature: Some(find(lookup, TEMPERATURE, &[3])?[0]),
        })
    }

    /// Whether critics and temperature are included.
    pub(crate) fn has_critics(&self) -> bool {
        !self.critics.is_empty()
    }
}

impl Droq {
    /// Sets the parameters of another learner of the same shape. Without critics, the own ones
    /// stay.
    pub(crate) fn load_initial(&mut self, initial: &InitialParameters) {
        self.actor.parameters.copy_from_slice(&initial.actor);
        self.policy.copy_from_slice(&initial.policy);
        for (ours, [parameters, target]) in self.critics.iter_mut().zip(&initial.critics) {
            ours.trainable.parameters.copy_from_slice(parameters);
            ours.target.copy_from_slice(target);
        }
        match initial.log_temperature {
            Some(theirs) => self.log_temperature[0] = theirs,
            None => self.log_temperature[0] += SETTLED_TEMPERATURE.ln(),
        }
    }

    /// Whether updates from now on do not change the actor and the temperature, except their
    /// optimiser moments.
    pub(crate) fn hold_actor(&mut self, held: bool) {
        self.actor_held = held;
    }
}
