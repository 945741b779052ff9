//! The measurements of `etude bench`: environments, learner and training, in turns with peers.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use anyhow::Context as _;
use etude_learn::{Arithmetic, DroqConfig, bench::update_rate};
use etude_music::Song;
use etude_task::TaskConfig;
use etude_task::bench::{all_cores, stepping, trace};
use serde_json::{Map, Value, json};

use super::peer::{Peer, median, medians};
use super::rate::training_rate;
use crate::machine::{machine, peak_memory_mib};

/// Turns that each measurement takes, with its peers in between; their medians count.
const TURNS: usize = 3;
/// The song that everything is measured on.
const SONG: &str = "c-major-scale";

/// All measurements.
#[derive(Clone, Debug, Default)]
pub struct BenchReport {
    /// This machine in one line.
    pub machine: String,
    /// Time that the environment takes beside its `mj_step` calls, as a share of theirs.
    pub overhead: f64,
    /// The table.
    pub rows: Vec<Row>,
    /// Scripts of peers that have failed, and why.
    pub failed: Map<String, Value>,
    /// Our figures by name, unit included.
    figures: Map<String, Value>,
}

impl BenchReport {
    /// All figures, ours by name, as `etude bench --json` prints them.
    pub fn json(&self) -> Value {
        let peers = self.rows.iter().flat_map(|row| {
            row.theirs.iter().map(|(peer, theirs)| {
                json!({
                    "what": row.what, "unit": row.unit, "etude": row.ours,
                    "peer": peer, "theirs": theirs, "ratio": row.ratio(*theirs),
                })
            })
        });
        let mut figures = self.figures.clone();
        figures.insert("peers".to_string(), peers.collect());
        figures.insert("peers_failed".to_string(), self.failed.clone().into());
        figures.into()
    }
}

/// A row of the table: our figure and those of peers for the same work.
#[derive(Clone, Debug)]
pub struct Row {
    /// What was measured.
    pub what: String,
    /// The unit of all figures.
    pub unit: &'static str,
    /// Our figure; none if the system does not tell.
    pub ours: Option<f64>,
    /// Names of peers and their figures.
    pub theirs: Vec<(String, f64)>,
}

impl Row {
    /// How many times better we are: seconds and memory are better when they are fewer.
    pub fn ratio(&self, theirs: f64) -> Option<f64> {
        self.ours.map(|ours| if self.unit.ends_with("/s") { ours / theirs } else { theirs / ours })
    }
}

/// Measures everything, `secs` for each measurement. `program` is `etude`. The scripts in the folder `peers` run in turns with it;
/// `tell` is called with each before it starts.
///
/// # Errors
/// If one of our measurements fails. A peer that fails is listed in the report.
pub fn measure(
    program: &Path,
    secs: f64,
    peers: Option<&Path>,
    tell: &mut dyn FnMut(&Path),
) -> anyhow::Result<BenchReport> {
    let scratch = tempfile::Builder::new().prefix("etude-bench-").tempdir().with_context(|| {
        let folder = std::env::temp_dir();
        format!("cannot create a folder in {}; set TMPDIR to a folder that can be written", folder.display())
    })?;
    let mut bench = Bench {
        task: TaskConfig::default(),
        song: etude_music::repertoire::get(SONG).context("the C-major scale is built in")?,
        secs: secs / TURNS as f64,
        cores: std::thread::available_parallelism().map_or(1, usize::from),
        scratch,
        folders: 0,
        program,
        peers,
        tell,
        report: BenchReport { machine: machine(), ..BenchReport::default() },
    };
    bench.figure("machine", bench.report.machine.clone());
    bench.figure("cores", bench.cores);
    bench.measure()?;
    Ok(bench.report)
}

struct Bench<'a> {
    task: TaskConfig,
    song: Song,
    /// Of one turn.
    secs: f64,
    cores: usize,
    scratch: tempfile::TempDir,
    /// Number of folders in it.
    folders: usize,
    program: &'a Path,
    peers: Option<&'a Path>,
    tell: &'a mut dyn FnMut(&Path),
    report: BenchReport,
}

