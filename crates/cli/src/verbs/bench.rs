//! `etude bench`: the speed of the simulation, of the learner and of both together, against the bare engine and peers.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use anyhow::Context as _;
use etude_lab::bench::{machine, peak_memory_mib, training_rate};
use etude_learn::{Arithmetic, DroqConfig, bench::update_rate};
use etude_music::Song;
use etude_task::TaskConfig;
use etude_task::bench::{all_cores, stepping, trace};
use serde_json::{Map, Value, json};

use super::{line, note};
use crate::Ending;

/// What to measure and for how long.
#[derive(clap::Args)]
#[command(after_help = "\
Prints a table that is Markdown too. A ratio above 1 says how many times faster, or smaller, Étude is. Rates on a shared \
machine swing: compare ratios of one run, in which each measurement takes turns with its peers.

With --peers, each script in benches/peers makes itself a throw-away virtual environment in /tmp, which needs the network \
and some minutes once, and for all of them 15 GB of disk. A peer that does not run becomes a line with the reason.

Examples:
  etude bench
  etude bench --peers > table.md")]
pub struct Args {
    /// Seconds for each measurement
    #[arg(long, default_value_t = 5.0, value_name = "SECS", value_parser = super::positive, allow_hyphen_values = true)]
    secs: f64,
    /// Also run the peers, with the scripts in this folder
    #[arg(long, value_name = "DIR", num_args = 0..=1, default_missing_value = "benches/peers")]
    peers: Option<PathBuf>,
    /// Print JSON: env_steps_per_sec, updates_per_sec, train_steps_per_sec, start_up_secs, peak_memory_mib, peers, …
    #[arg(long)]
    json: bool,
}

/// Turns that each measurement takes, with its peers in between; their medians count.
const TURNS: usize = 3;
/// The song that everything is measured on.
const SONG: &str = "c-major-scale";

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<Ending> {
    let mut bench = Bench {
        task: TaskConfig::default(),
        song: etude_music::repertoire::get(SONG).context("the C-major scale is built in")?,
        secs: args.secs / TURNS as f64,
        cores: std::thread::available_parallelism().map_or(1, usize::from),
        scratch: Scratch::new()?,
        peers: args.peers,
        failed: Map::new(),
        figures: Map::new(),
        rows: Vec::new(),
    };
    bench.figure("machine", machine());
    bench.figure("cores", bench.cores);
    bench.measure()?;
    if args.json {
        bench.print_json()?
    } else {
        bench.print_table()?
    }
    Ok(Ending::Done)
}

/// The measurements and what has come of them so far.
struct Bench {
    task: TaskConfig,
    song: Song,
    /// Of one turn.
    secs: f64,
    cores: usize,
    scratch: Scratch,
    /// Folder of the peers' scripts, if they shall run.
    peers: Option<PathBuf>,
    /// Scripts that have failed, and why.
    failed: Map<String, Value>,
    /// Figures of ours by name, unit included.
    figures: Map<String, Value>,
    rows: Vec<Row>,
}

/// A line of the table: a figure of ours and those of peers for the same work.
struct Row {
    what: String,
    unit: &'static str,
    ours: Option<f64>,
    theirs: Vec<(String, f64)>,
}

impl Row {
    /// How many times better we are: seconds and memory are better when they are fewer.
    fn ratio(&self, theirs: f64) -> Option<f64> {
        self.ours.map(|ours| if self.unit.ends_with("/s") { ours / theirs } else { theirs / ours })
    }
}

/// A peer at one task: a script, what follows the seconds on its command line, and the JSON lines that it has printed.
struct Peer {
    script: &'static str,
    arguments: Vec<String>,
    lines: Vec<Value>,
}

impl Peer {
    fn new(script: &'static str, threads: usize) -> Self {
        Self { script, arguments: vec![threads.to_string()], lines: Vec::new() }
    }

