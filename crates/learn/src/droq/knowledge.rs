//! What a learner has learned, without how it went about it: no moments of the optimiser, no draws, no counts.

use super::{CRITICS, Droq, actor_shape, critic_shape, tensors::TEMPERATURE};
use crate::{
    buffer::Buffer,
    env::ObservationLayout,
    network::Network,
    tensors::{Lookup, TensorError, find, find_tensors},
};

/// Temperature of a policy that comes without one, as a share of `initial_temperature`. Trainings settle at about a
/// twentieth (`fast`, C-major scale: 0.1 and 0.005 after 100,000 steps). At the initial one the first updates would undo the
/// policy: its entropy rose from -27 to -3 nats in 4,000 steps. One that is too low corrects itself and breaks nothing.
const SETTLED: f32 = 0.05;

/// Values that another learner of the same form can begin with.
pub(crate) struct Knowledge {
    actor: Buffer,
    policy: Buffer,
    judgement: Option<Judgement>,
}

/// What goes with the critics.
struct Judgement {
    critics: [Buffer; CRITICS],
    targets: [Buffer; CRITICS],
    log_temperature: f32,
}

impl Knowledge {
    /// That of a finished policy: nothing but the actor.
    pub(crate) fn of_policy(parameters: &Buffer) -> Self {
        Self { actor: parameters.clone(), policy: parameters.clone(), judgement: None }
    }

    /// That of a saved learner, whose tensors have the names that [`Droq::tensors`] gives them.
    pub(crate) fn of_learner(
        layout: ObservationLayout,
        action_len: usize,
        hidden: &[usize],
        lookup: &Lookup<'_>,
    ) -> Result<Self, TensorError> {
        let values = |network: &Network, prefix: &str| {
            let mut buffer = network.parameters();
            find_tensors(&network.plan, prefix, lookup, &mut buffer).map(|()| buffer)
        };
        let actor = Network::new(actor_shape(layout, action_len, hidden));
        let critic = Network::new(critic_shape(layout, action_len, hidden));
        let judgement = Judgement {
            critics: [values(&critic, "critic0.parameters")?, values(&critic, "critic1.parameters")?],
            targets: [values(&critic, "critic0.target")?, values(&critic, "critic1.target")?],
            log_temperature: find(lookup, TEMPERATURE.to_owned(), &[3])?[0],
        };
        Ok(Self {
            actor: values(&actor, "actor.parameters")?,
            policy: values(&actor, "actor.policy")?,
            judgement: Some(judgement),
        })
    }

    /// Whether the critics and the temperature come along.
    pub(crate) fn has_critics(&self) -> bool {
        self.judgement.is_some()
    }
}

impl Droq {
    /// Begins with what another learner of the same form knows. Critics that this does not include stay as they are.
    pub(crate) fn adopt(&mut self, knowledge: &Knowledge) {
        self.actor.parameters.copy_from_slice(&knowledge.actor);
        self.policy.copy_from_slice(&knowledge.policy);
        let Some(judgement) = &knowledge.judgement else {
            self.log_temperature.value += SETTLED.ln();
            return;
        };
        let theirs = judgement.critics.iter().zip(&judgement.targets);
        for (ours, (parameters, target)) in self.critics.iter_mut().zip(theirs) {
            ours.learned.parameters.copy_from_slice(parameters);
            ours.target.copy_from_slice(target);
        }
        self.log_temperature.value = judgement.log_temperature;
    }

    /// From now on updates leave the actor and the temperature as they are, apart from the moments of their optimiser; or no
    /// longer do.
    pub(crate) fn hold_actor(&mut self, held: bool) {
        self.actor_held = held;
    }
}
