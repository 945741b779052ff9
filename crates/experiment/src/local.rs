//! The local launcher: one process a trial, so that one that crashes does not affect the others.
//!
//! A trial's process stops when its standard input ends. So it saves its state and ends also when
//! the launcher is killed, and a Ctrl-C, which a terminal sends to every process, is one request.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fs::OpenOptions;
use std::io::{BufRead as _, BufReader};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use etude_perform::Job;

use crate::outcome::{RESULT, TrialProgress, file_error};
use crate::trial::Trial;

/// Time between two checks of the workers, at most.
const POLL_INTERVAL: Duration = Duration::from_millis(100);
/// Name of the file with the messages of a trial's process.
pub const LOG: &str = "log.txt";
/// Environment variable of a launched process: it stops when its standard input ends.
pub const ATTENDED: &str = "ETUDE_ATTENDED";
/// Exit code of a process that stopped on request.
const STOPPED: i32 = 3;
/// Exit code of a process that found another one at work.
pub const BUSY: u8 = 4;

/// How trials are launched here.
#[derive(Clone, Debug)]
pub struct LocalConfig {
    /// The `etude` program.
    pub program: PathBuf,
    /// How many trials run at once.
    pub workers: usize,
    /// Threads of each.
    pub threads: usize,
}

/// How far a launch has got.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Launch {
    /// Trials of the plan.
    pub total: usize,
    /// Trials that are done, including those of earlier launches.
    pub done: usize,
    /// Trials that another process is at work on.
    pub busy: usize,
    /// Trials that failed, and the last line that each wrote.
    pub failed: Vec<(String, String)>,
    /// Running trials, by id.
    pub running: BTreeMap<String, TrialProgress>,
    /// Whether it was stopped on request.
    pub stopped: bool,
}

impl Launch {
    /// The share of all trials that is done, 0 to 1.
    pub fn share(&self) -> f64 {
        let running: f64 = self.running.values().map(|trial| trial.share).sum();
        ((self.done + self.failed.len()) as f64 + running) / self.total.max(1) as f64
    }
}

struct Worker {
    id: String,
    child: Child,
    /// Length of its log before it began.
    logged: u64,
}

/// A line of a worker's standard output: the id of the trial, and its progress.
type ProgressLine = (String, TrialProgress);

/// Does all trials of the plan in the file `plan` that are not done yet. Reports what changes.
///
/// # Errors
/// If a process cannot be started. A trial that fails is listed in the report, and the others
/// continue.
pub fn launch_local(
    trials: &[Trial],
    plan: &Path,
    runs: &Path,
    config: &LocalConfig,
    job: &mut Job<'_, Launch>,
) -> anyhow::Result<Launch> {
    // Different variants may have the same trial.
    let mut seen = BTreeSet::new();
    let (done, mut waiting): (VecDeque<_>, VecDeque<_>) = trials
        .iter()
        .enumerate()
        .filter(|(_, trial)| seen.insert(trial.id.as_str()))
        .partition(|(_, trial)| runs.join(&trial.id).join(RESULT).is_file());
    let mut launch = Launch { done: done.len(), total: seen.len(), ..Launch::default() };
    let mut workers: Vec<Worker> = Vec::new();
    let (sender, lines): (Sender<ProgressLine>, Receiver<ProgressLine>) = channel();
    job.report(&launch);
    loop {
        let stop = job.is_interrupted();
        if stop {
            launch.stopped = true;
            waiting.clear();
            workers.iter_mut().for_each(|worker| drop(worker.child.stdin.take()));
        }
        while workers.len() < config.workers
            && let Some((index, trial)) = waiting.pop_front()
        {
            workers.push(start(index, trial, plan, runs, config, &sender)?);
        }
        if workers.is_empty() {
            break;
        }
        let first = lines.recv_timeout(POLL_INTERVAL).ok();
        for (id, at) in first.into_iter().chain(lines.try_iter()) {
            // A process that has ended may still have lines in the channel.
            if workers.iter().any(|worker| worker.id == id) {
                launch.running.insert(id, at);
            }
        }
        let mut going = Vec::new();
        for mut worker in workers {
            let ended = worker.child.try_wait().map_err(|error| file_error(&config.program, &error))?;
            let Some(status) = ended else {
                going.push(worker);
                continue;
            };
            launch.running.remove(&worker.id);
            match status.code() {
                Some(0) => launch.done += 1,
                Some(STOPPED) if stop => {}
                Some(code) if code == i32::from(BUSY) => launch.busy += 1,
                _ => {
                    let message = last_line(&runs.join(&worker.id).join(LOG), worker.logged);
                    launch.failed.push((
                        worker.id,
                        format!("{status}{}", message.map_or_else(String::new, |line| format!(": {line}"))),
                    ));
                }
            }
        }
        workers = going;
        job.report(&launch);
    }
    Ok(launch)
}

fn start(
    index: usize,
    trial: &Trial,
    plan: &Path,
    runs: &Path,
    config: &LocalConfig,
    sender: &Sender<ProgressLine>,
) -> anyhow::Result<Worker> {
    let folder = runs.join(&trial.id);
    std::fs::create_dir_all(&folder).map_err(|error| file_error(&folder, &error))?;
    let log = folder.join(LOG);
    let log_file =
        OpenOptions::new().create(true).append(true).open(&log).map_err(|error| file_error(&log, &error))?;
    let logged = log_file.metadata().map_or(0, |data| data.len());
    let mut child = Command::new(&config.program)
        .args(["experiment", "trial"])
        .arg(plan)
        .arg(index.to_string())
        .arg("--runs-dir")
        .arg(runs)
        .args(["--threads", &config.threads.to_string()])
        .env(ATTENDED, "1")
        // For fits, which otherwise use all cores.
        .env("RAYON_NUM_THREADS", config.threads.to_string())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(log_file)
        .process_group(0)
        .spawn()
        .map_err(|error| file_error(&config.program, &error))?;
    if let Some(output) = child.stdout.take() {
        let (id, sender) = (trial.id.clone(), sender.clone());
        std::thread::spawn(move || {
            for line in BufReader::new(output).lines().map_while(Result::ok) {
                if let Ok(at) = serde_json::from_str(&line)
                    && sender.send((id.clone(), at)).is_err()
                {
                    break;
                }
            }
        });
    }
    Ok(Worker { id: trial.id.clone(), child, logged })
}

/// The last line of a text file that is not empty, from this byte on.
fn last_line(path: &Path, from: u64) -> Option<String> {
    let bytes = std::fs::read(path).ok()?;
    let text = String::from_utf8_lossy(bytes.get(usize::try_from(from).ok()?..)?).into_owned();
    text.lines().rev().find(|line| !line.trim().is_empty()).map(str::to_string)
}
