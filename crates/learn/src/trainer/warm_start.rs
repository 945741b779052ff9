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
    droq::Droq,
    env::{ObservationLayout, VectorEnvironment},
    files::{FileError, read},
    policy::Policy,
};

/// The parameters of another training, read and checked.
pub struct WarmStart {
    path: PathBuf,
    policy: Policy,
    /// The checkpoint of a run; none of a policy file.
    checkpoint: Option<Vec<u8>>,
}

impl WarmStart {
    /// The actor of the policy in the file `path`.
    ///
    /// # Errors
    /// If the file cannot be read or is no policy.
    pub fn from_policy(path: &Path) -> Result<Self, FileError> {
        Ok(Self { path: path.to_owned(), policy: Policy::load(path)?, checkpoint: None })
    }

    /// Actor, critics, their targets and temperature of the last checkpoint of the training in
    /// `folder`. This is the training's last policy; for the best one use its policy file.
    ///
    /// # Errors
    /// If the folder holds no checkpoint or a damaged one.
    pub fn from_run(folder: &Path) -> Result<Self, FileError> {
        let policy = Policy::load(&folder.join(LAST_POLICY))?;
        let checkpoints = Checkpoints::new(folder);
        let bytes = read(&checkpoints.path())?;
        checkpoints.parse(&bytes)?;
        Ok(Self { path: folder.to_owned(), policy, checkpoint: Some(bytes) })
    }

    /// The `notes` that the other training was given ([`TrainingInputs`](super::TrainingInputs)).
    pub fn notes(&self) -> &serde_json::Value {
        &self.policy.header().notes["training"]
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
        let theirs = self.policy.header();
        let pairs = [
            (columns(theirs.layout), columns(layout)),
            (values(theirs.action_len), values(action_len)),
            (layers(&theirs.hidden), layers(&droq.hidden)),
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

    /// Sets the parameters of a learner of the same shape.
    pub(super) fn load(&self, learner: &mut Droq) -> Result<(), FileError> {
        let Some(bytes) = &self.checkpoint else {
            learner.load_policy(self.policy.parameters());
            return Ok(());
        };
        let checkpoints = Checkpoints::new(&self.path);
        let file = checkpoints.parse(bytes)?;
        let learned = learner.load_learned(&|name| file.floats(name));
        learned.map_err(|reason| FileError::content(&checkpoints.path(), reason))
    }

    pub(super) fn origin(&self) -> Origin {
        if self.checkpoint.is_some() { Origin::Run } else { Origin::Policy }
    }
}
