//! However a long verb loses its terminal, its descriptors or the wish that it continues: it ends
//! soon, with the documented code, and leaves nothing half done.

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use etude_music::Song;
use etude_perform::Recording;
use serde_json::Value;

use crate::served_twin::{Served, is_safe};
use crate::{Sandbox, TINY, processes, wait_for};

/// Time in which a verb must have ended, on a busy machine.
const ENDS_WITHIN: Duration = Duration::from_secs(60);
/// Time over which an idle verb's use of the processor is measured.
const MEASURED: Duration = Duration::from_millis(500);

/// Runs a program (after a way) in a terminal of its own, in which a descriptor is closed already,
/// or which is gone once a line is read. Prints the program's id, and in the end what the terminal
/// was sent; ends as the program.
const LAUNCHER: &str = r#"
import fcntl, os, pty, resource, select, signal, struct, sys, termios
way, program = sys.argv[1], sys.argv[2:]
main, side = pty.openpty()
fcntl.ioctl(side, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
unwritten, writer = os.pipe()
reader, unread = os.pipe()
os.close(writer), os.close(reader)
child = os.fork()
if child == 0:
    os.setsid()
    # A terminal of another session sends no SIGHUP when it goes.
    if way != "gone":
        fcntl.ioctl(side, termios.TIOCSCTTY, 0)
    for number in (signal.SIGHUP, signal.SIGINT, signal.SIGQUIT, signal.SIGPIPE):
        signal.signal(number, signal.SIG_DFL)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    ends = {"stdin": unwritten if way == "stdin" else side, "stdout": side, "stderr": side}
    if way in ("stdout", "stderr"):
        ends[way] = unread
    for number, end in enumerate(ends.values()):
        os.dup2(end, number)
    if way == "all":
        os.closerange(0, 3)
    os.execv(program[0], program)
os.close(side)
print(child, flush=True)
said, waits = b"", [main, 0]
while True:
    ended, status = os.waitpid(child, os.WNOHANG)
    for ready in select.select(waits, [], [], 0.01)[0]:
        if ready == main:
            try:
                said += os.read(main, 65536)
            except OSError:
                waits.remove(main)
        else:
            waits.remove(0)
            if os.read(0, 1) and way in ("hangup", "gone"):
                if main in waits:
                    waits.remove(main)
                os.close(main)
    if ended:
        break
sys.stderr.buffer.write(said)
sys.stderr.flush()
code = os.waitstatus_to_exitcode(status)
sys.exit(code if code >= 0 else 128 - code)
"#;

/// What a program loses. A terminal that is hung up sends SIGHUP; one that is gone does not.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Lost {
    Stdin,
    Stdout,
    Stderr,
    All,
    Gone,
    Hangup,
}

use Lost::{All, Gone, Hangup, Stderr, Stdin, Stdout};

/// Each loss with a signal; turned by one for each verb, so that in the end every loss met every
/// signal.
const SIGNALS: [&str; 6] = ["HUP", "INT", "TERM", "QUIT", "PIPE", "WINCH"];
const LOSSES: [Lost; 5] = [Stdin, Stdout, Stderr, All, Gone];

/// A verb, and what must become of it. `OUT` stands for a path of its own.
#[derive(Clone, Copy)]
struct Verb {
    args: &'static str,
    /// What it has made when it is at work.
    sign: &'static str,
    /// What it makes only at its end.
    last: &'static str,
    /// What a stop saves.
    saves: &'static str,
    /// Whether it waits most of the time.
    is_idle: bool,
    /// Losses that end it by themselves, and its code then.
    ends_by: &'static [(Lost, i32)],
    /// Whether it works only in a terminal.
    is_screen: bool,
}

const VERB: Verb =
    Verb { args: "", sign: "", last: "OUT", saves: "", is_idle: false, ends_by: &[], is_screen: false };

