//! The commands of README and book, run as they stand.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use crate::replaying::skip;
use crate::shell_blocks::{Documented, documented, of_page};
use crate::{Desk, TINY, errors, processes, root};

/// Beginnings of commands that are not run here, and why.
const BEGINNINGS: &[(&str, &str)] = &[
    ("twin", "it runs until it is stopped: `stopping.rs`"),
    ("robot ", "it needs a robot by the wall clock: `robots.rs` and `stopping.rs` start a twin"),
    ("rehearse", "minutes of training: `rehearsing.rs`"),
    ("experiment run songs", "hours of training: `make test-heavy` in its smallest form"),
    ("experiment run fences", "the same"),
    ("experiment status", "it needs these trainings"),
    ("experiment report", "the same"),
];
/// The same for parts of commands.
const PARTS: &[(&str, &str)] = &[
    ("--robot out/twin/twin.toml", "it needs a robot by the wall clock"),
    ("out/lab", "it needs what was recorded there"),
    ("--fault", "it ends with the fault that was ordered: `robots.rs`"),
    (
        "--policy runs/my-song-identified",
        "a short training pushes at the limits of the hand's torque until the twin is stopped",
    ),
    ("runs/rehearse", "it needs what `rehearse` writes"),
    ("out/rehearse-sight-reader", "the same"),
    ("--correction", "the same"),
    ("--set trainer.total_steps=3e6", "millions of steps"),
];

/// Why a command is not run.
fn left_out(line: &str) -> Option<&'static str> {
    let begins = BEGINNINGS.iter().find(|(beginning, _)| line.starts_with(beginning));
    let has = PARTS.iter().find(|(part, _)| line.contains(part));
    begins.or(has).map(|(_, why)| *why)
}

/// Runs a command in `desk`. Only trainings and fits are made short; what is learned in that time pushes at the limits of the hand's torque
/// until the twin is stopped, so the scripted player performs in its place.
fn run(desk: &Desk, command: &Documented) {
    let home = desk.path("home");
    let at_home = |word: &String| word.replace('~', &home.display().to_string());
    let words: Vec<String> = command.words.iter().map(at_home).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let has = |option: &str| words.contains(&option);
    let mut etude = Command::new(assert_cmd::cargo::cargo_bin!("etude"));
    etude.current_dir(desk.path("")).env("HOME", &home).args(&words);
    match words[0] {
        "serve" => return serve(etude),
        "identify" => drop(etude.args(["--evaluations", "1"])),
        "train" if !has("--resume") => {
            if !has("-o") {
                // Several of a page are alternatives with one folder.
                let _ = std::fs::remove_dir_all(desk.path("runs"));
            }
            // A shipped policy has larger networks.
            let begins_shipped = words.iter().any(|word| word.starts_with("policies/"));
            let fits = |set: &&str| !(begins_shipped && set.starts_with("droq.hidden"));
            etude.args(TINY.iter().copied().filter(fits).flat_map(|set| ["--set", set]));
        }
        "perform" if words[1].ends_with(".mid") => {
            let stem = Path::new(words[1]).file_stem().unwrap().to_str().unwrap();
            etude.args(["--scripted", "-o", &format!("out/{stem}-real")]);
        }
        _ => {}
    }
    println!("{}: etude {}", command.page, command.line());
    let output = etude.output().unwrap();
    let said = errors(&output);
    if words[0] == "render" && said.contains("no off-screen OpenGL here") {
        return skip("there is no off-screen OpenGL here");
    }
    assert!(output.status.success(), "{}: etude {}: {said}", command.page, command.line());
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
fn desk() -> Desk {
    let desk = Desk::new();
    for folder in ["songs", "policies"] {
        std::os::unix::fs::symlink(root().join(folder), desk.path(folder)).unwrap();
    }
    std::fs::rename(desk.path("short.mid"), desk.path("my-song.mid")).unwrap();
    desk
}

#[test]
fn the_commands_of_the_readme_run_one_after_the_other() {
    let desk = desk();
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
            run(&desk, &command);
        }
    }
    for made in
        ["out/twinkle/replay.html", "out/both.html", "out/gallery/index.html", "out/twinkle/recording.mp4"]
    {
        // Without ffmpeg a video is a folder of pictures.
        assert!(desk.path(made).is_file() || made.ends_with(".mp4"), "{made}");
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
    let mut ran = 0;
    for page in all.chunk_by(|one, next| one.page == next.page).filter(|page| page[0].page != "README.md") {
        let desk = desk();
        if page[0].page == "docs/reading.md" {
            // It begins with what was played on the pages before.
            desk.ok("play twinkle");
            desk.ok("perform twinkle --robot twin -o out/twin");
        }
        for command in page.iter().filter(|command| left_out(&command.line()).is_none()) {
            run(&desk, command);
            ran += 1;
        }
    }
    assert!(ran > 55, "{ran}");
}
