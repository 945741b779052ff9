//! Speed of environments, learner and whole trainings on this machine, as JSON: `bench SECS`, so
//! many seconds for each measurement. `benches/run.py` compares it with other programs.
#![allow(clippy::print_stdout, reason = "it prints what it measures")]

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use etude_lab::{SIGHT_READER, SongPlanner, Training, load_player, resolve, shipped_policy};
use etude_learn::bench::update_rate;
use etude_learn::{Arithmetic, DroqConfig, StopReason, TrainingObserver};
use etude_music::{KeySet, Song};
use etude_task::bench::{all_cores, stepping};
use etude_task::{ACTION_LEN, Piece, RigState, Stepper, TargetRange, TaskConfig, layout};
use serde_json::{Map, Value, json};

/// The song that everything is measured on.
const SONG: &str = "c-major-scale";
/// Steps with random actions before the first update. The `paper` preset makes 5,000, which would
/// fill a short measurement. Fewer are enough, since a batch is drawn with replacement.
const WARMUP_STEPS: u64 = 256;

fn main() -> anyhow::Result<()> {
    let secs: f64 = std::env::args().nth(1).context("bench SECS")?.parse()?;
    let (task, song) = (TaskConfig::default(), etude_music::resolve(SONG)?);
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut table = Table::default();
    table.figures.insert("machine".into(), machine(cores).into());
    table.figures.insert("cores".into(), cores.into());

    // The peak of this process after its first training. Later ones would add to it.
    training_rate(&song, Arithmetic::F32, cores, secs)?;
    let memory = peak_memory_mib();
    for (threads, key) in [(1, "train_steps_per_sec_1_core"), (cores, "train_steps_per_sec")] {
        table.two_rows(
            "training, `paper` preset",
            &counted(threads, "core"),
            key,
            "steps/s",
            |arithmetic| training_rate(&song, arithmetic, threads, secs),
        )?;
    }

    let stepping = stepping(&task, &song, secs)?;
    table.figures.insert("env_overhead".into(), stepping.overhead().into());
    let unit = "control steps/s";
    table.row("environment, 1 core", "env_steps_per_sec", unit, stepping.steps_per_sec);
    table.row("the bare mj_step calls", "bare_steps_per_sec", unit, stepping.bare_steps_per_sec);
    let what = format!("environments, {}", counted(cores, "core"));
    table.row(&what, "env_steps_per_sec_all_cores", unit, all_cores(&task, &song, secs)?);

    for (threads, key) in [(1, "updates_per_sec"), (2, "updates_per_sec_2_threads")] {
        if threads <= cores {
            table.two_rows(
                "full DroQ update",
                &counted(threads, "thread"),
                key,
                "updates/s",
                |arithmetic| {
                    Ok(update_rate(&DroqConfig { arithmetic, ..Default::default() }, secs, threads)?)
                },
            )?;
        }
    }

    let micros = 1e6 * control_step_secs(&song, secs)?;
    table.row("sight-reader: one control step, 1 core", "sight_reader_step_micros", "µs", micros);
    table.row("peak memory of a training, begun", "peak_memory_mib", "MiB", memory);
    table.figures.insert("rows".into(), table.rows.into());
    println!("{:#}", Value::from(table.figures));
    Ok(())
}

/// The figures by name, and of each what it is and its unit.
#[derive(Default)]
struct Table {
    figures: Map<String, Value>,
    rows: Vec<Value>,
}

impl Table {
    fn row(&mut self, what: &str, key: &str, unit: &str, value: impl Into<Option<f64>>) {
        self.figures.insert(key.to_string(), json!(value.into()));
        self.rows.push(json!({ "what": what, "key": key, "unit": unit }));
    }

    /// The row of a figure in f32 and the row of the same work in bfloat16. A processor without
    /// such arithmetic computes in f32, and the second row says so.
    fn two_rows(
        &mut self,
        what: &str,
        on: &str,
        key: &str,
        unit: &str,
        measure: impl Fn(Arithmetic) -> anyhow::Result<f64>,
    ) -> anyhow::Result<()> {
        let note = if etude_learn::bf16_available() { "" } else { " (this processor: f32)" };
        self.row(&format!("{what}, {on}"), key, unit, measure(Arithmetic::F32)?);
        let what = format!("the same in bf16{note}, {on}");
        self.row(&what, &format!("bf16_{key}"), unit, measure(Arithmetic::Bf16)?);
        Ok(())
    }
}

fn counted(number: usize, what: &str) -> String {
    format!("{number} {what}{}", if number == 1 { "" } else { "s" })
}

