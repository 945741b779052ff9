//! The five-minute tour of the README, command by command.

use std::process::Command;

use crate::{Desk, TINY, root};

/// The commands of the README's section, without their comments.
fn commands() -> Vec<String> {
    let readme = include_str!("../../../../README.md");
    let (_, rest) = readme.split_once("\n## Five minutes\n").unwrap();
    let (section, _) = rest.split_once("\n## ").unwrap();
    let blocks = section.split("```sh\n").skip(1).map(|block| block.split_once("```").unwrap().0);
    blocks
        .flat_map(str::lines)
        .map(|line| line.split('#').next().unwrap_or_default().trim().to_string())
        .filter(|line| line.starts_with("etude "))
        .collect()
}

/// Each runs as it stands, one after the other in one folder. Only the training is made short; what it learns in that time pushes at
/// the limits of the hand's torque until the twin is stopped, so the scripted player performs in its place.
#[test]
fn every_command_of_the_five_minute_tour_runs() {
    let desk = Desk::new();
    std::os::unix::fs::symlink(root().join("songs"), desk.path("songs")).unwrap();
    let commands = commands();
    assert!(commands.len() >= 8, "{commands:?}");
    for verb in ["train", "play", "replay", "perform", "watch", "gallery"] {
        assert!(commands.iter().any(|command| command.starts_with(&format!("etude {verb}"))), "no {verb}");
    }
    for command in commands {
        let mut words = command.split_whitespace().skip(1);
        let verb = words.next().unwrap();
        let mut etude = Command::new(assert_cmd::cargo::cargo_bin!("etude"));
        etude.current_dir(desk.path("")).arg(verb).args(words);
        if verb == "train" {
            etude.args(TINY.iter().flat_map(|set| ["--set", set]));
        }
        if verb == "perform" && command.contains(".mid") {
            etude.arg("--scripted");
        }
        crate::succeed(etude);
    }
    for made in ["out/twinkle/replay.html", "out/both.html", "out/gallery/index.html"] {
        assert!(desk.path(made).is_file(), "{made}");
    }
}
