//! Jobs: verbs that run in processes of their own, and what each of them says.
//!
//! A process stops when its standard input ends ([`ATTENDED`]). So it saves its state and ends also when the server is killed, and a
//! Ctrl-C, which a terminal sends to every process, is one request and not two.

use std::io::{BufRead as _, BufReader, Read as _};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use etude_perform::{shell_line, write_file};
use hyper::StatusCode;
use serde::Serialize;

use super::http::Refusal;
use crate::progress::{ATTENDED, STOPPING};

/// Largest number of jobs that run at once.
const MOST_RUNNING: usize = 4;
/// Largest number of jobs that are remembered.
const MOST: usize = 40;
/// Lines of what a job said that are kept, and the longest of them.
const LINES: usize = 12;
const LONGEST_LINE: usize = 600;
/// Exit code of a verb that stopped on request.
const STOPPED: i32 = 3;

/// One verb with its arguments.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// The command line without the program.
    pub args: Vec<String>,
    /// Where its standard output is kept.
    pub keep: Option<PathBuf>,
    /// Whether it has nothing to save when it is stopped.
    pub is_quick: bool,
}

/// What is to be done, verb by verb.
#[derive(Clone, Debug, PartialEq)]
pub struct Order {
    /// What it is called on the page.
    pub title: String,
    /// The song, as it is typed; empty if it is about no song.
    pub song: String,
    /// The folder or file that it makes.
    pub makes: String,
    pub steps: Vec<Step>,
    /// Whether it is a training; one runs at a time, on all cores.
    pub is_training: bool,
    /// Minutes after which a training stops.
    pub minutes: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
enum State {
    Running,
    Stopping,
    Done,
    Stopped,
    Failed,
}

struct Job {
    id: u64,
    order: Order,
    begun: Instant,
    secs: Option<f64>,
    state: State,
    /// Steps that are done.
    done: usize,
    said: Vec<String>,
    child: Option<Child>,
}

/// A job as the page sees it.
#[derive(Serialize)]
pub struct Seen {
    id: u64,
    title: String,
    song: String,
    makes: String,
    state: State,
    /// Steps that are done.
    done: usize,
    secs: f64,
    /// Until it stops at the latest.
    secs_left: Option<f64>,
    /// The command line of the step that runs or was the last.
    command: String,
    said: Vec<String>,
}

#[derive(Default)]
struct List {
    next: u64,
    jobs: Vec<Job>,
    /// Whether the server ends, so that nothing is started any more.
    ends: bool,
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
    pub fn start(&self, order: Order) -> Result<u64, Refusal> {
        let busy = |why: &str| Err(Refusal::new(StatusCode::CONFLICT, why));
        let mut list = lock(&self.list);
        if list.ends {
            return busy("the server is ending; start `etude serve` again");
        }
        let running = || list.jobs.iter().filter(|job| job.runs());
        if running().count() >= MOST_RUNNING {
            return busy("too much runs at once: wait for something to end, or stop it");
        }
        if order.is_training && running().any(|job| job.order.is_training) {
            return busy("a training runs already: wait for its end, or stop it, which saves it");
        }
        if running().any(|job| job.order.makes == order.makes && job.order.title == order.title) {
            return busy("this runs already");
        }
        let id = list.next;
        list.next += 1;
        let job = Job {
            id,
            order: order.clone(),
            begun: Instant::now(),
            secs: None,
            state: State::Running,
            done: 0,
            said: Vec::new(),
            child: None,
        };
        list.jobs.push(job);
        while list.jobs.len() > MOST
            && let Some(oldest) = list.jobs.iter().position(|job| !job.runs())
        {
            list.jobs.remove(oldest);
        }
        drop(list);
        let (program, list) = (self.program.clone(), self.list.clone());
        let thread = {
            let list = list.clone();
            std::thread::Builder::new().spawn(move || work(id, &order, &program, &list))
        };
        if let Err(error) = thread {
            say(&list, id, &format!("it cannot be started: {error}"));
            end(&list, id, State::Failed);
        }
        Ok(id)
    }

    /// Asks a job to stop.
    pub fn stop(&self, id: u64) -> Result<(), Refusal> {
        let mut list = lock(&self.list);
        let job = list.jobs.iter_mut().find(|job| job.id == id);
        job.ok_or_else(|| Refusal::missing("there is no such job; reload the page"))?.stop();
        Ok(())
    }

    /// Asks all of them to stop, and starts no other.
    pub fn stop_all(&self) {
        let mut list = lock(&self.list);
        list.ends = true;
        list.jobs.iter_mut().for_each(Job::stop);
    }