/// Those that need no other process.
const VERBS: &[Verb] = &[
    Verb {
        args: "train short.mid --set trainer.total_steps=400000 TINY -o OUT",
        sign: "OUT/metrics.jsonl",
        last: "",
        saves: "OUT/checkpoints/last.safetensors",
        ..VERB
    },
    Verb { args: "play long.mid --scripted -o OUT", sign: "OUT/1/recording.mcap", ..VERB },
    Verb {
        args: "perform short.mid --scripted --runs 100 -o OUT",
        sign: "OUT/1/run-1.mcap",
        last: "OUT/1/run-100.wav",
        ..VERB
    },
    Verb {
        args: "record --robot twin --secs 600 -o OUT.mcap",
        sign: "OUT.mcap",
        last: "",
        saves: "OUT.mcap",
        ..VERB
    },
    Verb { args: "evaluate short.mid --scripted --worlds 100000 -o OUT", ..VERB },
    Verb { args: "identify rail.mcap -o OUT", sign: "OUT/state.json", last: "OUT/identified.toml", ..VERB },
    Verb { args: "rehearse long.mid --iterations 1 -o OUT", last: "OUT/rehearsal.html", ..VERB },
    // Its page is whole after each recording.
    Verb { args: "gallery takes -o OUT", last: "", ..VERB },
    Verb { args: "experiment run songs --runs-dir OUT", sign: "OUT", last: "OUT/index.html", ..VERB },
    Verb { args: "robot check --robot twin --joints", ..VERB },
    Verb { args: "robot home --robot twin", ..VERB },
    Verb { args: "twin -o OUT", sign: "OUT/twin.toml", last: "", ..VERB },
    // Nobody learns its address.
    Verb { args: "serve", last: "", is_idle: true, ends_by: &[(Stdout, 0)], ..VERB },
    Verb { args: "watch", last: "", is_idle: true, is_screen: true, ends_by: &[(Gone, 3)], ..VERB },
];

/// Where pictures can be drawn.
const RENDER: Verb = Verb { args: "render out -o OUT.mp4", last: "OUT.mp4", ..VERB };

/// Those of a robot in another process.
const OF_A_ROBOT: &[Verb] = &[
    Verb {
        args: "robot monitor --robot twin/twin.toml",
        last: "",
        is_idle: true,
        ends_by: &[(Stdout, 0), (Gone, 3)],
        ..VERB
    },
    Verb {
        args: "robot calibrate --robot twin/twin.toml --at middle --by-hand",
        last: "",
        is_idle: true,
        ends_by: &[(Stdin, 3), (All, 3), (Gone, 3)],
        ..VERB
    },
];

/// A verb in its terminal.
struct Running {
    launcher: Child,
    program: u32,
    what: String,
    out: PathBuf,
}

impl Running {
    /// Starts it and waits until it is at work.
    fn start(sandbox: &Sandbox, verb: Verb, lost: Lost, signal: &str) -> Self {
        static NUMBER: std::sync::atomic::AtomicU32 = std::sync::atomic::AtomicU32::new(0);
        let number = NUMBER.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let out = format!("out-{number}");
        let tiny: Vec<String> = TINY[1..].iter().map(|set| format!("--set {set}")).collect();
        let args = verb.args.replace("OUT", &out).replace("TINY", &tiny.join(" "));
        let mut launcher = Command::new("python3");
        launcher.current_dir(sandbox.path("")).env("TERM", "xterm-256color");
        launcher.args(["-c", LAUNCHER, &format!("{lost:?}").to_lowercase()]);
        launcher.arg(assert_cmd::cargo::cargo_bin!("etude")).args(args.split_whitespace());
        launcher.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut launcher = launcher.spawn().unwrap();
        let mut line = String::new();
        BufReader::new(launcher.stdout.as_mut().unwrap()).read_line(&mut line).unwrap();
        let program = line.trim().parse().unwrap();
        let what = format!("{args}, lost {lost:?}, then {signal}");
        let mut running = Self { launcher, program, what, out: sandbox.path(&out) };
        let sign = sandbox.path(verb.sign.replace("OUT", &out));
        if !verb.ends_by.iter().any(|(by, _)| *by == lost) {
            wait_for(&running.what.clone(), || {
                assert!(running.launcher.try_wait().unwrap().is_none(), "{}", running.said());
                // The last signal that it begins to catch.
                processes::catches(program, processes::HUP) && sign.exists()
            });
        }
        running
    }

