//! Jobs: verbs that run in processes of their own, and their log lines.
//!
//! A process stops when its standard input ends ([`ATTENDED`]). So it saves its state and ends also
//! when the server is killed, and a Ctrl-C, which a terminal sends to every process, counts once.

use std::io::{BufRead as _, BufReader, Read as _};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use etude_experiment::ATTENDED;
use etude_perform::{shell_line, write_file};
use hyper::StatusCode;
use serde::Serialize;
use serde_json::{Value, json};

use super::message::ApiError;
use crate::progress::STOPPING;

const MAX_RUNNING: usize = 4;
const MAX_REMEMBERED: usize = 40;
const MAX_LOG_LINES: usize = 12;
const MAX_LINE_CHARS: usize = 600;
/// Exit code of a verb that stopped on request.
const STOPPED: i32 = 3;

/// One verb with its arguments.
#[derive(Clone)]
pub struct Step {
    /// The command line without the program.
    pub args: Vec<String>,
    /// The file for its standard output.
    pub stdout: Option<PathBuf>,
    /// Whether it has nothing to save, so that a stop kills it.
    pub is_quick: bool,
}

/// The verbs of a job, one after the other.
#[derive(Clone)]
pub struct JobSpec {
    pub title: String,
    /// The song's id or path; empty without a song.
    pub song: String,
    /// The folder or file that the job writes.
    pub output: String,
    pub steps: Vec<Step>,
    /// One training runs at a time, on all cores.
    pub is_training: bool,
    /// Minutes after which a training stops.
    pub minutes: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
enum JobState {
    Running,
    Stopping,
    Done,
    Stopped,
    Failed,
}

struct Job {
    id: u64,
    spec: JobSpec,
    start: Instant,
    secs: Option<f64>,
    state: JobState,
    steps_done: usize,
    log: Vec<String>,
    child: Option<Child>,
}

#[derive(Default)]
struct List {
    next: u64,
    jobs: Vec<Job>,
    /// Whether the server is ending and starts no more jobs.
    is_ending: bool,
}

/// All jobs of this server.
pub struct Jobs {
    program: PathBuf,
    list: Arc<Mutex<List>>,
}

impl Jobs {
    pub fn new(program: PathBuf) -> Self {
        Self { program, list: Arc::default() }
    }

    /// Starts a job and gives its number.
    pub fn start(&self, spec: JobSpec) -> Result<u64, ApiError> {
        let busy = |why: &str| Err(ApiError::new(StatusCode::CONFLICT, why));
        let mut list = lock(&self.list);
        if list.is_ending {
            return busy("the server is ending; start `etude serve` again");
        }
        let running = || list.jobs.iter().filter(|job| job.runs());
        if running().count() >= MAX_RUNNING {
            return busy("too many jobs run: wait for one to end, or stop one");
        }
        if spec.is_training && running().any(|job| job.spec.is_training) {
            return busy("a training is running: wait for its end, or stop and save it");
        }
        if running().any(|job| job.spec.output == spec.output && job.spec.title == spec.title) {
            return busy("this job is already running");
        }
        let id = list.next;
        list.next += 1;
        let job = Job {
            id,
            spec: spec.clone(),
            start: Instant::now(),
            secs: None,
            state: JobState::Running,
            steps_done: 0,
            log: Vec::new(),
            child: None,
        };
        list.jobs.push(job);
        while list.jobs.len() > MAX_REMEMBERED
            && let Some(oldest) = list.jobs.iter().position(|job| !job.runs())
        {
            list.jobs.remove(oldest);
        }
        drop(list);
        let (program, list) = (self.program.clone(), self.list.clone());
        let thread = {
            let list = list.clone();
            std::thread::Builder::new().spawn(move || work(id, &spec, &program, &list))
        };
        if let Err(error) = thread {
            log(&list, id, &format!("it cannot be started: {error}"));
            end(&list, id, JobState::Failed);
        }
        Ok(id)
    }

    /// Requests a job to stop.
    pub fn stop(&self, id: &str) -> Result<(), ApiError> {
        let stopped = id.parse().ok().and_then(|id| change(&self.list, id, Job::stop));
        stopped.ok_or_else(|| ApiError::not_found("there is no such job; reload the page"))
    }

    /// Requests all jobs to stop, and starts no other.
    pub fn stop_all(&self) {
        let mut list = lock(&self.list);
        list.is_ending = true;
        list.jobs.iter_mut().for_each(Job::stop);
    }

    /// Whether any has not ended.
    pub fn any_runs(&self) -> bool {
        lock(&self.list).jobs.iter().any(Job::runs)
    }

    /// All jobs, the last one first.
    pub fn status(&self) -> Vec<Value> {
        lock(&self.list).jobs.iter().rev().map(Job::status).collect()
    }
}

impl Job {
    fn runs(&self) -> bool {
        matches!(self.state, JobState::Running | JobState::Stopping)
    }

    fn stop(&mut self) {
        if !self.runs() {
            return;
        }
        self.state = JobState::Stopping;
        self.end_process();
    }