    fn turn(&mut self, folder: &Path, secs: f64) -> anyhow::Result<()> {
        let script = folder.join(self.script);
        let advice = "run this in the repository, or name the folder with --peers DIR";
        anyhow::ensure!(script.is_file(), "{} is not there: {advice}", script.display());
        note(format!("running {} …", script.display()));
        let output = Command::new("sh").arg(&script).arg(secs.to_string()).args(&self.arguments).output()?;
        let said = String::from_utf8_lossy(&output.stderr);
        let reason = said.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("it does not say why");
        anyhow::ensure!(output.status.success(), "{}", reason.trim());
        let text = String::from_utf8_lossy(&output.stdout);
        let before = self.lines.len();
        self.lines.extend(text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok()));
        anyhow::ensure!(self.lines.len() > before, "it has printed no figures");
        Ok(())
    }
}

/// The medians of `field` in the lines of `peers`, one for each name that the lines bear.
fn medians(peers: &[Peer], field: &str) -> Vec<(String, f64)> {
    let mut found: Vec<(String, Vec<f64>)> = Vec::new();
    for line in peers.iter().flat_map(|peer| &peer.lines) {
        let (Some(name), Some(value)) = (line["peer"].as_str(), line[field].as_f64()) else { continue };
        match found.iter_mut().find(|(known, _)| known == name) {
            Some((_, values)) => values.push(value),
            None => found.push((name.to_string(), vec![value])),
        }
    }
    found.into_iter().map(|(name, values)| (name, median(values))).collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

impl Bench {
    fn measure(&mut self) -> anyhow::Result<()> {
        // The peak of this process after its first training: what later ones leave behind is not one training's.
        training_rate(self.song.clone(), Arithmetic::F32, self.cores, &self.scratch.folder(), self.secs)?;
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
        let [start_up] = self.turns(&mut [], |bench| Ok([start_up_secs(&bench.scratch.folder())?]))?;
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
                let folder = bench.scratch.folder();
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
        let [model, traced] = ["model.xml", "trace.txt"].map(|name| self.scratch.path.join(name));
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
                if let Some(folder) = self.peers.as_ref().filter(|_| !self.failed.contains_key(peer.script))
                    && let Err(error) = peer.turn(folder, self.secs)
                {
                    self.failed.insert(peer.script.to_string(), format!("{error:#}").into());
                    peer.lines.clear();
                }
            }
        }
        Ok(std::array::from_fn(|figure| median(turns.iter().map(|turn| turn[figure]).collect())))
    }

    fn figure(&mut self, key: &str, value: impl Into<Value>) {
        self.figures.insert(key.to_string(), value.into());
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
        self.rows.push(Row { what: what.into(), unit, ours, theirs });
    }

    /// The row after one in f32: the same work of ours in bfloat16, beside the same figures of the peers. A processor without such
    /// arithmetic computes in f32, and the row says so.
    fn bf16_row(&mut self, on: &str, key: &str, unit: &'static str, ours: f64, theirs: Vec<(String, f64)>) {
        let in_f32 = if etude_learn::bf16_available() { "peers" } else { "this processor" };
        let what = format!("the same in bf16 ({in_f32}: f32), {on}");
        self.row(what, &format!("bf16_{key}"), unit, Some(ours), theirs);
    }

    fn print_json(mut self) -> anyhow::Result<()> {
        let peers = self.rows.iter().flat_map(|row| {
            row.theirs.iter().map(|(peer, theirs)| {
                json!({
                    "what": row.what, "unit": row.unit, "etude": row.ours,
                    "peer": peer, "theirs": theirs, "ratio": row.ratio(*theirs),
                })
            })
        });
        let peers: Vec<Value> = peers.collect();
        self.figure("peers", peers);
        self.figures.insert("peers_failed".to_string(), self.failed.into());
        super::json(&self.figures)
    }

    fn print_table(&self) -> anyhow::Result<()> {
        line(format!("Machine: {}\n", self.figures["machine"].as_str().unwrap_or_default()))?;
        let mut table = vec![["what", "Étude", "peer", "peer's", "ratio"].map(String::from)];
        for row in &self.rows {
            let ours = row.ours.map_or("unknown".to_string(), |ours| format!("{} {}", short(ours), row.unit));
            let mut cells = [row.what.clone(), ours, String::new(), String::new(), String::new()];
            for (peer, theirs) in &row.theirs {
                cells[2..].clone_from_slice(&[
                    peer.clone(),
                    short(*theirs),
                    row.ratio(*theirs).map_or("unknown".to_string(), |ratio| format!("{ratio:.2}")),
                ]);
                table.push(std::mem::take(&mut cells));
            }
            if row.theirs.is_empty() {
                table.push(cells);
            }
        }
        let widths: [usize; 5] = std::array::from_fn(|column| {
            table.iter().map(|cells| cells[column].chars().count()).max().unwrap_or_default()
        });
        for (index, cells) in table.iter().enumerate() {
            let [what, ours, peer, theirs, ratio] = cells;
            let [a, b, c, d, e] = widths;
            line(format!("| {what:a$} | {ours:>b$} | {peer:c$} | {theirs:>d$} | {ratio:>e$} |"))?;
            if index == 0 {
                let [a, b, c, d, e] = widths.map(|width| "-".repeat(width));
                line(format!("| {a} | {b} | {c} | {d} | {e} |"))?;
            }
        }
        line(format!(
            "\nThe environment takes {:.1} % more time than its mj_step calls.",
            self.figures["env_overhead"].as_f64().unwrap_or(f64::NAN) * 100.0
        ))?;
        if self.peers.is_some() {
            line(
                "Peers are kept to the first N processors, since not all of them count threads; Étude has N threads.",
            )?;
        }
        for (script, reason) in &self.failed {
            line(format!("{script} did not run: {}", reason.as_str().unwrap_or_default()))?;
        }
        if self.peers.is_none() {
            line("(add --peers to run JAX, PyTorch, mujoco.rollout, RoboPianist and SBX in turns with it)")?;
        }
        Ok(())
    }
}

