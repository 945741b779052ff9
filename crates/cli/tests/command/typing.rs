//! What is printed can be typed, also where names have spaces and apostrophes.

use std::path::Path;
use std::process::{Command, Output};

use crate::{Sandbox, TINY, errors, succeed};

/// A song and a folder as people name them.
const SONG: &str = "my songs/it's {mine}.mid";
const RUN: &str = "my runs/it's one";

/// The first command in `text` that begins with `begin`: up to the end of its line, or to the
/// backtick that closes it.
fn printed(text: &str, begin: &str) -> String {
    let at = text.find(begin).unwrap_or_else(|| panic!("`{begin}` is not in: {text}"));
    text[at..].split(['\n', '`']).next().unwrap().to_string()
}

/// Runs a command line as a person does, in the sandbox's folder; `more` is added to it.
fn typed(sandbox: &Sandbox, line: &str, more: &str) -> Output {
    let folder = Path::new(assert_cmd::cargo::cargo_bin!("etude")).parent().unwrap();
    let path = format!("{}:{}", folder.display(), std::env::var("PATH").unwrap());
    let mut shell = Command::new("sh");
    shell.args(["-c", &format!("{line} {more}")]).current_dir(sandbox.folder.path()).env("PATH", path);
    shell.output().unwrap()
}

