//! `etude experiment`: plans, the local launcher, reports; the cluster is in `slurm`.

use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::processes::{self, children_of};
use crate::{Sandbox, TINY, errors, shipped};

/// An experiment of four short trials in the scratch folder.
pub const FOUR: &str = r#"
title = "Four short trials"
source = "a test"
songs = ["short.mid"]
seeds = 2
[[variants]]
name = "fences"
[[variants]]
name = "none"
set = ["task.stage.fences=false"]
[perform]
modes = ["real"]
runs = 1
[[figures]]
name = "scores"
title = "Scores"
kind = "bars"
x = "variant"
y = ["sim_f1", "f1"]
"#;

/// Files of the results of all trials in a folder of runs, by trial.
pub fn results(sandbox: &Sandbox, runs: &str) -> Vec<(String, Vec<u8>)> {
    let entries = std::fs::read_dir(sandbox.path(runs)).unwrap().map(|entry| entry.unwrap().path());
    let mut found: Vec<(String, Vec<u8>)> = entries
        .filter_map(|folder| {
            let bytes = std::fs::read(folder.join("result.json")).ok()?;
            Some((folder.file_name()?.to_string_lossy().into_owned(), bytes))
        })
        .collect();
    found.sort();
    found
}

/// The command with the settings of tiny trainings.
pub fn tiny(sandbox: &Sandbox, args: &str) -> Command {
    let mut command = sandbox.command(args);
    command.args(TINY.iter().flat_map(|set| ["--set", set]));
    command
}