/// Environment steps a second of a training of `song` with the `paper` preset, which makes as many
/// updates. Measures for about `secs` once the warm-up is over: environment, acting, updates and
/// replay together, without evaluations.
fn training_rate(song: &Song, arithmetic: Arithmetic, threads: usize, secs: f64) -> anyhow::Result<f64> {
    let scratch = tempfile::Builder::new().prefix("etude-bench-").tempdir()?;
    let mut config = resolve("paper", None, &[])?;
    config.droq.arithmetic = arithmetic;
    config.trainer.warmup_steps = WARMUP_STEPS;
    config.trainer.total_steps = u64::MAX;
    config.trainer.evaluate_every_steps = 0;
    config.trainer.threads = threads;
    // The first steps with updates count as warm-up too.
    let warmup_steps = WARMUP_STEPS + 2;
    let limit = Duration::from_secs_f64(secs);
    let mut timer = StepTimer { warmup_steps, limit, steps: 0, began: Instant::now(), took: Duration::ZERO };
    let folder = scratch.path().join("run");
    Training::start(Some(song.clone()), config, &folder, "bench", None, &mut SongPlanner::default())?
        .run(&mut timer)?;
    Ok((timer.steps - warmup_steps) as f64 / timer.took.as_secs_f64())
}

/// Counts vector steps, and stops the training when the time after the warm-up is over.
struct StepTimer {
    warmup_steps: u64,
    limit: Duration,
    steps: u64,
    began: Instant,
    took: Duration,
}

impl TrainingObserver for StepTimer {
    fn should_stop(&mut self) -> Option<StopReason> {
        // Asked before each vector step, the first included.
        if self.steps <= self.warmup_steps {
            self.began = Instant::now();
        }
        self.took = self.began.elapsed();
        if self.steps > self.warmup_steps && self.took >= self.limit {
            return Some(StopReason::OutOfTime);
        }
        self.steps += 1;
        None
    }
}

/// The most memory that this process has held so far, in MiB, if the system reports it (Linux).
fn peak_memory_mib() -> Option<f64> {
    Some(kib("/proc/self/status", "VmHWM")? / 1024.0)
}

/// This machine in one line: its processor, cores, memory and load, as far as the system reports
/// them.
fn machine(cores: usize) -> String {
    let unknown = || "unknown".to_string();
    let memory =
        kib("/proc/meminfo", "MemTotal").map_or_else(unknown, |kib| format!("{:.0}", kib / 1048576.0));
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    format!(
        "{}, {cores} cores, {memory} GiB, load {} at the start; MuJoCo {}, étude {}",
        proc_field("/proc/cpuinfo", "model name").unwrap_or_else(|| std::env::consts::ARCH.to_string()),
        load.split_whitespace().next().map_or_else(unknown, str::to_string),
        etude_stage::mujoco_version(),
        env!("CARGO_PKG_VERSION")
    )
}

fn kib(path: &str, name: &str) -> Option<f64> {
    proc_field(path, name)?.split_whitespace().next()?.parse().ok()
}

/// The value of the first line `name: value` of a file of the kernel.
fn proc_field(path: &str, name: &str) -> Option<String> {
    let text = std::fs::read_to_string(path).ok()?;
    let mut fields = text.lines().filter_map(|line| line.split_once(':'));
    Some(fields.find(|(key, _)| key.trim() == name)?.1.trim().to_string())
}

/// Mean time in which the shipped sight-reader sees and acts in a control step of `song`, on one
/// core, s: from joint readings and keys to the joint targets. Measured for about `secs`.
fn control_step_secs(song: &Song, secs: f64) -> anyhow::Result<f64> {
    let path = shipped_policy(SIGHT_READER).context("the sight-reader is not in policies")?;
    let player = load_player(Path::new(&path))?;
    let (task, mut policy) = (&player.config.task, player.policy().context("it is a policy")?.clone());
    let piece = Piece::for_task(song, task)?;
    let mut observation = vec![0.0; layout(task).len()];
    let mut action = [0.0; ACTION_LEN];
    let joints = TargetRange::new(&piece).targets(&action, 0);
    let mut state = RigState { joints, set_points: joints, keys: KeySet::EMPTY };
    let mut stepper = Stepper::new(task, &piece, &state)?;
    let (start, mut steps) = (Instant::now(), 0u32);
    while start.elapsed().as_secs_f64() < secs {
        stepper.begin(&state);
        while !stepper.is_over() {
            state.keys = piece.due(stepper.next_step());
            stepper.observe(&state, &mut observation);
            policy.act(&observation, &mut action);
            let joints = stepper.command(&action).targets;
            stepper.advance(&state, &action);
            (state.joints, state.set_points) = (joints, joints);
        }
        steps += piece.steps() as u32;
    }
    Ok(start.elapsed().as_secs_f64() / f64::from(steps))
}