/// A number with three figures or a few more.
fn short(value: f64) -> String {
    let digits = if value >= 100.0 {
        0
    } else if value >= 10.0 {
        1
    } else {
        2
    };
    format!("{value:.digits$}")
}

fn counted(number: usize, what: &str) -> String {
    format!("{number} {what}{}", if number == 1 { "" } else { "s" })
}

/// Seconds from the start of a process to its end after the first step of a training, files and all.
fn start_up_secs(folder: &Path) -> anyhow::Result<f64> {
    let start = Instant::now();
    let output = Command::new(std::env::current_exe()?)
        .args(["train", SONG, "--preset", "paper", "--json", "--set", "trainer.total_steps=1"])
        .args(["--set", "trainer.evaluate_every_steps=0", "--out"])
        .arg(folder)
        .output()?;
    let secs = start.elapsed().as_secs_f64();
    let said = String::from_utf8_lossy(&output.stderr);
    anyhow::ensure!(output.status.success(), "`etude train` failed: {}", said.trim());
    Ok(secs)
}

/// A folder for the time of the measurements.
struct Scratch {
    path: PathBuf,
    folders: usize,
}

impl Scratch {
    fn new() -> anyhow::Result<Self> {
        let path = std::env::temp_dir().join(format!("etude-bench-{}", std::process::id()));
        std::fs::create_dir_all(&path).with_context(|| {
            format!("cannot create {}; set TMPDIR to a folder that can be written", path.display())
        })?;
        Ok(Self { path, folders: 0 })
    }

    /// The path of a folder in it that nobody has had before.
    fn folder(&mut self) -> PathBuf {
        self.folders += 1;
        self.path.join(self.folders.to_string())
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // What cannot be removed stays in the temporary folder: no harm.
        let _ = std::fs::remove_dir_all(&self.path);
    }
}
