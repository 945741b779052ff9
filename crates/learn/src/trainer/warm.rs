//! Warm start: beginning a training with the parameters of another.
//!
//! The actor is taken over and, from a run with a checkpoint, also the policy (the average of the actor), both critics, their targets
//! and the temperature. Replay buffer, optimiser, random streams and counts are new. During the warm-up the policy acts, instead of
//! random actions, and there are no updates, so that the first batches are drawn from more than a few steps. New critics would
//! spoil the actor of a policy file; so in that case they learn alone for the first [`CRITICS_ALONE_UPDATES`] updates, and the
//! temperature starts at a value typical late in a training.
//!
//! Scores drop when updates begin, because the replay buffer is small and holds little but the policy's own actions. A longer
//! warm-up, which takes little time, makes the drop smaller. The best policy is kept, and the first evaluation is of the source.

use std::path::{Path, PathBuf};

use super::{
    LAST_POLICY, TrainError, Trainer, VectorEnvironment,
    checkpoint::{Beginning, Store},
};
use crate::{
    config::DroqConfig,
    droq::Knowledge,
    env::ObservationLayout,
    files::{FileError, read},
    policy::{Policy, PolicyHeader},
};

/// Updates in which new critics learn alone before the actor of a policy file is updated.
const CRITICS_ALONE_UPDATES: u64 = 2_500;

/// The parameters of another training, read and checked.
pub struct WarmStart {
    origin: PathBuf,
    header: PolicyHeader,
    pub(super) knowledge: Knowledge,
}

impl WarmStart {
    /// The actor of the policy in the file `path`.
    ///
    /// # Errors
    /// If the file cannot be read or is no policy.
    pub fn from_policy(path: &Path) -> Result<Self, FileError> {
        let policy = Policy::load(path)?;
        let knowledge = Knowledge::of_policy(policy.parameters());
        Ok(Self::new(path, &policy, knowledge))
    }

    /// Actor, critics, their targets and temperature of the last checkpoint of the training in `folder`. This is the training's last
    /// policy; for the best one use its policy file.
    ///
    /// # Errors
    /// If the folder holds no checkpoint or a damaged one.
    pub fn from_run(folder: &Path) -> Result<Self, FileError> {
        let policy = Policy::load(&folder.join(LAST_POLICY))?;
        let header = policy.header();
        let store = Store::new(folder);
        let bytes = read(&store.path())?;
        let file = store.parse(&bytes)?;
        let knowledge = Knowledge::of_learner(header.layout, header.action_len, &header.hidden, &|name| {
            file.floats(name)
        });
        let knowledge = knowledge.map_err(|reason| FileError::content(&store.path(), reason))?;
        Ok(Self::new(folder, &policy, knowledge))
    }

    fn new(origin: &Path, policy: &Policy, knowledge: Knowledge) -> Self {
        Self { origin: origin.to_owned(), header: policy.header().clone(), knowledge }
    }

    /// The `notes` that the other training was given ([`Parts`](super::Parts)).
    pub fn notes(&self) -> &serde_json::Value {
        &self.header.notes["training"]
    }

    /// Checks that a training's networks have the same shape.
    ///
    /// # Errors
    /// If they differ; the message says in what.
    pub fn check(&self, droq: &DroqConfig, environment: &dyn VectorEnvironment) -> Result<(), TrainError> {
        let columns = |layout: ObservationLayout| {
            format!("{} real and {} binary columns of observation", layout.real, layout.binary)
        };
        let values = |len: usize| format!("{len} values of action");
        let layers = |hidden: &[usize]| format!("hidden layers of {hidden:?} units (`droq.hidden`)");
        let (layout, action_len) = (environment.layout(), environment.action_len());
        let pairs = [
            (columns(self.header.layout), columns(layout)),
            (values(self.header.action_len), values(action_len)),
            (layers(&self.header.hidden), layers(&droq.hidden)),
        ];
        match pairs.into_iter().find(|(theirs, ours)| theirs != ours) {
            Some((theirs, ours)) => Err(TrainError::Refused(format!(
                "the networks in {} do not fit this training: they have {theirs}, this training has {ours}; use the same \
                 configuration, or start without them",
                self.origin.display()
            ))),
            None => Ok(()),
        }
    }

    pub(super) fn beginning(&self) -> Beginning {
        if self.knowledge.has_critics() { Beginning::Run } else { Beginning::Policy }
    }
}

impl Trainer {
    /// Whether only the critics learn in this round.
    pub(super) fn critics_learn_alone(&self) -> bool {
        self.beginning == Beginning::Policy && self.droq.updates() < CRITICS_ALONE_UPDATES
    }

    /// Whether the actions of this round are uniformly random.
    pub(super) fn acts_at_random(&self) -> bool {
        self.beginning == Beginning::Fresh && self.step < self.config.warmup_steps
    }
}
