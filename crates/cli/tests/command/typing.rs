//! What is printed can be typed, also where names have spaces and apostrophes.

use std::path::Path;
use std::process::{Command, Output};

use crate::{Desk, TINY, errors, succeed};

/// A song and a folder as people name them.
const SONG: &str = "my songs/it's {mine}.mid";
const RUN: &str = "my runs/it's one";

/// The first command in `text` that begins with `begin`: up to the end of its line, or to the backtick that closes it.
fn printed(text: &str, begin: &str) -> String {
    let at = text.find(begin).unwrap_or_else(|| panic!("`{begin}` is not in: {text}"));
    text[at..].split(['\n', '`']).next().unwrap().to_string()
}

/// Runs a command line as a person does, in the desk's folder; `more` is added to it.
fn typed(desk: &Desk, line: &str, more: &str) -> Output {
    let folder = Path::new(assert_cmd::cargo::cargo_bin!("etude")).parent().unwrap();
    let path = format!("{}:{}", folder.display(), std::env::var("PATH").unwrap());
    let mut shell = Command::new("sh");
    shell.args(["-c", &format!("{line} {more}")]).current_dir(desk.folder.path()).env("PATH", path);
    shell.output().unwrap()
}

fn works(desk: &Desk, line: &str, more: &str) -> String {
    let output = typed(desk, line, more);
    assert!(output.status.success(), "{line} {more}: {}", errors(&output));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn printed_commands_can_be_typed_whatever_the_names() {
    let desk = Desk::new();
    std::fs::create_dir(desk.path("my songs")).unwrap();
    desk.write_song(SONG, [60, 62, 64]);
    let tiny = TINY.iter().map(|set| format!("--set '{set}' ")).collect::<String>();
    let etude = |args: &[&str]| desk.command("").args(args).output().unwrap();

    let said = errors(&etude(&["play", SONG]));
    let train = printed(&said, "etude train");
    let text = works(&desk, &train, &format!("{tiny} -o \"{RUN}\""));
    works(&desk, &printed(&text, "etude play"), "-o out");
    works(&desk, &printed(&text, "etude train --resume"), "");

    let said = errors(&etude(&["train", SONG, "-o", RUN]));
    works(&desk, &printed(&said, "etude train --resume"), "--set trainer.total_steps=900");

    let said = errors(&etude(&["train", "--resume", "no run's here"]));
    let start = printed(&said, "etude train SONG").replace("SONG", "short.mid");
    works(&desk, &start, &tiny);
    assert!(desk.path("no run's here/config.toml").is_file());

    std::fs::create_dir(desk.path("it's empty")).unwrap();
    let said = errors(&etude(&["watch", "--once", "it's empty"]));
    works(&desk, &printed(&said, "etude train SONG").replace("SONG", "short.mid"), &tiny);
    assert!(desk.path("it's empty/NAME/config.toml").is_file());

    let text = succeed({
        let mut arrange = desk.command("songs arrange");
        arrange.args([SONG, "--transpose", "12", "-o", "my songs/it's higher.mid"]);
        arrange
    });
    works(&desk, &printed(&text, "etude train"), &format!("{tiny} -o higher"));

    // A checkpoint that is damaged: what is left can be begun with.
    let checkpoint = format!("{RUN}/checkpoints/last.safetensors");
    std::fs::write(desk.path(&checkpoint), &desk.bytes(&checkpoint)[..100]).unwrap();
    let said = errors(&etude(&["train", "--resume", RUN]));
    works(&desk, &printed(&said, "etude train").replace("-o DIR", "-o again"), "");
    // The command that a run was made by is kept in the same way.
    let meta: serde_json::Value = serde_json::from_slice(&desk.bytes("again/meta.json")).unwrap();
    std::fs::remove_dir_all(desk.path("again")).unwrap();
    works(&desk, meta["command"].as_str().unwrap(), "");
    assert!(desk.path("again/config.toml").is_file());
}

#[test]
fn the_command_of_an_experiment_is_the_one_that_was_asked_for() {
    let desk = Desk::new();
    std::fs::create_dir(desk.path("it's mine")).unwrap();
    let plan = "title = 'T'\nsource = 'S'\nsongs = ['short.mid']\nseeds = 1\n";
    std::fs::write(desk.path("it's mine/one song.toml"), plan).unwrap();
    let mut report = desk.command("experiment report --seeds 2 --set");
    report.args(["trainer.total_steps = 400", "it's mine/one song.toml"]);
    let said = errors(&report.output().unwrap());
    let run = printed(&said, "etude experiment run");
    let trials = works(&desk, &run.replace("run", "plan"), "");
    assert_eq!(trials.lines().count(), 2, "{trials}");
    assert!(trials.lines().all(|trial| trial.contains("total_steps = 400")), "{trials}");
}
