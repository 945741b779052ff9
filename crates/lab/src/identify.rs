//! Fitting the simulator to a robot's recordings, with all results in one folder.

use std::path::{Path, PathBuf};

use anyhow::bail;
use etude_identify::{
    Assessment, BoConfig, CmaConfig, Identified, IdentifyConfig, LmConfig, MethodConfig, Motion, Progress,
    Report, ReportInput, identify,
};
use etude_perform::{Excitation, Job, write_file};
use etude_stage::PhysicalParams;
use serde::{Deserialize, Serialize};

use crate::errors::cannot_create;

/// Name of the identified simulator in its folder: a layer for `--config`.
pub const IDENTIFIED: &str = "identified.toml";
/// Name of the result, for programs.
const RESULT: &str = "identification.json";
/// Names of the report, for readers.
const PAGE: &str = "report.html";
const TEXT: &str = "report.txt";
/// Name of the state from which an interrupted fit is resumed.
const STATE: &str = "state.json";

/// A method by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum IdentifyMethod {
    /// Levenberg–Marquardt.
    Lm,
    /// CMA-ES.
    Cma,
    /// Bayesian optimisation, the paper's.
    Bo,
}

impl IdentifyMethod {
    fn config(self, evaluations: Option<u64>) -> MethodConfig {
        let mut config = self.defaults();
        let most = match &mut config {
            MethodConfig::Lm(config) => &mut config.max_evaluations,
            MethodConfig::Cma(config) => &mut config.max_evaluations,
            MethodConfig::Bo(config) => &mut config.max_evaluations,
        };
        *most = evaluations.unwrap_or(*most);
        config
    }

    /// Its name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lm => "lm",
            Self::Cma => "cma",
            Self::Bo => "bo",
        }
    }

    fn defaults(self) -> MethodConfig {
        match self {
            Self::Lm => MethodConfig::Lm(LmConfig::for_replays()),
            Self::Cma => MethodConfig::Cma(CmaConfig::for_replays()),
            Self::Bo => MethodConfig::Bo(BoConfig::default()),
        }
    }
}

impl std::str::FromStr for IdentifyMethod {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "lm" => Ok(Self::Lm),
            "cma" => Ok(Self::Cma),
            "bo" => Ok(Self::Bo),
            _ => Err(format!("no method is called `{text}`; there are: lm, cma, bo")),
        }
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

/// The result. Its keys are those of `etude identify --json`.
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

/// Fits the simulator and writes the result into `folder`. After an interruption the same call resumes.
///
/// # Errors
/// If a recording cannot be used, the fit fails, or a file cannot be written; [`IdentifyError::Interrupted`](etude_identify::IdentifyError)
/// if the job is interrupted.
pub fn identify_robot(
    what: &Identification,
    folder: &Path,
    job: &mut Job<'_, Progress>,
) -> anyhow::Result<IdentifyReport> {
    let paths: Vec<PathBuf> = what.recordings.iter().chain(&what.held_out).cloned().collect();
    let all = Motion::load_all(&paths)?;
    let is_held_out =
        |motion: &Motion| motion.mode == Excitation::Held.name() || what.held_out.contains(&motion.path);
    let (held_out, fitted): (Vec<Motion>, Vec<Motion>) = all.into_iter().partition(is_held_out);
    let Some(first) = fitted.first() else {
        bail!("all recordings are held out; give some to fit to (`etude record --excitation chirp`)");
    };
    std::fs::create_dir_all(folder).map_err(|error| cannot_create(folder, error))?;
    let config = IdentifyConfig {
        method: what.method.config(what.evaluations),
        seed: what.seed,
        start: what.start.clone(),
    };
    let interrupt = job.interrupt();
    let identified = identify(&fitted, &config, &folder.join(STATE), &mut |at| job.tell(at), interrupt)?;
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
    write_file(&folder.join(RESULT), &(serde_json::to_string_pretty(&report)? + "\n"))?;
    let text = Report::new(&ReportInput {
        fitted: &fitted,
        held_out: &held_out,
        config: &config,
        before: &before,
        after: &after,
        identified: &report.identified,
        fit_errors: &report.fit_errors,
        held_out_errors: &report.held_out_errors,
    })?;
    write_file(&folder.join(PAGE), &text.html())?;
    write_file(&folder.join(TEXT), &text.text())?;
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