    /// The terminal goes.
    fn lose(&mut self) {
        // A program that has ended needs no terminal.
        let _ = self.launcher.stdin.as_mut().unwrap().write_all(b".");
    }

    /// How it ended.
    fn ended(&mut self) -> ExitStatus {
        let until = Instant::now() + ENDS_WITHIN;
        loop {
            if let Some(status) = self.launcher.try_wait().unwrap() {
                return status;
            }
            if Instant::now() > until {
                processes::signal(self.program, "KILL");
                panic!("it continues: {}", self.said());
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// What was done to it, and what the terminal was sent by then; of a program that has ended.
    fn said(&mut self) -> String {
        let mut text = Vec::new();
        let _ = std::io::Read::read_to_end(self.launcher.stderr.as_mut().unwrap(), &mut text);
        format!("{}: {}", self.what, String::from_utf8_lossy(&text))
    }
}

/// Goes through one verb with one loss and one signal.
fn goes_through(sandbox: &Sandbox, verb: Verb, lost: Lost, signal: &str) {
    let begun = Instant::now();
    let mut running = Running::start(sandbox, verb, lost, signal);
    let children = processes::children_of(running.program);
    if matches!(lost, Gone | Hangup) {
        running.lose();
    }
    let by_itself = verb.ends_by.iter().find(|(by, _)| *by == lost);
    let code = match by_itself {
        Some((_, code)) => *code,
        None if lost == Hangup => 3,
        None => {
            let goes_on = matches!(signal, "PIPE" | "WINCH");
            processes::signal(running.program, signal);
            if goes_on {
                stays(&mut running, verb);
                processes::signal(running.program, "TERM");
            }
            if signal == "QUIT" { 128 + 3 } else { 3 }
        }
    };
    let status = running.ended();
    let said = running.said();
    let what = &running.what;
    println!("{:4.1} s: {what}", begun.elapsed().as_secs_f64());
    assert_eq!(status.code(), Some(code), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    wait_for(&format!("{what}: its processes are left"), || children.iter().all(|id| !processes::runs(*id)));
    if signal != "QUIT" || by_itself.is_some() || lost == Hangup {
        let path = |name: &str| PathBuf::from(name.replace("OUT", &running.out.display().to_string()));
        assert!(verb.last.is_empty() || !path(verb.last).exists(), "{what}: {} is there", verb.last);
        assert!(verb.saves.is_empty() || path(verb.saves).exists(), "{what}: nothing is saved");
        whole(&running.out, what);
        whole(&running.out.with_extension("mcap"), what);
    }
}

/// It continues, and an idle one without a busy loop.
fn stays(running: &mut Running, verb: Verb) {
    let before = processes::processor_secs(running.program);
    std::thread::sleep(if verb.is_idle { MEASURED } else { Duration::from_millis(20) });
    let ended = running.launcher.try_wait().unwrap();
    assert!(ended.is_none(), "ended with {ended:?}: {}", running.said());
    let busy = processes::processor_secs(running.program) - before;
    assert!(!verb.is_idle || busy < MEASURED.as_secs_f64() / 2.0, "{}: busy for {busy} s", running.what);
}

/// All files that have a form have it.
fn whole(path: &Path, what: &str) {
    if path.is_dir() {
        std::fs::read_dir(path).unwrap().for_each(|entry| whole(&entry.unwrap().path(), what));
        return;
    }
    let is_whole = match path.extension().and_then(|kind| kind.to_str()) {
        _ if !path.exists() => true,
        Some("json") => serde_json::from_slice::<Value>(&std::fs::read(path).unwrap()).is_ok(),
        Some("mid") => Song::load(path).is_ok(),
        Some("mcap") => Recording::read(path).is_ok(),
        _ => true,
    };
    assert!(is_whole, "{what}: {} is not whole", path.display());
}

/// What the verbs work on.
fn inputs() -> Sandbox {
    let sandbox = Sandbox::new();
    let notes = (0..200_u8).map(|at| etude_music::Note {
        pitch: 60 + at % 5,
        start_secs: f64::from(at),
        end_secs: f64::from(at) + 0.5,
        velocity: 80,
    });
    Song::new("Long", notes.collect(), 200.0).unwrap().save(sandbox.path("long.mid")).unwrap();
    sandbox.ok("record --robot twin --excitation rail -o rail.mcap");
    sandbox.ok("play short.mid --scripted -o out");
    std::fs::create_dir(sandbox.path("takes")).unwrap();
    for take in 0..400 {
        let link = sandbox.path(format!("takes/{take}.mcap"));
        std::fs::hard_link(sandbox.path("out/1/recording.mcap"), link).unwrap();
    }
    std::fs::create_dir_all(sandbox.path("runs/run")).unwrap();
    for (name, text) in [
        ("config.toml", "[trainer]\ntotal_steps = 4000\n"),
        ("meta.json", "{\"song\": \"Short\"}"),
        ("metrics.jsonl", ""),
    ] {
        std::fs::write(sandbox.path("runs/run").join(name), text).unwrap();
    }
    sandbox
}

/// Each verb with every signal and every loss.
fn all(sandbox: &Sandbox, verbs: impl Iterator<Item = (usize, Verb)>, after: impl Fn(&str)) {
    for (number, verb) in verbs {
        let losses: &[Lost] = if verb.is_screen { &[Stdin, Stderr, Gone] } else { &LOSSES };
        for (at, signal) in SIGNALS.into_iter().enumerate() {
            let lost = losses[(at + number) % losses.len()];
            goes_through(sandbox, verb, lost, signal);
            after(&format!("{}, lost {lost:?}, then {signal}", verb.args));
        }
        goes_through(sandbox, verb, Hangup, "nothing");
        after(verb.args);
    }
}

#[test]
fn long_verbs_end_with_their_terminal_and_by_every_signal() {
    let sandbox = inputs();
    let mut verbs = VERBS.to_vec();
    if crate::rendering::draws(&sandbox) {
        verbs.push(RENDER);
    }
    std::thread::scope(|scope| {
        for lane in 0..2 {
            let (sandbox, verbs) = (&sandbox, &verbs);
            let ours = move |(number, _): &(usize, Verb)| number % 2 == lane;
            scope.spawn(move || all(sandbox, verbs.iter().copied().enumerate().filter(ours), |_| {}));
        }
        // They wait most of the time.
        let twin = Served::start(&sandbox);
        all(&sandbox, OF_A_ROBOT.iter().copied().enumerate(), |what| {
            wait_for(&format!("{what}: the arm is not let go"), || is_safe(twin.seen(&sandbox)));
        });
    });
}

/// A verb that handles a request to stop is tried above.
#[test]
fn every_long_verb_is_tried() {
    let tried = VERBS.iter().chain(OF_A_ROBOT).chain([&RENDER]);
    let tried: Vec<&str> = tried.flat_map(|verb| verb.args.split(' ').take(2)).collect();
    for folder in ["verbs", "verbs/robot", "watch"] {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src").join(folder);
        for file in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            let name = file.file_stem().unwrap().to_str().unwrap();
            let verb = if name == "screen" { "watch" } else { name };
            let is_long = file.is_file() && std::fs::read_to_string(&file).unwrap().contains("stop_flag()");
            assert!(!is_long || tried.contains(&verb), "`etude {verb}` is not in the table");
        }
    }
}