impl Bench<'_> {
    fn measure(&mut self) -> anyhow::Result<()> {
        // The peak of this process after its first training; later ones would add to it.
        training_rate(self.song.clone(), Arithmetic::F32, self.cores, &self.folder(), self.secs)?;
        let memory = peak_memory_mib();
        let mut training = self.training(1, "train_steps_per_sec_1_core")?;
        self.training(self.cores, "train_steps_per_sec")?;
        let environments = self.environments()?;
        self.updates(1, "updates_per_sec")?;
        if self.cores > 1 {
            self.updates(2, "updates_per_sec_2_threads")?;
        }

        let what = "peak memory of a training, begun";
        self.row(what, "peak_memory_mib", "MiB", memory, medians(&training, "peak_memory_mib"));
        let [start_up] = self.turns(&mut [], |bench| Ok([start_up_secs(bench.program, &bench.folder())?]))?;
        training.extend(environments);
        let what = "start to the first step, training";
        self.row(what, "start_up_secs", "s", Some(start_up), medians(&training, "start_up_secs"));
        Ok(())
    }

    /// Environment, acting, updates and replay together.
    fn training(&mut self, threads: usize, key: &str) -> anyhow::Result<Vec<Peer>> {
        let mut peers =
            ["sbx_droq.sh", "sbx_etude.sh", "sbx_robopianist.sh"].map(|script| Peer::new(script, threads));
        let [single, half] = self.turns(&mut peers, |bench| {
            let mut rate = |arithmetic| {
                let folder = bench.folder();
                training_rate(bench.song.clone(), arithmetic, threads, &folder, bench.secs)
            };
            Ok([rate(Arithmetic::F32)?, rate(Arithmetic::Bf16)?])
        })?;
        let on = counted(threads, "core");
        let theirs = medians(&peers, "steps_per_sec");
        self.row(format!("training, `paper` preset, {on}"), key, "steps/s", Some(single), theirs.clone());
        self.bf16_row(&on, key, "steps/s", half, theirs);
        Ok(peers.into())
    }

    /// Environments alone, under random actions. Returns the peers that are environments too.
    fn environments(&mut self) -> anyhow::Result<Vec<Peer>> {
        let [model, traced] = ["model.xml", "trace.txt"].map(|name| self.scratch.path().join(name));
        std::fs::write(&model, etude_stage::mjcf(&self.task.stage, &self.task.params()?))?;
        std::fs::write(&traced, trace(&self.task, &self.song)?)?;
        let rollout = |threads| {
            let mut peer = Peer::new("rollout.sh", threads);
            peer.arguments.extend([&model, &traced].map(|path| path.display().to_string()));
            peer
        };

        let mut peers = vec![rollout(1), Peer::new("robopianist.sh", 1)];
        let [full, bare, overhead] = self.turns(&mut peers, |bench| {
            let stepping = stepping(&bench.task, &bench.song, bench.secs)?;
            Ok([stepping.steps_per_sec, stepping.bare_steps_per_sec, stepping.overhead()])
        })?;
        self.figure("bare_steps_per_sec", bare);
        self.figure("env_overhead", overhead);
        self.report.overhead = overhead;
        let mut theirs = vec![("the bare mj_step calls".to_string(), bare)];
        theirs.extend(medians(&peers, "control_steps_per_sec"));
        self.row("environment, 1 core", "env_steps_per_sec", "control steps/s", Some(full), theirs);

        let mut all = vec![rollout(self.cores)];
        let [rate] = self.turns(&mut all, |bench| Ok([all_cores(&bench.task, &bench.song, bench.secs)?]))?;
        let what = format!("environments, {}", counted(self.cores, "core"));
        let theirs = medians(&all, "control_steps_per_sec");
        self.row(what, "env_steps_per_sec_all_cores", "control steps/s", Some(rate), theirs);
        Ok(peers.split_off(1))
    }

    /// The learner alone.
    fn updates(&mut self, threads: usize, key: &str) -> anyhow::Result<()> {
        let mut peers = ["jax_update.sh", "torch_update.sh"].map(|script| Peer::new(script, threads));
        let configs =
            [Arithmetic::F32, Arithmetic::Bf16].map(|a| DroqConfig { arithmetic: a, ..Default::default() });
        let [single, half] = self.turns(&mut peers, |bench| {
            let [single, half] = &configs;
            Ok([update_rate(single, bench.secs, threads)?, update_rate(half, bench.secs, threads)?])
        })?;
        let on = counted(threads, "thread");
        let theirs = medians(&peers, "updates_per_sec");
        self.row(format!("full DroQ update, {on}"), key, "updates/s", Some(single), theirs.clone());
        self.bf16_row(&on, key, "updates/s", half, theirs);
        Ok(())
    }

    /// The medians of what `ours` measures, while the peers measure the same in between. One that fails is not run again and has
    /// no figures.
    fn turns<const N: usize>(
        &mut self,
        peers: &mut [Peer],
        mut ours: impl FnMut(&mut Self) -> anyhow::Result<[f64; N]>,
    ) -> anyhow::Result<[f64; N]> {
        let mut turns = Vec::new();
        for _ in 0..TURNS {
            turns.push(ours(self)?);
            for peer in peers.iter_mut() {
                if let Some(folder) = self.peers.filter(|_| !self.report.failed.contains_key(peer.script))
                    && let Err(error) = peer.turn(folder, self.secs, self.tell)
                {
                    self.report.failed.insert(peer.script.to_string(), format!("{error:#}").into());
                    peer.lines.clear();
                }
            }
        }
        Ok(std::array::from_fn(|figure| median(turns.iter().map(|turn| turn[figure]).collect())))
    }

    fn figure(&mut self, key: &str, value: impl Into<Value>) {
        self.report.figures.insert(key.to_string(), value.into());
    }

    fn row(
        &mut self,
        what: impl Into<String>,
        key: &str,
        unit: &'static str,
        ours: Option<f64>,
        theirs: Vec<(String, f64)>,
    ) {
        self.figure(key, ours);
        self.report.rows.push(Row { what: what.into(), unit, ours, theirs });
    }

    /// The row after one in f32: the same work of ours in bfloat16, beside the same figures of the peers. A processor without such
    /// arithmetic computes in f32, and the row says so.
    fn bf16_row(&mut self, on: &str, key: &str, unit: &'static str, ours: f64, theirs: Vec<(String, f64)>) {
        let in_f32 = if etude_learn::bf16_available() { "peers" } else { "this processor" };
        let what = format!("the same in bf16 ({in_f32}: f32), {on}");
        self.row(what, &format!("bf16_{key}"), unit, Some(ours), theirs);
    }

    /// The path of a new folder.
    fn folder(&mut self) -> PathBuf {
        self.folders += 1;
        self.scratch.path().join(self.folders.to_string())
    }
}

fn counted(number: usize, what: &str) -> String {
    format!("{number} {what}{}", if number == 1 { "" } else { "s" })
}

/// Seconds from the start of a process to its end after the first step of a training, files and all.
fn start_up_secs(program: &Path, folder: &Path) -> anyhow::Result<f64> {
    let start = Instant::now();
    let output = Command::new(program)
        .args(["train", SONG, "--preset", "paper", "--json", "--set", "trainer.total_steps=1"])
        .args(["--set", "trainer.evaluate_every_steps=0", "--out"])
        .arg(folder)
        .output()?;
    let secs = start.elapsed().as_secs_f64();
    let said = String::from_utf8_lossy(&output.stderr);
    anyhow::ensure!(output.status.success(), "`etude train` failed: {}", said.trim());
    Ok(secs)
}
