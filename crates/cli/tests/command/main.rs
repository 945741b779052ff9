//! The real `etude`, driven as people drive it: in a scratch folder, by its arguments, signals,
//! output and files.
#![allow(clippy::unwrap_used, reason = "a test that cannot continue has failed")]
#![allow(clippy::print_stdout, reason = "the test harness shows it on request")]

mod browser;
mod documented;
mod experiments;
mod exporting;
mod interrupting;
mod killed_recordings;
mod lexer;
mod mistakes;
mod pages;
mod playing;
mod printing;
mod processes;
mod rehearsing;
mod rendering;
mod replaying;
mod robots;
mod serve;
mod serve_access;
mod served_twin;
mod server;
mod shell_blocks;
mod sight;
mod slurm;
mod songs;
mod stop_times;
mod stopping;
mod terminals;
mod tour;
mod training;
mod typing;
mod unreached;
mod watch;
mod words;
mod worlds;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use etude_music::{Note, Song};

/// Settings with which a training takes a second.
const TINY: &[&str] = &[
    "trainer.total_steps=400",
    "trainer.num_envs=2",
    "trainer.warmup_steps=100",
    "trainer.log_every_steps=100",
    "trainer.evaluate_every_steps=200",
    "trainer.checkpoint_every_steps=100",
    "droq.hidden=[16,16]",
    "droq.batch=16",
];

/// A scratch folder with `short.mid`, a song of three notes, in which commands run.
struct Sandbox {
    folder: tempfile::TempDir,
}

impl Sandbox {
    /// A fresh one.
    fn new() -> Self {
        let sandbox = Self { folder: tempfile::tempdir().unwrap() };
        sandbox.write_song("short.mid", [60, 62, 64]);
        sandbox
    }

    /// Writes a song of three notes to `name`.
    fn write_song(&self, name: &str, pitches: [u8; 3]) {
        let note = |(at, pitch): (usize, u8)| {
            let start_secs = 0.3 * at as f64;
            Note { pitch, start_secs, end_secs: start_secs + 0.3, velocity: 80 }
        };
        let notes = pitches.into_iter().enumerate().map(note).collect();
        Song::new("Short", notes, 0.9).unwrap().save(self.path(name)).unwrap();
    }

    /// Where `name` lies.
    fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.folder.path().join(name)
    }

    /// What the file `name` holds.
    fn bytes(&self, name: impl AsRef<Path>) -> Vec<u8> {
        let path = self.path(name);
        std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    }

    /// `etude` with `args` (separated by spaces), not yet started.
    fn command(&self, args: &str) -> Command {
        let mut command = Command::new(assert_cmd::cargo::cargo_bin!("etude"));
        command.current_dir(self.folder.path()).args(args.split_whitespace());
        command
    }

    /// `etude train` of the tiny sort.
    fn tiny(&self, args: &str) -> Command {
        let mut command = self.command("train");
        command.args(TINY.iter().flat_map(|set| ["--set", set])).args(args.split_whitespace());
        command
    }

    /// What `etude` with `args` printed; it must succeed.
    fn ok(&self, args: &str) -> String {
        succeed(self.command(args))
    }

    /// The same as JSON.
    fn json(&self, args: &str) -> serde_json::Value {
        serde_json::from_str(&self.ok(args)).unwrap()
    }

    /// Names of all that lies in the folder, `short.mid` aside.
    fn left_behind(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.folder.path()).unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.filter(|name| name != "short.mid").collect()
    }
}

/// Waits until it is so; on a busy machine that takes a while.
fn wait_for(what: &str, mut is_so: impl FnMut() -> bool) {
    let until = Instant::now() + Duration::from_secs(120);
    while !is_so() {
        assert!(Instant::now() < until, "{what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// The top of the repository.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The shipped policy of `song`.
fn shipped(song: &str) -> PathBuf {
    root().join(format!("policies/{song}.safetensors"))
}

/// Standard output of a command that must succeed without a panic.
fn succeed(mut command: Command) -> String {
    let output = command.output().unwrap();
    let (code, said) = (output.status.code(), errors(&output));
    assert!(code == Some(0) && !said.contains("panicked"), "{command:?} ended with {code:?}: {said}");
    String::from_utf8(output.stdout).unwrap()
}

/// What a command wrote to standard error.
fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The columns of a CSV file, line by line, the header first.
fn csv(text: &[u8]) -> Vec<Vec<String>> {
    let text = std::str::from_utf8(text).unwrap();
    text.lines().map(|line| line.split(',').map(str::to_string).collect()).collect()
}
