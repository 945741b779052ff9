//! Speed of environments, learner and whole trainings on this machine. `benches/run.py` compares it
//! with other programs.

mod acting;
mod rate;

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::Context as _;
use etude_learn::{Arithmetic, DroqConfig, bench::update_rate};
use etude_task::TaskConfig;
use etude_task::bench::{all_cores, stepping};
use serde::Serialize;
use serde_json::{Map, Value, json};

use crate::choose_player::sight_reader;
use crate::machine::{machine, peak_memory_mib};
use crate::pianist::{Kind, Pianist};
use acting::control_step_secs;
pub use rate::training_rate;

/// The song that everything is measured on.
const SONG: &str = "c-major-scale";

/// All measurements.
#[derive(Clone, Debug)]
pub struct BenchReport {
    /// This machine in one line.
    pub machine: String,
    /// Time that the environment takes beside its `mj_step` calls, as a share of theirs.
    pub overhead: f64,
    /// The table.
    pub rows: Vec<Measurement>,
    cores: usize,
}

/// A measurement.
#[derive(Clone, Debug, Serialize)]
pub struct Measurement {
    /// What was measured.
    pub what: String,
    /// Its name in JSON, unit included.
    pub key: String,
    /// The unit.
    pub unit: &'static str,
    /// The figure; none if the system does not report it.
    #[serde(skip)]
    pub value: Option<f64>,
}

impl BenchReport {
    /// The figures by name, and the table's rows, as `etude bench --json` prints them.
    pub fn json(&self) -> Value {
        let mut figures: Map<_, _> =
            self.rows.iter().map(|row| (row.key.clone(), json!(row.value))).collect();
        figures.insert("machine".into(), json!(self.machine));
        figures.insert("cores".into(), json!(self.cores));
        figures.insert("env_overhead".into(), json!(self.overhead));
        figures.insert("rows".into(), json!(self.rows));
        figures.into()
    }

    fn row(&mut self, what: impl Into<String>, key: &str, unit: &'static str, value: impl Into<Option<f64>>) {
        self.rows.push(Measurement { what: what.into(), key: key.to_string(), unit, value: value.into() });
    }

    /// The row of a figure in f32 and the row of the same work in bfloat16. A processor without
    /// such arithmetic computes in f32, and the second row says so.
    fn two_rows(
        &mut self,
        what: &str,
        on: &str,
        key: &str,
        unit: &'static str,
        measure: impl Fn(Arithmetic) -> anyhow::Result<f64>,
    ) -> anyhow::Result<()> {
        let note = if etude_learn::bf16_available() { "" } else { " (this processor: f32)" };
        self.row(format!("{what}, {on}"), key, unit, measure(Arithmetic::F32)?);
        let what = format!("the same in bf16{note}, {on}");
        self.row(what, &format!("bf16_{key}"), unit, measure(Arithmetic::Bf16)?);
        Ok(())
    }
}

/// Measures everything, `secs` for each measurement. `program` is `etude`.
///
/// # Errors
/// If a measurement fails.
pub fn measure(program: &Path, secs: f64) -> anyhow::Result<BenchReport> {
    let (task, song) = (TaskConfig::default(), etude_music::resolve(SONG)?);
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let training = |arithmetic, threads| {
        training_rate(song.clone(), arithmetic, threads, &scratch()?.path().join("run"), secs)
    };
    let mut report = BenchReport { machine: machine(), overhead: 0.0, rows: Vec::new(), cores };

    // The peak of this process after its first training. Later ones would add to it.
    training(Arithmetic::F32, cores)?;
    let memory = peak_memory_mib();
    for (threads, key) in [(1, "train_steps_per_sec_1_core"), (cores, "train_steps_per_sec")] {
        let on = counted(threads, "core");
        report.two_rows("training, `paper` preset", &on, key, "steps/s", |arithmetic| {
            training(arithmetic, threads)
        })?;
    }

    let stepping = stepping(&task, &song, secs)?;
    report.overhead = stepping.overhead();
    report.row("environment, 1 core", "env_steps_per_sec", "control steps/s", stepping.steps_per_sec);
    let what = "the bare mj_step calls";
    report.row(what, "bare_steps_per_sec", "control steps/s", stepping.bare_steps_per_sec);
    let what = format!("environments, {}", counted(cores, "core"));
    let rate = all_cores(&task, &song, secs)?;
    report.row(what, "env_steps_per_sec_all_cores", "control steps/s", rate);

    for (threads, key) in [(1, "updates_per_sec"), (2, "updates_per_sec_2_threads")] {
        if threads <= cores {
            let on = counted(threads, "thread");
            report.two_rows("full DroQ update", &on, key, "updates/s", |arithmetic| {
                Ok(update_rate(&DroqConfig { arithmetic, ..Default::default() }, secs, threads)?)
            })?;
        }
    }

    let micros = match sight_reader()? {
        Some(Pianist { kind: Kind::Policy(mut policy, _), config, .. }) => {
            Some(1e6 * control_step_secs(&mut policy, &config.task, &song, secs)?)
        }
        _ => None,
    };
    report.row("sight-reader: one control step, 1 core", "sight_reader_step_micros", "µs", micros);

    report.row("peak memory of a training, begun", "peak_memory_mib", "MiB", memory);
    let start_up = start_up_secs(program)?;
    report.row("start to the first step, training", "start_up_secs", "s", start_up);
    Ok(report)
}

fn scratch() -> anyhow::Result<tempfile::TempDir> {
    tempfile::Builder::new().prefix("etude-bench-").tempdir().with_context(|| {
        let folder = std::env::temp_dir();
        format!("cannot create a folder in {}; set TMPDIR to a folder that can be written", folder.display())
    })
}

fn counted(number: usize, what: &str) -> String {
    format!("{number} {what}{}", if number == 1 { "" } else { "s" })
}

/// Seconds from the start of a process to its end after the first step of a training, files
/// included.
fn start_up_secs(program: &Path) -> anyhow::Result<f64> {
    let scratch = scratch()?;
    let start = Instant::now();
    let output = Command::new(program)
        .args(["train", SONG, "--preset", "paper", "--json", "--set", "trainer.total_steps=1"])
        .args(["--set", "trainer.evaluate_every_steps=0", "--out"])
        .arg(scratch.path().join("run"))
        .output()?;
    let secs = start.elapsed().as_secs_f64();
    let said = String::from_utf8_lossy(&output.stderr);
    anyhow::ensure!(output.status.success(), "`etude train` failed: {}", said.trim());
    Ok(secs)
}