fn done(mut command: Command) -> String {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{command:?}: {}", errors(&output));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
#[ignore = "takes minutes: `make test-heavy`, which .ci/run calls"]
fn every_experiment_of_the_paper_runs_by_its_one_command() {
    let sandbox = Sandbox::new();
    let listed = sandbox.json("experiment list --json");
    let of_paper = |row: &&serde_json::Value| row["source"].as_str().unwrap().starts_with("paper");
    let (papers, ours): (Vec<_>, Vec<_>) = listed.as_array().unwrap().iter().partition(of_paper);
    let [names, ours] =
        [papers, ours].map(|rows| rows.iter().map(|row| row["name"].as_str().unwrap()).collect::<Vec<_>>());
    for name in
        ["songs", "fences", "collision", "appendix-songs", "modes", "randomisation", "iterations", "paper"]
    {
        assert!(names.contains(&name), "{name} is missing among {names:?}");
    }
    // A plan checks the settings of its trainings.
    for name in ours {
        assert!(!sandbox.ok(&format!("experiment plan {name} --budget smoke")).is_empty(), "{name}");
    }
    let all = names.join(" ");
    let begun = Instant::now();
    sandbox.ok(&format!("experiment run {all} --budget smoke"));
    // It is printed and not asserted, since machines are busy.
    println!("the paper's experiments in {:.0} s", begun.elapsed().as_secs_f64());
    let report = format!("experiment report {all} --budget smoke -o report");
    sandbox.ok(&report);
    let page = sandbox.bytes("report/index.html");
    let text = String::from_utf8(page.clone()).unwrap();
    for name in names {
        assert!(text.contains(&format!("id=\"{name}\"")), "{name} is not on the page");
        let plan = sandbox.ok(&format!("experiment plan {name} --budget smoke"));
        let kept = sandbox.bytes(format!("report/{name}/results.jsonl"));
        assert_eq!(kept.iter().filter(|byte| **byte == b'\n').count(), plan.lines().count(), "{name}");
        let table = crate::csv(&sandbox.bytes(format!("report/{name}/results.csv")));
        assert!(table.len() > 1, "{name}");
    }
    assert!(sandbox.bytes("report/songs/songs.svg").starts_with(b"<svg"));
    assert!(text.contains("The paper’s numbers and ours") && text.contains("There is no robot here"));
    assert!(text.contains("etude experiment run songs --budget smoke"), "the page says how it was made");
    // What is done is not done again, and the report needs the runs no more.
    let again = sandbox.ok(&format!("experiment run {all} --budget smoke"));
    assert!(again.contains(" 0 failed"), "{again}");
    std::fs::remove_dir_all(sandbox.path("runs")).unwrap();
    sandbox.ok(&report);
    assert!(sandbox.bytes("report/index.html") == page, "the same page, made of what the first one kept");
}

#[test]
fn a_corpus_is_learned_and_its_best_policy_scored_on_the_validation_pieces() {
    let sandbox = Sandbox::new();
    let seeds = "sight-readers --seeds 1 --set corpus.validation_pieces=1";
    done(tiny(&sandbox, &format!("experiment run {seeds}")));
    done(tiny(&sandbox, &format!("experiment report {seeds} -o report")));
    let table = crate::csv(&sandbox.bytes("report/sight-readers/results.csv"));
    let trial = std::fs::read_dir(sandbox.path("runs"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .find(|path| path.file_name().unwrap().to_str().unwrap().starts_with("train__corpus__0__"))
        .unwrap();
    let metrics = std::fs::read_to_string(trial.join("training/metrics.jsonl")).unwrap();
    let rows = metrics.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    let overall = |row: &serde_json::Value| row["eval/overall"].as_f64();
    // Of equally good policies the first is kept.
    let best = rows
        .filter(|row| overall(row).is_some())
        .reduce(|best, row| if overall(&row) > overall(&best) { row } else { best })
        .unwrap();
    for name in ["f1", "precision", "recall", "onset_f1"] {
        let column = table[0].iter().position(|column| *column == format!("sim_{name}")).unwrap();
        let found: f64 = table[1][column].parse().unwrap();
        assert!(
            (found - best[format!("eval/{name}")].as_f64().unwrap()).abs() < 1e-5,
            "{name}: {found}, {best}"
        );
    }
    assert_ne!(best["eval/precision"], best["eval/recall"]);
}

#[test]
fn players_that_are_ready_play_songs_and_melodies_without_a_training() {
    let sandbox = Sandbox::new();
    sandbox.ok("experiment run sight-reading --budget smoke");
    sandbox.ok("experiment report sight-reading --budget smoke -o report");
    let table = crate::csv(&sandbox.bytes("report/sight-reading/results.csv"));
    let column = |name: &str| table[0].iter().position(|column| column == name).unwrap();
    let of = |row: &Vec<String>, name: &str| row[column(name)].clone();
    // A song, a validation melody, and a test melody, which is of four kinds, by two players.
    assert_eq!(table.len(), 1 + 2 * (1 + 1 + 4));
    for player in ["sight-reader", "scripted"] {
        let rows: Vec<_> = table[1..].iter().filter(|row| of(row, "player") == player).collect();
        let song = of(rows[0], "song");
        assert_eq!((song.as_str(), of(rows[0], "pieces").as_str()), ("are-you-sleeping", "songs"));
        let who = match player {
            "scripted" => "--scripted".to_string(),
            name => format!("--policy {}", shipped(name).display()),
        };
        let played = sandbox.json(&format!("play {song} {who} -o out --json"));
        let value = |name: &str| of(rows[0], name).parse::<f64>().unwrap();
        let (lead, lag) = (value("latency_compensation_secs"), value("lag_secs"));
        assert!(
            lead > 0.03 && lag.abs() < 0.02,
            "{player}: a run before has measured the lead: {lead}, {lag}"
        );
        let set = format!("--set task.plan.latency_compensation_secs={lead}");
        let performed = sandbox.json(&format!("perform {song} {who} {set} --robot twin -o twin --json"));
        for (name, expected) in [
            ("sim_f1", &played["f1"]),
            ("sim_onset_f1", &played["onset_f1"]),
            ("f1", &performed["robot_f1"]),
            ("onset_f1", &performed["onset_f1"]),
        ] {
            let found: f64 = of(rows[0], name).parse().unwrap();
            assert!(
                (found - expected.as_f64().unwrap()).abs() < 1e-5,
                "{player}: {name} {found}, {expected}"
            );
        }
        let kinds: Vec<String> = rows[1..].iter().map(|row| of(row, "pieces")).collect();
        assert!(kinds.len() == 5 && kinds[0] == "validation", "{kinds:?}");
        assert!(kinds[1..].iter().all(|kind| kind != "songs" && kind != "validation"), "{kinds:?}");
        assert!(rows[3..].iter().all(|row| of(row, "sim_f1") == of(rows[2], "sim_f1")), "played once");
    }
    let page = String::from_utf8(sandbox.bytes("report/index.html")).unwrap();
    assert!(
        page.contains("player\u{a0}scripted") && !page.contains("nothing done has these labels"),
        "{page}"
    );
    let text = "title = 'T'\nsource = 'S'\nsongs = ['twinkle']\nseeds = 1\n[play]\nplayers = ['nobody']\n";
    std::fs::write(sandbox.path("sight.toml"), text).unwrap();
    let said = errors(&sandbox.command("experiment plan sight.toml").output().unwrap());
    assert!(said.contains("player `nobody`"), "{said}");
}

#[test]
fn tasks_that_were_stopped_or_whose_launcher_was_killed_end_the_same() {
    let sandbox = Sandbox::new();
    std::fs::write(sandbox.path("four.toml"), FOUR).unwrap();
    done(tiny(&sandbox, "experiment run four.toml --runs-dir whole"));
    let whole = results(&sandbox, "whole");
    assert_eq!(whole.len(), 4);
    // Told to stop; the launcher killed; and launcher and workers killed.
    for (signal, workers_too) in [("INT", false), ("KILL", false), ("KILL", true)] {
        let runs = format!("stopped-{signal}-{workers_too}");
        let run = || tiny(&sandbox, &format!("experiment run four.toml --workers 1 --runs-dir {runs}"));
        let mut launcher = run().stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let first = sandbox.path(&runs).join(whole_first(&sandbox)).join("training/metrics.jsonl");
        let begun = Instant::now();
        while !first.exists() && begun.elapsed() < Duration::from_secs(120) {
            sleep(Duration::from_millis(5));
        }
        if workers_too {
            children_of(launcher.id()).into_iter().for_each(|worker| processes::signal(worker, "KILL"));
        }
        processes::signal(launcher.id(), signal);
        let code = launcher.wait().unwrap().code();
        assert_eq!(code, (signal == "INT").then_some(3));
        // Workers hear that the launcher is gone, save and end; what comes after would find them
        // busy before that.
        let begun = Instant::now();
        while sandbox.ok(&status(&runs)).contains("\"running\"") && begun.elapsed() < Duration::from_secs(60)
        {
            sleep(Duration::from_millis(50));
        }
        assert!(results(&sandbox, &runs).len() < 4, "it was stopped on its way");
        done(run());
        assert!(results(&sandbox, &runs) == whole, "{signal}");
    }
}

fn status(runs: &str) -> String {
    let sets: String = TINY.iter().map(|set| format!(" --set {set}")).collect();
    format!("experiment status four.toml --json --runs-dir {runs}{sets}")
}

/// The id of the plan's first trial.
fn whole_first(sandbox: &Sandbox) -> String {
    let plan = done(tiny(sandbox, "experiment plan four.toml"));
    let trial: serde_json::Value = serde_json::from_str(plan.lines().next().unwrap()).unwrap();
    trial["id"].as_str().unwrap().to_string()
}

#[test]
fn a_task_that_fails_is_told_with_its_reason_and_the_others_go_on() {
    let sandbox = Sandbox::new();
    std::fs::write(sandbox.path("four.toml"), FOUR).unwrap();
    let plan = done(tiny(&sandbox, "experiment plan four.toml"));
    let first: serde_json::Value = serde_json::from_str(plan.lines().next().unwrap()).unwrap();
    // Where the first trial's training would be, there is a file.
    let folder = sandbox.path("runs").join(first["id"].as_str().unwrap());
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("training"), "in the way").unwrap();
    let output = tiny(&sandbox, "experiment run four.toml").output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let said = errors(&output);
    assert!(said.contains(first["id"].as_str().unwrap()) && said.contains("training"), "{said}");
    assert_eq!(results(&sandbox, "runs").len(), 3);
    std::fs::remove_file(folder.join("training")).unwrap();
    done(tiny(&sandbox, "experiment run four.toml"));
    assert_eq!(results(&sandbox, "runs").len(), 4);
}

#[test]
fn the_experiment_that_the_documents_add_can_be_planned() {
    let sandbox = Sandbox::new();
    let text = include_str!("../../../../docs/experiments.md");
    let file = text.split("```toml\n").nth(1).unwrap().split("```").next().unwrap();
    std::fs::write(sandbox.path("rail-speed.toml"), file).unwrap();
    let plan = sandbox.ok("experiment plan rail-speed.toml");
    assert_eq!(plan.lines().count(), 2 * 3 * 3);
    assert!(plan.contains(r#""acceleration_limit":"3.75""#), "{plan}");
}

#[test]
fn mistakes_are_told_before_anything_is_done() {
    let sandbox = Sandbox::new();
    std::fs::write(sandbox.path("four.toml"), FOUR).unwrap();
    std::fs::write(sandbox.path("bad.toml"), FOUR.replace("kind = \"bars\"", "kind = \"pie\"")).unwrap();
    std::fs::write(sandbox.path("other.toml"), FOUR.replace("short.mid", "long.mid")).unwrap();
    std::fs::write(sandbox.path("torn.toml"), "title = \"Torn\"\nsongs = [\n").unwrap();
    // The results of earlier reports cannot be read.
    std::fs::create_dir_all(sandbox.path("report/four/results.jsonl")).unwrap();
    for (args, said) in [
        ("experiment run sings", "songs"),
        ("experiment run bad.toml", "figures[0].kind"),
        ("experiment run other.toml", "long.mid"),
        ("experiment run four.toml --set trainer.sead=3", "sead"),
        ("experiment run four.toml --set trainer.seed=3", "--seeds"),
        ("experiment run four.toml --set task.reward.colision=0", "colision"),
        ("experiment run four.toml --throttle 2", "--launcher slurm"),
        ("experiment run torn.toml", "experiment torn: line 2: "),
        ("experiment run four.toml --launcher slurm --workers 2", "--throttle"),
        ("experiment run four.toml --budget huge", "full, smoke"),
        ("experiment report four.toml", "etude experiment run four"),
        ("experiment report four.toml -o report", "cannot read report/four/results.jsonl"),
        ("experiment trial nowhere.jsonl 0", "nowhere.jsonl"),
    ] {
        let output = sandbox.command(args).output().unwrap();
        assert!(!output.status.success(), "{args}");
        assert!(errors(&output).contains(said), "{args}: {}", errors(&output));
    }
    let said = sandbox.ok("experiment run four.toml --dry-run");
    assert!(said.starts_with("4 trials to do: ") && said.contains(" of one core, "), "{said}");
    assert!(!sandbox.path("runs").exists());
    let script = sandbox
        .ok("experiment run four.toml --launcher slurm --dry-run --throttle 2 --sbatch=--partition=short");
    assert!(
        script.contains("#SBATCH --array=0-3%2") && script.contains("#SBATCH --partition=short"),
        "{script}"
    );
    assert_eq!(
        sandbox
            .command("experiment run four.toml --launcher slurm")
            .env("PATH", "")
            .output()
            .unwrap()
            .status
            .code(),
        Some(1)
    );
}
