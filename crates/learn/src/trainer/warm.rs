//! Beginning a training with what another one has learned: a warm start.
//!
//! Taken over are the actor and, from a run with a checkpoint, its average that is the policy, both critics, their targets
//! and the temperature. Everything else is new: replay, optimiser, draws, counts. The warm-up is acted by the policy instead
//! of at random; there are no updates during it, so that the first batches are drawn from more than a moment. A policy
//! without critics would be led astray by new ones, so then they learn alone first, in [`CRITICS_ALONE_UPDATES`], and the
//! temperature is that of a training that has settled, not of one that begins.
//!
//! Scores dip when updates begin, because the replay is small and shows little but what the policy does; a longer warm-up,
//! which costs little time, makes the dip smaller. The best policy is kept, and the first evaluation is of the source.

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
    policy::Policy,
};

/// Updates in which new critics learn to judge an actor that is not new, before that follows them.
const CRITICS_ALONE_UPDATES: u64 = 2_500;

/// What another training has learned, read and found sound.
pub struct WarmStart {
    origin: PathBuf,
    layout: ObservationLayout,
    action_len: usize,
    hidden: Vec<usize>,
    notes: serde_json::Value,
    knowledge: Knowledge,
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

    /// Actor, critics, their targets and temperature as the last checkpoint of the training in `folder` has them. That is
    /// the training's last policy, not its best; for that one take the file.
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
        let knowledge =
            knowledge.map_err(|error| FileError::content(&store.path(), format!("tensor {error}")))?;
        Ok(Self::new(folder, &policy, knowledge))
    }

    fn new(origin: &Path, policy: &Policy, knowledge: Knowledge) -> Self {
        let header = policy.header();
        Self {
            origin: origin.to_owned(),
            layout: header.layout,
            action_len: header.action_len,
            hidden: header.hidden.clone(),
            notes: header.notes["training"].clone(),
            knowledge,
        }
    }

    /// The `notes` that the other training was given ([`Parts`](super::Parts)).
    pub fn notes(&self) -> &serde_json::Value {
        &self.notes
    }

    /// Whether critics and temperature come along.
    pub fn has_critics(&self) -> bool {
        self.knowledge.has_critics()
    }

    /// Refuses a training whose networks have another form.
    ///
    /// # Errors
    /// [`TrainError::OtherForm`], which says what differs.
    pub fn check(&self, droq: &DroqConfig, environment: &dyn VectorEnvironment) -> Result<(), TrainError> {
        let columns = |layout: ObservationLayout| {
            format!("{} real and {} binary columns of observation", layout.real, layout.binary)
        };
        let values = |len: usize| format!("{len} values of action");
        let layers = |hidden: &[usize]| format!("hidden layers of {hidden:?} units (`droq.hidden`)");
        let (layout, action_len) = (environment.layout(), environment.action_len());
        let pairs = [
            (columns(self.layout), columns(layout)),
            (values(self.action_len), values(action_len)),
            (layers(&self.hidden), layers(&droq.hidden)),
        ];
        match pairs.into_iter().find(|(theirs, ours)| theirs != ours) {
            Some((theirs, ours)) => Err(TrainError::OtherForm { origin: self.origin.clone(), theirs, ours }),
            None => Ok(()),
        }
    }

    pub(super) fn knowledge(&self) -> &Knowledge {
        &self.knowledge
    }

    pub(super) fn beginning(&self) -> Beginning {
        if self.has_critics() { Beginning::Run } else { Beginning::Policy }
    }
}

impl Trainer {
    /// Whether the actor waits for its critics.
    pub(super) fn critics_learn_alone(&self) -> bool {
        self.beginning == Beginning::Policy && self.droq.updates() < CRITICS_ALONE_UPDATES
    }

    /// Whether actions are drawn at random so far.
    pub(super) fn acts_at_random(&self) -> bool {
        self.beginning == Beginning::Fresh && self.step < self.config.warmup_steps
    }
}
