//! Checkpoints. A kill at any moment leaves a checkpoint that loads.
//!
//! `checkpoints/last.safetensors` is the checkpoint; it names the replay segments that belong to
//! it. A save syncs the metrics, writes the new replay segment under its own name, replaces
//! `last.safetensors` by a rename, and only then removes segments that it does not name. So all
//! files that `last.safetensors` names always exist. See [`crate::Trainer`] for the folder.

use std::{
    fs,
    path::{Path, PathBuf},
};

use safetensors::Dtype;
use serde::{Deserialize, Serialize};

use super::metrics::Mark;
use crate::{
    config::DroqConfig,
    droq::ShardStreams,
    env::{ObservationLayout, Score},
    files::{FileError, RawTensor, TensorFile, encode_tensors, read, sync_folder, write},
    policy::Policy,
    random::Stream,
    replay::{Replay, Segment},
};

pub(crate) const SCHEMA: &str = "etude-checkpoint-4";
pub(super) const LAST_POLICY: &str = "policy-last.safetensors";
const OBSERVATION: &str = "trainer.observation";
const SUMS: &str = "trainer.sums";
const ENVIRONMENT: &str = "environment.state";

/// The best evaluation so far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Best {
    /// Environment step of that evaluation.
    pub step: u64,
    /// Its scores.
    pub scores: Vec<Score>,
}

/// Origin of a training's initial parameters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Origin {
    /// Drawn at random.
    #[default]
    Fresh,
    /// The actor of a policy.
    Policy,
    /// All of a saved training.
    Run,
}

/// The JSON in a checkpoint's metadata: the state of a training except its tensors.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Header {
    pub schema: String,
    pub step: u64,
    pub updates: u64,
    pub layout: ObservationLayout,
    pub action_len: usize,
    pub reward_terms: Vec<String>,
    pub droq: DroqConfig,
    pub seed: u64,
    pub num_envs: usize,
    pub updates_per_vector_step: usize,
    pub warmup_steps: u64,
    pub best: Option<Best>,
    pub last_evaluation: Option<u64>,
    pub metrics: Mark,
    pub segments: Vec<Segment>,
    pub update_streams: Vec<ShardStreams>,
    pub policy_stream: Stream,
    pub warmup_stream: Stream,
    pub origin: Origin,
}

/// The part that the headers of all versions have.
#[derive(Deserialize)]
struct Schema {
    schema: String,
}

/// The tensors that do not belong to the learner.
pub(crate) struct Extras {
    /// `[n, observation]`: the current observations.
    pub observation: Vec<f32>,
    pub sums: Vec<f64>,
    pub environment: Vec<u8>,
}

/// The checkpoint of a run folder.
pub(crate) struct Checkpoints {
    run_folder: PathBuf,
    folder: PathBuf,
    /// The replay segments that belong to the last checkpoint.
    pub segments: Vec<Segment>,
}

impl Checkpoints {
    pub(crate) fn new(run_folder: &Path) -> Self {
        let (run_folder, folder) = (run_folder.to_owned(), run_folder.join("checkpoints"));
        Self { run_folder, folder, segments: Vec::new() }
    }

    pub(crate) fn path(&self) -> PathBuf {
        self.folder.join("last.safetensors")
    }

    fn replay_folder(&self) -> PathBuf {
        self.folder.join("replay")
    }

    pub(crate) fn exists(&self) -> bool {
        self.path().exists()
    }

    /// Creates the folders, and removes the files of a training that was killed before its first
    /// checkpoint.
    pub(crate) fn prepare(&self) -> Result<(), FileError> {
        let folder = self.replay_folder();
        fs::create_dir_all(&folder).map_err(FileError::io("create", &folder))?;
        self.remove_all_but(&[])
    }

    /// Writes the transitions since the last checkpoint. Returns the segments of the next one.
    fn save_replay(&self, replay: &Replay) -> Result<Vec<Segment>, FileError> {
        let mut segments = self.segments.clone();
        let begin = segments.last().map_or(0, |last| last.end).max(replay.oldest());
        segments.retain(|segment| segment.end > replay.oldest());
        if begin < replay.total() {
            let segment = Segment { begin, end: replay.total() };
            write(&self.replay_folder().join(segment.file_name()), &replay.encode(segment))?;
            segments.push(segment);
        }
        Ok(segments)
    }

