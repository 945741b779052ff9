//! Warm start: a training begins with the parameters of another.
//!
//! The actor is taken over and, from a run with a checkpoint, also the policy (the average of the
//! actor), both critics, their targets and the temperature. Replay buffer, optimiser, random
//! streams and counts are new. During the warm-up the policy acts, instead of random actions, and
//! there are no updates, so that the first batches are drawn from more than a few steps. Gradients
//! of new critics would degrade the actor of a policy file; so in that case the critics learn alone
//! for the first `CRITICS_ALONE_UPDATES` updates, and the temperature starts at a value typical
//! late in a training.
//!
//! Scores drop when updates begin, because the replay buffer is small and holds little but the
//! policy's own actions. A longer warm-up, which takes little time, makes the drop smaller. The
//! best policy is kept, and the first evaluation is of the source.

use std::path::{Path, PathBuf};

use super::{
    checkpoint::{Checkpoints, LAST_POLICY, Origin},
    error::TrainError,
};
use crate::{
    config::DroqConfig,
    droq::InitialParameters,
    env::{ObservationLayout, VectorEnvironment},
    files::{FileError, read},
    policy::{Policy, PolicyHeader},
};

/// The parameters of another training, read and checked.
pub struct WarmStart {
    path: PathBuf,
    header: PolicyHeader,
    pub(super) parameters: InitialParameters,
}

impl WarmStart {
    /// The actor of the policy in the file `path`.
    ///
    /// # Errors
    /// If the file cannot be read or is no policy.
    pub fn from_policy(path: &Path) -> Result<Self, FileError> {
        let policy = Policy::load(path)?;
        let parameters = InitialParameters::of_policy(policy.parameters());
        Ok(Self::new(path, &policy, parameters))
    }

    /// Actor, critics, their targets and temperature of the last checkpoint of the training in
    /// `folder`. This is the training's last policy; for the best one use its policy file.
    ///
    /// # Errors
    /// If the folder holds no checkpoint or a damaged one.
    pub fn from_run(folder: &Path) -> Result<Self, FileError> {
        let policy = Policy::load(&folder.join(LAST_POLICY))?;
        let header = policy.header();
        let checkpoints = Checkpoints::new(folder);
        let bytes = read(&checkpoints.path())?;
        let file = checkpoints.parse(&bytes)?;
        let parameters =
            InitialParameters::of_learner(header.layout, header.action_len, &header.hidden, &|name| {
                file.floats(name)
            });
        let parameters = parameters.map_err(|reason| FileError::content(&checkpoints.path(), reason))?;
        Ok(Self::new(folder, &policy, parameters))
    }

    fn new(path: &Path, policy: &Policy, parameters: InitialParameters) -> Self {
        Self { path: path.to_owned(), header: policy.header().clone(), parameters }
    }

    /// The `notes` that the other training was given ([`TrainingInputs`](super::TrainingInputs)).
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
                self.path.display()
            ))),
            None => Ok(()),
        }
    }

    pub(super) fn origin(&self) -> Origin {
        if self.parameters.has_critics() { Origin::Run } else { Origin::Policy }
    }
}
