//! The commands of README and book, run. Trainings and fits are shortened; `left_out` says which are
//! not run here.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use crate::browser::skip;
use crate::served_twin::Served;
use crate::shell_blocks::{Documented, documented, of_page};
use crate::{Sandbox, TINY, errors, processes, root, succeed, wait_for};

const BY_THE_CLOCK: &str = "a robot by the wall clock: run beside a twin, by `make test-heavy`";
const REHEARSED: &str = "minutes of fits: run with short ones, by `make test-heavy`";

/// Beginnings of commands that are not run with the others, and why.
const BEGINNINGS: &[(&str, &str)] = &[("twin", BY_THE_CLOCK), ("robot ", BY_THE_CLOCK)];
/// The same for parts of commands.
const PARTS: &[(&str, &str)] = &[
    ("--robot out/twin/twin.toml", BY_THE_CLOCK),
    ("out/lab", BY_THE_CLOCK),
    ("rehearse", REHEARSED),
    ("--correction", REHEARSED),
    ("--policy runs/my-song-identified", REHEARSED),
];

/// Pages with such commands.
const BY_THE_CLOCK_ON: [&str; 2] = ["docs/twin.md", "docs/midi-to-robot.md"];
const REHEARSED_ON: [&str; 5] =
    ["README.md", "docs/identify.md", "docs/midi-to-robot.md", "docs/reading.md", "docs/sight-reading.md"];

/// Why a command is not run.
fn left_out(line: &str) -> Option<&'static str> {
    let begins = BEGINNINGS.iter().find(|(beginning, _)| line.starts_with(beginning));
    let has = PARTS.iter().find(|(part, _)| line.contains(part));
    begins.or(has).map(|(_, why)| *why)
}

/// Runs a command in `sandbox`. Only trainings and fits are made short; what is learned in that
/// time pushes at the limits of the hand's torque until the twin is stopped, so the scripted
/// baseline performs in its place.
fn run(sandbox: &Sandbox, command: &Documented) {
    let home = sandbox.path("home");
    let at_home = |word: &String| word.replace('~', &home.display().to_string());
    let words: Vec<String> = command.words.iter().map(at_home).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let has = |option: &str| words.contains(&option);
    let line = command.line();
    println!("{}: etude {line}", command.page);
    let mut etude = Command::new(assert_cmd::cargo::cargo_bin!("etude"));
    etude.current_dir(sandbox.path("")).env("HOME", &home).args(&words);
    // A shipped policy has larger networks.
    let short = |begins_shipped: bool| {
        let fits = move |set: &&str| !(begins_shipped && set.starts_with("droq.hidden"));
        TINY.iter().copied().filter(fits).flat_map(|set| ["--set", set])
    };
    match words[0] {
        "serve" => return serve(etude),
        "experiment" if has("run") && !has("--dry-run") => return interrupt(etude),
        "train" if line.contains("total_steps=3e6") => return interrupt(etude),
        "identify" => drop(etude.args(["--evaluations", "1"])),
        "rehearse" => {
            etude.args(["--runs", "1", "--evaluations", "2"]);
            if line.contains("--preset sight-reader") {
                etude.args(["--set", "corpus.validation_pieces=1"]);
            }
            etude.args(short(!line.contains("--policy runs/")));
        }
        "train" if !has("--resume") => {
            if !has("-o") {
                // Several of a page are alternatives with one folder.
                let _ = std::fs::remove_dir_all(sandbox.path("runs"));
            }
            etude.args(short(words.iter().any(|word| word.starts_with("policies/"))));
        }
        "perform" if words[1].ends_with(".mid") && !has("--policy") => {
            etude.arg("--scripted");
            if !has("-o") {
                let stem = Path::new(words[1]).file_stem().unwrap().to_str().unwrap();
                etude.args(["-o", &format!("out/{stem}-real")]);
            }
        }
        _ => {}
    }
    let output = etude.output().unwrap();
    let said = errors(&output);
    if words[0] == "render" && said.contains("no off-screen OpenGL here") {
        return skip("there is no off-screen OpenGL here");
    }
    // A fault that was ordered ends it, and of trials that were interrupted there is nothing to
    // report.
    let code = if has("--fault") || line.starts_with("experiment report") { 1 } else { 0 };
    assert_eq!(output.status.code(), Some(code), "{}: etude {line}: {said}", command.page);
}

/// Starts what takes hours, and interrupts it as soon as it can be.
fn interrupt(mut etude: Command) {
    let mut child = etude.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    wait_for("it never handled Ctrl-C", || {
        processes::catches(child.id(), processes::INT) || child.try_wait().unwrap().is_some()
    });
    processes::signal(child.id(), "INT");
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(3), "{etude:?}: {}", errors(&output));
}