    /// Replaces the checkpoint, removes segments that it does not name, and saves the policy. The
    /// segments of `header` are set here.
    pub(crate) fn save(
        &mut self,
        mut header: Header,
        learner: Vec<RawTensor>,
        extras: &Extras,
        replay: &Replay,
        policy: &Policy,
    ) -> Result<(), FileError> {
        header.segments = self.save_replay(replay)?;
        let path = self.path();
        let mut tensors = learner;
        let mut add = |name: &str, dtype, len, bytes| {
            tensors.push(RawTensor { name: name.to_owned(), dtype, shape: vec![len], bytes });
        };
        let observation = extras.observation.iter().flat_map(|value| value.to_le_bytes()).collect();
        add(OBSERVATION, Dtype::F32, extras.observation.len(), observation);
        let sums = extras.sums.iter().flat_map(|value| value.to_le_bytes()).collect();
        add(SUMS, Dtype::F64, extras.sums.len(), sums);
        add(ENVIRONMENT, Dtype::U8, extras.environment.len(), extras.environment.clone());
        let bytes = encode_tensors(&header, &tensors).map_err(|reason| FileError::content(&path, reason))?;
        write(&path, &bytes)?;
        self.remove_all_but(&header.segments)?;
        self.segments = header.segments;
        policy.save(&self.run_folder.join(LAST_POLICY))
    }

    /// Removes everything else from the replay folder: older segments, and temporary files of
    /// interrupted writes. What cannot be removed now is tried again at the next checkpoint.
    fn remove_all_but(&self, segments: &[Segment]) -> Result<(), FileError> {
        let folder = self.replay_folder();
        let kept: Vec<String> = segments.iter().map(Segment::file_name).collect();
        for entry in fs::read_dir(&folder).map_err(FileError::io("read", &folder))? {
            let entry = entry.map_err(FileError::io("read", &folder))?;
            let name = entry.file_name().to_string_lossy().into_owned();
            // A temporary file is called `.A-B.replay.` and random letters.
            if name.contains(".replay") && !kept.contains(&name) {
                let _ = fs::remove_file(entry.path());
            }
        }
        sync_folder(&folder)
    }

    /// The checkpoint in `bytes`, if this version can read it.
    pub(crate) fn parse<'a>(&self, bytes: &'a [u8]) -> Result<TensorFile<'a>, FileError> {
        let bad = |reason: String| FileError::content(&self.path(), reason);
        let file = TensorFile::parse(bytes).map_err(bad)?;
        // The schema first: the rest of another version's header may be anything.
        let Schema { schema } = file.header().map_err(bad)?;
        if schema != SCHEMA {
            let reason = format!(
                "its schema is `{schema}`, and this version of Étude reads `{SCHEMA}`; start a new training, or \
                 resume it with the version that wrote it"
            );
            return Err(bad(reason));
        }
        Ok(file)
    }

    /// The parts of the checkpoint in `bytes`.
    pub(crate) fn load<'a>(&self, bytes: &'a [u8]) -> Result<(Header, TensorFile<'a>, Extras), FileError> {
        let path = self.path();
        let file = self.parse(bytes)?;
        let header: Header = file.header().map_err(|reason| FileError::content(&path, reason))?;
        let missing = |name: &str| FileError::content(&path, format!("tensor `{name}` is missing"));
        let (_, observation) = file.floats(OBSERVATION).ok_or_else(|| missing(OBSERVATION))?;
        let (_, sums) = file.bytes(SUMS, Dtype::F64).ok_or_else(|| missing(SUMS))?;
        let sums = sums.as_chunks::<8>().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
        let (_, environment) = file.bytes(ENVIRONMENT, Dtype::U8).ok_or_else(|| missing(ENVIRONMENT))?;
        let extras = Extras { observation, sums, environment: environment.to_vec() };
        Ok((header, file, extras))
    }

    /// Fills an empty replay from the segments.
    pub(crate) fn load_replay(&self, segments: &[Segment], replay: &mut Replay) -> Result<(), FileError> {
        replay.start_at(segments.first().map_or(0, |first| first.begin));
        for &segment in segments {
            let path = self.replay_folder().join(segment.file_name());
            replay.decode(segment, &read(&path)?).map_err(|error| FileError::content(&path, error))?;
        }
        let count: u64 = segments.iter().map(|segment| segment.end - segment.begin).sum();
        if count < replay.len() as u64 {
            let reason = format!("its replay segments hold {count} transitions of {}", replay.len());
            return Err(FileError::content(&self.path(), reason));
        }
        Ok(())
    }
}
