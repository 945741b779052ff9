//! Fitting the simulator to a robot's recordings, in a folder that holds everything that came of it.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use etude_identify::{
    Assessment, BoConfig, Identified, IdentifyConfig, IdentifyError, LmConfig, MethodConfig, Motion,
    MotionError, Progress, Report, ReportInput, identify,
};
use etude_perform::{Excitation, FileError, write_file};
use etude_stage::{ParamError, PhysicalParams, StageError};
use serde::de::IntoDeserializer as _;
use serde::{Deserialize, Serialize};

/// Name of the identified simulator in its folder: a layer for `--config`.
pub const IDENTIFIED: &str = "identified.toml";
/// Name of everything that came of it, for programs.
const RESULT: &str = "identification.json";
/// Names of the report, for readers.
const PAGE: &str = "report.html";
const TEXT: &str = "report.txt";
/// Name of what is needed to go on after an interruption.
const STATE: &str = "state.json";

/// A method by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum IdentifyMethod {
    /// Levenberg–Marquardt.
    Lm,
    /// Bayesian optimisation, the paper's.
    Bo,
}

impl IdentifyMethod {
    fn config(self, evaluations: Option<u64>) -> MethodConfig {
        let most = |default: u64| evaluations.unwrap_or(default);
        match self {
            Self::Lm => {
                let config = LmConfig::for_replays();
                MethodConfig::Lm(LmConfig { max_evaluations: most(config.max_evaluations), ..config })
            }
            Self::Bo => {
                let config = BoConfig::default();
                MethodConfig::Bo(BoConfig { max_evaluations: most(config.max_evaluations), ..config })
            }
        }
    }

    /// Its name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lm => "lm",
            Self::Bo => "bo",
        }
    }
}

impl std::str::FromStr for IdentifyMethod {
    type Err = serde::de::value::Error;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::deserialize(text.into_deserializer())
    }
}

/// What to fit, and how.
#[derive(Clone, Debug)]
pub struct Identification {
    /// Recordings. Those of the excitation `held-out` are not fitted to.
    pub recordings: Vec<PathBuf>,
    /// More recordings to try the fit on.
    pub held_out: Vec<PathBuf>,
    /// The method.
    pub method: IdentifyMethod,
    /// Evaluations of a joint, a finger or the keyboard after which its fit ends; the method's own number if not given.
    pub evaluations: Option<u64>,
    /// Owns every random draw.
    pub seed: u64,
    /// Where to start: rows other than the defaults.
    pub start: std::collections::BTreeMap<String, f64>,
}

/// What came of it. Its keys are those of `etude identify --json`.
#[derive(Clone, Debug, Serialize)]
pub struct IdentifyReport {
    /// The rig.
    pub rig: String,
    /// The method.
    pub method: IdentifyMethod,
    /// The seed.
    pub seed: u64,
    /// Recordings that were fitted.
    pub fitted: Vec<PathBuf>,
    /// Recordings that it was tried on.
    pub held_out: Vec<PathBuf>,
    /// Errors in those of the ones that touch no key.
    pub fit_errors: Assessment,
    /// Errors in the others.
    pub held_out_errors: Assessment,
    /// The numbers and what they are worth.
    pub identified: Identified,
    /// The identified simulator.
    pub file: PathBuf,
}

/// An identification failed.
#[derive(Debug, thiserror::Error)]
pub enum IdentificationError {
    /// A recording cannot be used.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// The fit failed.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    /// The world cannot be built.
    #[error(transparent)]
    Stage(#[from] StageError),
    /// A number is out of range.
    #[error(transparent)]
    Param(#[from] ParamError),
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] FileError),
    /// The folder cannot be made.
    #[error("cannot create {path}: {source}; choose another folder with -o")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Everything is held out.
    #[error("all recordings are held out; give some to fit to (`etude record --excitation chirp`)")]
    AllHeldOut,
}

/// Fits the simulator and writes what came of it into `folder`. After an interruption the same call goes on.
///
/// # Errors
/// If a recording cannot be used, the fit fails or is interrupted, or a file cannot be written.
pub fn identify_robot(
    what: &Identification,
    folder: &Path,
    tell: &mut dyn FnMut(&Progress),
    interrupt: &AtomicBool,
) -> Result<IdentifyReport, IdentificationError> {
    let paths: Vec<PathBuf> = what.recordings.iter().chain(&what.held_out).cloned().collect();
    let all = Motion::load_all(&paths)?;
    let is_held_out =
        |motion: &Motion| motion.mode == Excitation::Held.name() || what.held_out.contains(&motion.path);
    let (held_out, fitted): (Vec<Motion>, Vec<Motion>) = all.into_iter().partition(is_held_out);
    let Some(first) = fitted.first() else { return Err(IdentificationError::AllHeldOut) };
    std::fs::create_dir_all(folder)
        .map_err(|source| IdentificationError::Folder { path: folder.to_path_buf(), source })?;
    let config = IdentifyConfig {
        method: what.method.config(what.evaluations),
        seed: what.seed,
        start: what.start.clone(),
    };
    let identified = identify(&fitted, &config, &folder.join(STATE), tell, interrupt)?;
    let with = |rows| PhysicalParams::default().with(rows);
    let (before, after) = (with(&identified.before)?, with(&identified.physics)?);
    let air: Vec<Motion> = fitted.iter().filter(|motion| motion.keys.is_empty()).cloned().collect();
    let names = |motions: &[Motion]| motions.iter().map(|motion| motion.path.clone()).collect();
    let report = IdentifyReport {
        rig: first.rig.name.clone(),
        method: what.method,
        seed: what.seed,
        fitted: names(&fitted),
        held_out: names(&held_out),
        fit_errors: Assessment::new(&air, &before, &after)?,
        held_out_errors: Assessment::new(&held_out, &before, &after)?,
        file: folder.join(IDENTIFIED),
        identified,
    };
    write_file(&report.file, &layer(&report))?;
    // Plain numbers and strings: writing them as JSON cannot fail.
    let text = serde_json::to_string_pretty(&report).unwrap_or_default();
    write_file(&folder.join(RESULT), &(text + "\n"))?;
    let told = Report::new(&ReportInput {
        fitted: &fitted,
        held_out: &held_out,
        config: &config,
        before: &before,
        after: &after,
        identified: &report.identified,
        fit_errors: &report.fit_errors,
        held_out_errors: &report.held_out_errors,
    })?;
    write_file(&folder.join(PAGE), &told.html())?;
    write_file(&folder.join(TEXT), &told.text())?;
    Ok(report)
}

/// The identified simulator as a layer of a run's configuration.
fn layer(report: &IdentifyReport) -> String {
    use std::fmt::Write as _;
    let mut text = format!(
        "# The simulator as identified from {} recordings of the rig `{}`. Use it with `etude train SONG --config` this file.\n\
         [task.physics]\n",
        report.fitted.len(),
        report.rig
    );
    for (path, value) in &report.identified.physics {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "\"{path}\" = {value:?}");
    }
    text
}
