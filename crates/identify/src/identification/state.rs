//! The saved state of an identification.

use std::collections::BTreeMap;
use std::path::Path;

use etude_perform::write_file;
use etude_stage::{DRIVEN_JOINTS, PhysicalParams};
use serde::{Deserialize, Serialize};

use super::error::IdentifyError;
use super::pass::{Pass, PassEnd};
use crate::config::MethodConfig;
use crate::fit::Fit;
use crate::group::Group;
use crate::motion::RecordedMotion;
use crate::parameter_bounds::joint_parameters;

/// How to identify.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IdentifyConfig {
    /// The method of every pass.
    pub method: MethodConfig,
    /// Seed of every random draw.
    pub seed: u64,
    /// Start values that differ from the defaults, by path.
    pub start: BTreeMap<String, f64>,
}

/// What is saved after each batch.
#[derive(Serialize, Deserialize)]
pub(super) struct State {
    pub config: IdentifyConfig,
    /// Path, length and start of each recording, to recognise them.
    motions: Vec<(String, usize, [f64; DRIVEN_JOINTS])>,
    /// Paths of what is estimated, to recognise the state of a build that estimated something else.
    rows: Vec<String>,
    pub params: PhysicalParams,
    pub ended: Vec<PassEnd>,
    /// Whether all passes have ended.
    pub done: bool,
    /// The current pass.
    pub pass: Pass,
    pub fits: Vec<(Group, Fit)>,
    pub replays: u64,
    pub secs: f64,
    pub rms: f64,
    /// Final cost of each group of the last pass.
    pub costs: BTreeMap<String, f64>,
}

impl State {
    /// The state in `file`, or a new one if there is none or the file is of another identification
    /// that has ended.
    pub fn open(
        motions: &[RecordedMotion],
        before: &PhysicalParams,
        config: &IdentifyConfig,
        file: &Path,
    ) -> Result<Self, IdentifyError> {
        let mark = |motion: &RecordedMotion| {
            (motion.path.display().to_string(), motion.commands.steps(), motion.start)
        };
        let rows = (0..DRIVEN_JOINTS).flat_map(|joint| joint_parameters(joint, before));
        let fresh = Self {
            config: config.clone(),
            motions: motions.iter().map(mark).collect(),
            rows: rows.map(|parameter| parameter.path).collect(),
            params: before.clone(),
            ended: Vec::new(),
            done: false,
            pass: Pass::Joints,
            fits: Vec::new(),
            replays: 0,
            secs: 0.0,
            rms: 0.0,
            costs: BTreeMap::new(),
        };
        let fail = |why: String| IdentifyError::State(why);
        let bytes = match std::fs::read(file) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(fresh),
            Err(error) => return Err(fail(format!("cannot read {}: {error}", file.display()))),
        };
        let saved: Self = serde_json::from_slice(&bytes)
            .map_err(|error| fail(format!("{} is damaged: {error}", file.display())))?;
        let is_same =
            saved.config == fresh.config && saved.motions == fresh.motions && saved.rows == fresh.rows;
        if !is_same && !saved.done {
            let what =
                "is of an unfinished identification with other recordings or settings, or of another build";
            return Err(fail(format!("{} {what}", file.display())));
        }
        Ok(if is_same { saved } else { fresh })
    }

    /// Writes the state to `file`.
    pub fn save(&self, file: &Path) -> Result<(), IdentifyError> {
        Ok(write_file(file, &serde_json::to_string(self)?)?)
    }
}