fn works(sandbox: &Sandbox, line: &str, more: &str) -> String {
    let output = typed(sandbox, line, more);
    assert!(output.status.success(), "{line} {more}: {}", errors(&output));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn printed_commands_can_be_typed_whatever_the_names() {
    let sandbox = Sandbox::new();
    std::fs::create_dir(sandbox.path("my songs")).unwrap();
    sandbox.write_song(SONG, [60, 62, 64]);
    let tiny = TINY.iter().map(|set| format!("--set '{set}' ")).collect::<String>();
    let etude = |args: &[&str]| sandbox.command("").args(args).output().unwrap();

    let said = errors(&etude(&["play", SONG]));
    let train = printed(&said, "etude train");
    let text = works(&sandbox, &train, &format!("{tiny} -o \"{RUN}\""));
    works(&sandbox, &printed(&text, "etude play"), "-o out");
    works(&sandbox, &printed(&text, "etude train --resume"), "");

    let said = errors(&etude(&["train", SONG, "-o", RUN]));
    works(&sandbox, &printed(&said, "etude train --resume"), "--set trainer.total_steps=900");

    let said = errors(&etude(&["train", "--resume", "no run's here"]));
    let start = printed(&said, "etude train SONG").replace("SONG", "short.mid");
    works(&sandbox, &start, &tiny);
    assert!(sandbox.path("no run's here/config.toml").is_file());

    std::fs::create_dir(sandbox.path("it's empty")).unwrap();
    let said = errors(&etude(&["watch", "--once", "it's empty"]));
    works(&sandbox, &printed(&said, "etude train SONG").replace("SONG", "short.mid"), &tiny);
    assert!(sandbox.path("it's empty/NAME/config.toml").is_file());

    let text = succeed({
        let mut arrange = sandbox.command("songs arrange");
        arrange.args([SONG, "--transpose", "12", "-o", "my songs/it's higher.mid"]);
        arrange
    });
    works(&sandbox, &printed(&text, "etude train"), &format!("{tiny} -o higher"));

    // A checkpoint that is damaged: what is left can be begun with.
    let checkpoint = format!("{RUN}/checkpoints/last.safetensors");
    std::fs::write(sandbox.path(&checkpoint), &sandbox.bytes(&checkpoint)[..100]).unwrap();
    let said = errors(&etude(&["train", "--resume", RUN]));
    works(&sandbox, &printed(&said, "etude train").replace("-o DIR", "-o again"), "");
    // The command that a run was made by is kept in the same way.
    let meta: serde_json::Value = serde_json::from_slice(&sandbox.bytes("again/meta.json")).unwrap();
    std::fs::remove_dir_all(sandbox.path("again")).unwrap();
    works(&sandbox, meta["command"].as_str().unwrap(), "");
    assert!(sandbox.path("again/config.toml").is_file());
}

#[test]
fn the_command_of_an_experiment_is_the_one_that_was_asked_for() {
    let sandbox = Sandbox::new();
    std::fs::create_dir(sandbox.path("it's mine")).unwrap();
    let plan = "title = 'T'\nsource = 'S'\nsongs = ['short.mid']\nseeds = 1\n";
    std::fs::write(sandbox.path("it's mine/one song.toml"), plan).unwrap();
    let mut report = sandbox.command("experiment report --seeds 2 --set");
    report.args(["trainer.total_steps = 400", "it's mine/one song.toml"]);
    let said = errors(&report.output().unwrap());
    let run = printed(&said, "etude experiment run");
    let trials = works(&sandbox, &run.replace("run", "plan"), "");
    assert_eq!(trials.lines().count(), 2, "{trials}");
    assert!(trials.lines().all(|trial| trial.contains("total_steps = 400")), "{trials}");
}

/// What bash offers for `words`, the last of which is being typed.
fn completed(sandbox: &Sandbox, words: &[&str]) -> Vec<String> {
    let script = sandbox.ok("completions bash");
    std::fs::write(sandbox.path("etude.bash"), script).unwrap();
    let ask = r#"source etude.bash; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _etude etude "${!#}" "${*: -2:1}"; printf '%s\n' "${COMPREPLY[@]}""#;
    let output = Command::new("bash")
        .args(["--norc", "-c", ask, "bash"])
        .args(words)
        .current_dir(sandbox.folder.path())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", errors(&output));
    let said = String::from_utf8(output.stdout).unwrap();
    said.lines().filter(|line| !line.is_empty()).map(str::to_string).collect()
}

#[test]
fn bash_completes_verbs_options_names_and_files() {
    let sandbox = Sandbox::new();
    let cases: &[(&[&str], &[&str])] = &[
        (&["etude", "tra"], &["train"]),
        (&["etude", "robot", "cal"], &["calibrate"]),
        (&["etude", "play", "tw"], &["twinkle"]),
        (&["etude", "train", "twinkle", "--preset", "app"], &["appendix"]),
        (&["etude", "train", "--mi"], &["--minutes"]),
        (&["etude", "experiment", "run", "fen"], &["fences"]),
        (&["etude", "perform", "twinkle", "--twin-params", "w"], &["worn"]),
        (&["etude", "perform", "twinkle", "--twin-params", "ra"], &["random:"]),
        (&["etude", "train", "twinkle", "--config", "etu"], &["etude.bash"]),
        // Nothing of our own: bash then completes files.
        (&["etude", "play", "sho"], &[]),
    ];
    for (words, offered) in cases {
        assert_eq!(completed(&sandbox, words), *offered, "{words:?}");
    }
    assert!(sandbox.bytes("etude.bash").windows(20).any(|part| part == b"bashdefault -o defau"));
    for shell in ["zsh", "fish"] {
        assert!(sandbox.ok(&format!("completions {shell}")).contains("rehearse"), "{shell}");
    }
    // What may be a file is completed as one where a shell would offer the names alone.
    assert!(
        sandbox.ok("completions zsh").contains("A built-in id (see `etude songs`) or a MIDI file:_files")
    );
}

#[test]
fn every_command_has_a_manual_page() {
    let sandbox = Sandbox::new();
    sandbox.ok("man -o pages/man1");
    let page = |name: &str| String::from_utf8(sandbox.bytes(format!("pages/man1/{name}.1"))).unwrap();
    for name in ["etude", "etude-play", "etude-robot-check", "etude-songs-show", "etude-man"] {
        assert!(page(name).contains(".TH"), "{name}");
    }
    assert!(!sandbox.path("pages/man1/etude-robot-guard.1").exists(), "it is not for people");
    // Every macro is one of man(7): a line that begins with a dot by accident would vanish.
    let known = [".ie", ".el", ".TH", ".SH", ".SS", ".TP", ".PP", ".RS", ".RE", ".br", ".IP", ".B", ".sp"];
    for entry in std::fs::read_dir(sandbox.path("pages/man1")).unwrap() {
        let text = std::fs::read_to_string(entry.unwrap().path()).unwrap();
        let mut macros = text.lines().filter(|line| line.starts_with('.'));
        let wrong = macros.find(|line| !known.contains(&line.split(' ').next().unwrap()));
        assert_eq!(wrong, None);
    }
    if let Ok(output) = Command::new("groff")
        .args(["-Kutf8", "-man", "-Tutf8", "-ww"])
        .arg(sandbox.path("pages/man1/etude-play.1"))
        .output()
    {
        let said = errors(&output);
        assert!(output.status.success() && said.is_empty(), "{said}");
        assert!(String::from_utf8_lossy(&output.stdout).contains("--policy"));
    }
}