    /// Whether any has not ended.
    pub fn any_runs(&self) -> bool {
        lock(&self.list).jobs.iter().any(Job::runs)
    }

    /// All of them, the last one first.
    pub fn seen(&self) -> Vec<Seen> {
        lock(&self.list).jobs.iter().rev().map(Job::seen).collect()
    }
}

impl Job {
    fn runs(&self) -> bool {
        matches!(self.state, State::Running | State::Stopping)
    }

    fn stop(&mut self) {
        if !self.runs() {
            return;
        }
        self.state = State::Stopping;
        self.end_process();
    }

    /// Ends the process that runs, if there is one.
    fn end_process(&mut self) {
        if let Some(child) = &mut self.child {
            drop(child.stdin.take());
            if self.order.steps.get(self.done).is_some_and(|step| step.is_quick) {
                // It may have ended by itself.
                let _ = child.kill();
            }
        }
    }

    fn seen(&self) -> Seen {
        let secs = self.secs.unwrap_or_else(|| self.begun.elapsed().as_secs_f64());
        let step = &self.order.steps[self.done.min(self.order.steps.len() - 1)];
        Seen {
            id: self.id,
            title: self.order.title.clone(),
            song: self.order.song.clone(),
            makes: self.order.makes.clone(),
            state: self.state,
            done: self.done,
            secs,
            secs_left: self.order.minutes.map(|minutes| (60.0 * minutes - secs).max(0.0)),
            command: shell_line(std::iter::once("etude".to_string()).chain(step.args.iter().cloned())),
            said: self.said.clone(),
        }
    }
}

/// The list; no change to it can be half done, so a panic of another thread does not matter.
fn lock(list: &Mutex<List>) -> MutexGuard<'_, List> {
    list.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Changes the job `id`, which is in the list while it runs.
fn change<T>(list: &Mutex<List>, id: u64, change: impl FnOnce(&mut Job) -> T) -> Option<T> {
    lock(list).jobs.iter_mut().find(|job| job.id == id).map(change)
}

/// Does the steps one after the other, until one does not succeed.
fn work(id: u64, order: &Order, program: &Path, list: &Arc<Mutex<List>>) {
    let mut state = State::Done;
    for step in &order.steps {
        state = match process(id, step, program, list) {
            Ok(status) if status.success() => State::Done,
            Ok(status) if status.code() == Some(STOPPED) => State::Stopped,
            // A quick one that was stopped.
            Ok(status) if status.code().is_none() && is_stopping(list, id) => State::Stopped,
            Ok(status) => {
                // Otherwise it has said why.
                if status.code().is_none() {
                    say(list, id, &format!("it ended with {status}"));
                }
                State::Failed
            }
            Err(error) => {
                say(list, id, &error);
                State::Failed
            }
        };
        if state != State::Done {
            break;
        }
        change(list, id, |job| job.done += 1);
        if is_stopping(list, id) {
            state = State::Stopped;
            break;
        }
    }
    end(list, id, state);
}

/// The job is over.
fn end(list: &Mutex<List>, id: u64, state: State) {
    change(list, id, |job| {
        (job.state, job.secs, job.child) = (state, Some(job.begun.elapsed().as_secs_f64()), None);
    });
}

fn is_stopping(list: &Mutex<List>, id: u64) -> bool {
    change(list, id, |job| job.state == State::Stopping).unwrap_or(true)
}

/// Keeps a line of what the job says.
fn say(list: &Mutex<List>, id: u64, line: &str) {
    let line = line.strip_prefix("etude: ").unwrap_or(line).trim_end();
    // The page shows the state, and has no Ctrl-C.
    if line == STOPPING {
        return;
    }
    change(list, id, |job| {
        job.said.push(line.chars().take(LONGEST_LINE).collect());
        let surplus = job.said.len().saturating_sub(LINES);
        job.said.drain(..surplus);
    });
}

/// Runs one process to its end and keeps its output.
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
        // It was asked to stop while the process started.
        if job.state == State::Stopping {
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
    match &step.keep {
        Some(path) if status.success() => write_file(path, &output).map_err(|error| error.to_string())?,
        _ => {}
    }
    Ok(status)
}

fn listen(errors: ChildStderr, id: u64, list: &Mutex<List>) {
    for line in BufReader::new(errors).split(b'\n').map_while(Result::ok) {
        let line = String::from_utf8_lossy(&line);
        if !line.trim().is_empty() {
            say(list, id, &line);
        }
    }
}
