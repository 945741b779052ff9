//! Fits the simulator to a robot's recordings and writes the results into a folder.

use std::path::{Path, PathBuf};

use anyhow::bail;
use etude_identify::{
    Assessment, BoConfig, GravityCompensation, Identified, IdentifyConfig, LmConfig, MethodConfig, Progress,
    RecordedMotion, Report, ReportInput, describe_keyboard, fit_gravity_compensation, identify,
};
use etude_perform::{Excitation, Job, write_file};
use etude_stage::PhysicalParams;
use serde::de::IntoDeserializer as _;
use serde::{Deserialize, Serialize};

use crate::folder::make_folder;
use crate::json_files::save_pretty;

/// Name of the identified simulator in its folder: a layer for `--config`.
pub const IDENTIFIED: &str = "identified.toml";
/// Name of the results as data.
const RESULT: &str = "identification.json";
/// Name of the report; its figures lie beside it.
const REPORT: &str = "report.md";
/// Name of the state from which an interrupted fit resumes.
const STATE: &str = "state.json";

/// A method by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum IdentifyMethod {
    /// Levenberg–Marquardt.
    Lm,
    /// Bayesian optimisation, the paper's method.
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
                MethodConfig::Bo(BoConfig { max_evaluations: most(BoConfig::default().max_evaluations) })
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
    /// Recordings. Those of the excitation `held-out` are not fitted.
    pub recordings: Vec<PathBuf>,
    /// More recordings that only test the fit.
    pub held_out: Vec<PathBuf>,
    /// The method.
    pub method: IdentifyMethod,
    /// Evaluations of a joint, a finger or the keyboard after which its fit ends; by default the
    /// method's own.
    pub evaluations: Option<u64>,
    /// Owns every random draw.
    pub seed: u64,
    /// Start values that differ from the defaults, by path.
    pub start: std::collections::BTreeMap<String, f64>,
}

/// The results. Its keys are those of `etude identify --json`.
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
    /// Recordings that test the fit.
    pub held_out: Vec<PathBuf>,
    /// Errors in the fitted recordings that touch no key.
    pub fit_errors: Assessment,
    /// Errors in the held-out recordings.
    pub held_out_errors: Assessment,
    /// The parameters and their uncertainty.
    pub identified: Identified,
    /// What the fingers weigh, if the recordings show it.
    pub weight: Option<GravityCompensation>,
    /// The rig's own number for it, `joint_loop.gravity_pwm_per_nm`.
    pub gravity_pwm_per_nm: f64,
    /// What slow presses of keys showed, in words; none without a recording of them.
    pub keyboard: Option<String>,
    /// File of the identified simulator.
    pub file: PathBuf,
}

/// Fits the simulator and writes the results into `folder`. After an interruption the same call
/// resumes the fit.
///
/// # Errors
/// If a recording cannot be used, the fit fails, or a file cannot be written;
/// [`IdentifyError::Interrupted`](etude_identify::IdentifyError) if the job is interrupted.
pub fn identify_robot(
    what: &Identification,
    folder: &Path,
    job: &mut Job<'_, Progress>,
) -> anyhow::Result<IdentifyReport> {
    let paths: Vec<PathBuf> = what.recordings.iter().chain(&what.held_out).cloned().collect();
    let all = RecordedMotion::load_all(&paths)?;
    let is_held_out = |motion: &RecordedMotion| {
        motion.mode == Excitation::HeldOut.name() || what.held_out.contains(&motion.path)
    };
    let (held_out, fitted): (Vec<RecordedMotion>, Vec<RecordedMotion>) =
        all.into_iter().partition(is_held_out);
    let Some(first) = fitted.first() else {
        bail!("all recordings are held out; give some to fit (`etude record --excitation chirp`)");
    };
    make_folder(folder)?;
    if let Some(rig) = rig_of(folder).filter(|rig| *rig != first.rig_label) {
        bail!(
            "{} holds the fit of another rig, `{rig}`; these recordings are of `{}`: choose another folder with -o",
            folder.display(),
            first.rig_label
        );
    }
    let config = IdentifyConfig {
        method: what.method.config(what.evaluations),
        seed: what.seed,
        start: what.start.clone(),
    };
    let identified = identify(&fitted, &config, &folder.join(STATE), job)?;
    let with = |rows| PhysicalParams::default().with(rows);
    let (before, after) = (with(&identified.before)?, with(&identified.physics)?);
    let air: Vec<RecordedMotion> = fitted.iter().filter(|motion| motion.keys.is_empty()).cloned().collect();
    let names = |motions: &[RecordedMotion]| motions.iter().map(|motion| motion.path.clone()).collect();
    let result = IdentifyReport {
        rig: first.rig_label.clone(),
        method: what.method,
        seed: what.seed,
        fitted: names(&fitted),
        held_out: names(&held_out),
        fit_errors: Assessment::new(&air, &before, &after)?,
        held_out_errors: Assessment::new(&held_out, &before, &after)?,
        weight: fit_gravity_compensation(&fitted),
        keyboard: describe_keyboard(&fitted, &identified.measured),
        gravity_pwm_per_nm: first.rig.joint_loop.gravity_pwm_per_nm,
        file: folder.join(IDENTIFIED),
        identified,
    };
    write_file(&result.file, &layer(&result))?;
    save_pretty(&folder.join(RESULT), &result)?;
    let report = Report::new(&ReportInput {
        fitted: &fitted,
        held_out: &held_out,
        config: &config,
        before: &before,
        after: &after,
        identified: &result.identified,
        fit_errors: &result.fit_errors,
        held_out_errors: &result.held_out_errors,
    })?;
    for figure in &report.figures {
        write_file(&folder.join(format!("{}.svg", figure.name)), &figure.svg())?;
    }
    write_file(&folder.join(REPORT), &report.markdown)?;
    Ok(result)
}

/// The rig whose identification is in a folder, if there is one.
fn rig_of(folder: &Path) -> Option<String> {
    let result: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.join(RESULT)).ok()?).ok()?;
    Some(result.get("rig")?.as_str()?.to_string())
}

/// The identified simulator as a layer of a run's configuration.
fn layer(result: &IdentifyReport) -> String {
    let rows = result.identified.physics.iter().map(|(path, value)| format!("\"{path}\" = {value:?}\n"));
    format!(
        "# The simulator as identified from {} recordings of the rig `{}`. Use it with `etude train SONG --config` this file.\n\
         [task.physics]\n{}",
        result.fitted.len(),
        result.rig,
        rows.collect::<String>()
    )
}