/// Starts the server and stops it once it has printed its address.
fn serve(mut etude: Command) {
    let mut server = etude.stdout(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(server.stdout.take().unwrap()).read_line(&mut line).unwrap();
    processes::signal(server.id(), "INT");
    let status = server.wait().unwrap();
    assert!(status.code() == Some(3) && line.starts_with("http://127.0.0.1:"), "{status}: {line}");
}

/// A folder as a reader has it: the repository's songs, and a song of one's own.
fn sandbox() -> Sandbox {
    let sandbox = Sandbox::new();
    for folder in ["songs", "policies"] {
        std::os::unix::fs::symlink(root().join(folder), sandbox.path(folder)).unwrap();
    }
    std::fs::rename(sandbox.path("short.mid"), sandbox.path("my-song.mid")).unwrap();
    sandbox
}

#[test]
fn the_commands_of_the_readme_run_one_after_the_other() {
    let sandbox = sandbox();
    let readme = include_str!("../../../../README.md");
    let (_, rest) = readme.split_once("\n## Five minutes\n").unwrap();
    let tour = of_page("README.md".as_ref(), rest.split_once("\n## ").unwrap().0);
    for verb in ["train", "play", "replay", "perform", "watch", "gallery"] {
        assert!(tour.iter().any(|command| command.words[0] == verb), "no {verb}");
    }
    assert!(
        tour.iter().all(|command| left_out(&command.line()).is_none()),
        "every one of the five minutes runs"
    );
    for command in of_page("README.md".as_ref(), readme) {
        if left_out(&command.line()).is_none() {
            run(&sandbox, &command);
        }
    }
    for made in [
        "out/twinkle/latest/replay.html",
        "out/both.html",
        "out/gallery/index.html",
        "out/twinkle/latest/recording.mp4",
    ] {
        // Without ffmpeg a video is a folder of pictures.
        assert!(sandbox.path(made).is_file() || made.ends_with(".mp4"), "{made}");
    }
}

/// Page by page, each in a folder of its own, in the order of the page, what takes seconds.
#[test]
fn the_quick_commands_of_the_book_run() {
    let all = documented();
    for (part, why) in BEGINNINGS.iter().chain(PARTS) {
        assert!(
            all.iter().any(|command| command.line().contains(part)),
            "nothing has `{part}` any more ({why})"
        );
    }
    for command in &all {
        let (page, line) = (command.page.as_str(), command.line());
        let is_run = match left_out(&line) {
            Some(BY_THE_CLOCK) => BY_THE_CLOCK_ON.contains(&page),
            Some(REHEARSED) => REHEARSED_ON.contains(&page),
            _ => true,
        };
        assert!(is_run, "{page}: no test runs `etude {line}`");
    }
    let mut ran = 0;
    for page in all.chunk_by(|one, next| one.page == next.page).filter(|page| page[0].page != "README.md") {
        let sandbox = sandbox();
        if page[0].page == "docs/reading.md" {
            // It begins with what was played on the pages before.
            sandbox.ok("play twinkle");
            sandbox.ok("perform twinkle --robot twin");
        }
        for command in page.iter().filter(|command| left_out(&command.line()).is_none()) {
            run(&sandbox, command);
            ran += 1;
        }
    }
    assert!(ran > 55, "{ran}");
}

/// The commands of a page that are left out for this reason.
fn of_reason(page: &str, reason: &str) -> Vec<Documented> {
    let all = documented().into_iter().filter(|command| command.page == page);
    all.filter(|command| left_out(&command.line()) == Some(reason)).collect()
}

#[test]
#[ignore = "takes minutes by the wall clock: `make test-heavy`, which .ci/run calls"]
fn the_commands_for_a_robot_run_beside_a_twin() {
    for page in BY_THE_CLOCK_ON {
        let sandbox = sandbox();
        sandbox.ok("play my-song.mid --scripted -o out/my-song");
        let twin = Served::of(&sandbox, "twin -o out/twin");
        // As `sed` and `mkdir` of the page make them.
        let practice = std::fs::read_to_string(&twin.rig).unwrap();
        let practice = practice.lines().map(|line| match line.split_once(" = ") {
            Some(("name", _)) => "name = \"lab\"\n".to_string(),
            Some(("calibration", _)) => "calibration = \"lab.calibration.toml\"\n".to_string(),
            _ => format!("{line}\n"),
        });
        std::fs::write(sandbox.path("practice.toml"), practice.collect::<String>()).unwrap();
        std::fs::create_dir(sandbox.path("out/lab")).unwrap();
        for command in of_reason(page, BY_THE_CLOCK) {
            let line = command.line();
            match command.words[0].as_str() {
                // It runs already.
                "twin" if command.words.len() == 1 => {}
                "twin" => interrupt(sandbox.command(&format!("{line} -o out/another"))),
                "robot" if line.contains("calibrate") => calibrate(&sandbox, &line),
                _ => run(&sandbox, &command),
            }
        }
    }
}

/// The arm stands where it is: the third key cannot be at the place of the first.
fn calibrate(sandbox: &Sandbox, line: &str) {
    let output = sandbox.command(line).stdin(Stdio::null()).output().unwrap();
    let said = errors(&output);
    if line.ends_with("highest") {
        assert!(output.status.code() == Some(1) && said.contains("0.0 mm apart"), "{said}");
    } else {
        assert!(output.status.success(), "{line}: {said}");
    }
}

#[test]
#[ignore = "takes minutes: `make test-heavy`, which .ci/run calls"]
fn the_rehearsals_of_readme_and_book_run() {
    for page in REHEARSED_ON {
        let sandbox = sandbox();
        match page {
            "docs/midi-to-robot.md" => {
                let mut train = sandbox.command("train my-song.mid");
                train.args(TINY.iter().flat_map(|set| ["--set", set]));
                succeed(train);
                // What is learned in this time cannot play on the twin.
                std::fs::create_dir(sandbox.path("runs/my-song-identified")).unwrap();
                let policy = sandbox.path("runs/my-song-identified/policy-best.safetensors");
                std::fs::copy(crate::shipped("twinkle"), policy).unwrap();
            }
            "docs/reading.md" => {
                sandbox.ok("play twinkle");
                sandbox.ok("perform twinkle -o runs/rehearse");
            }
            _ => {}
        }
        let commands = of_reason(page, REHEARSED);
        assert!(!commands.is_empty(), "{page}");
        commands.iter().for_each(|command| run(&sandbox, command));
    }
}