    /// Ends the process that runs, if there is one.
    fn end_process(&mut self) {
        if let Some(child) = &mut self.child {
            drop(child.stdin.take());
            if self.spec.steps.get(self.steps_done).is_some_and(|step| step.is_quick) {
                // It may have ended by itself.
                let _ = child.kill();
            }
        }
    }

    /// What the page shows of it.
    fn status(&self) -> Value {
        let Self { spec, .. } = self;
        let secs = self.secs.unwrap_or_else(|| self.start.elapsed().as_secs_f64());
        let step = &spec.steps[self.steps_done.min(spec.steps.len() - 1)];
        json!({
            "id": self.id, "title": spec.title, "song": spec.song, "output": spec.output,
            "state": self.state, "steps_done": self.steps_done, "secs": secs,
            // Until the time limit.
            "secs_left": spec.minutes.map(|minutes| (60.0 * minutes - secs).max(0.0)),
            // Of the current or last step.
            "command": shell_line(std::iter::once("etude".to_string()).chain(step.args.iter().cloned())),
            "log": self.log,
        })
    }
}

/// The list. Every change is atomic, so a panic of another thread does not matter.
fn lock(list: &Mutex<List>) -> MutexGuard<'_, List> {
    list.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Changes the job `id`.
fn change<T>(list: &Mutex<List>, id: u64, change: impl FnOnce(&mut Job) -> T) -> Option<T> {
    lock(list).jobs.iter_mut().find(|job| job.id == id).map(change)
}

/// Runs the steps one after the other until one fails or stops.
fn work(id: u64, spec: &JobSpec, program: &Path, list: &Arc<Mutex<List>>) {
    let mut state = JobState::Done;
    for step in &spec.steps {
        state = match process(id, step, program, list) {
            Ok(status) if status.success() => JobState::Done,
            Ok(status) if status.code() == Some(STOPPED) => JobState::Stopped,
            // A quick step that was killed.
            Ok(status) if status.code().is_none() && is_stopping(list, id) => JobState::Stopped,
            Ok(status) => {
                // A process that exits with a code has logged why.
                if status.code().is_none() {
                    log(list, id, &format!("it ended with {status}"));
                }
                JobState::Failed
            }
            Err(error) => {
                log(list, id, &error);
                JobState::Failed
            }
        };
        if state != JobState::Done {
            break;
        }
        change(list, id, |job| job.steps_done += 1);
        if is_stopping(list, id) {
            state = JobState::Stopped;
            break;
        }
    }
    end(list, id, state);
}

/// The job is over.
fn end(list: &Mutex<List>, id: u64, state: JobState) {
    change(list, id, |job| {
        (job.state, job.secs, job.child) = (state, Some(job.start.elapsed().as_secs_f64()), None);
    });
}

fn is_stopping(list: &Mutex<List>, id: u64) -> bool {
    change(list, id, |job| job.state == JobState::Stopping).unwrap_or(true)
}

/// Adds a line to the log of a job.
fn log(list: &Mutex<List>, id: u64, line: &str) {
    let line = line.strip_prefix("etude: ").unwrap_or(line).trim_end();
    // The page shows the state and has no Ctrl-C.
    if line == STOPPING {
        return;
    }
    change(list, id, |job| {
        job.log.push(line.chars().take(MAX_LINE_CHARS).collect());
        let surplus = job.log.len().saturating_sub(MAX_LOG_LINES);
        job.log.drain(..surplus);
    });
}

/// Runs the process of one step to its end.
fn process(id: u64, step: &Step, program: &Path, list: &Arc<Mutex<List>>) -> Result<ExitStatus, String> {
    let cannot = |error: std::io::Error| format!("cannot run {}: {error}", program.display());
    let mut child = Command::new(program)
        .args(&step.args)
        .env(ATTENDED, "1")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .process_group(0)
        .spawn()
        .map_err(cannot)?;
    let (printed, errors) = (child.stdout.take(), child.stderr.take());
    change(list, id, |job| {
        job.child = Some(child);
        // The stop may have been requested while the process started.
        if job.state == JobState::Stopping {
            job.end_process();
        }
    });
    let listener = errors.map(|errors| {
        let list = list.clone();
        std::thread::spawn(move || listen(errors, id, &list))
    });
    let mut output = Vec::new();
    if let Some(mut printed) = printed {
        printed.read_to_end(&mut output).map_err(cannot)?;
    }
    if let Some(listener) = listener {
        // The message of a panic is on standard error.
        let _ = listener.join();
    }
    // Both streams have ended, so the process ends now.
    let child = change(list, id, |job| job.child.take()).flatten();
    let status = child.ok_or_else(|| "the process was lost".to_string())?.wait().map_err(cannot)?;
    match &step.stdout {
        Some(path) if status.success() => write_file(path, &output).map_err(|error| error.to_string())?,
        _ => {}
    }
    Ok(status)
}

fn listen(errors: ChildStderr, id: u64, list: &Mutex<List>) {
    for line in BufReader::new(errors).split(b'\n').map_while(Result::ok) {
        let line = String::from_utf8_lossy(&line);
        if !line.trim().is_empty() {
            log(list, id, &line);
        }
    }
}
