//! `etude evaluate`: one policy in many worlds.

use std::process::{Command, Stdio};
use std::time::Duration;

use crate::{Desk, csv, errors, succeed};

#[test]
fn the_table_holds_what_the_summary_says() {
    let desk = Desk::new();
    succeed(desk.tiny("short.mid -o run --json"));
    let printed = desk.json("evaluate short.mid --policy run --worlds 12 --json -o table/worlds.csv");
    assert_eq!((&printed["worlds"], &printed["csv"]), (&12.into(), &"table/worlds.csv".into()));
    let rows = csv(&desk.bytes("table/worlds.csv"));
    let scores = [
        "world",
        "f1",
        "precision",
        "recall",
        "pooled_f1",
        "notes_right",
        "notes_wrong",
        "onset_f1",
        "collision_free",
    ];
    assert_eq!((rows.len(), &rows[0][..scores.len()]), (13, scores.map(String::from).as_slice()));
    // The paper's quantities: five of the world, two of each of thirteen joints.
    assert_eq!(rows[0].len(), scores.len() + 5 + 26);
    let mut f1: Vec<f64> = rows[1..].iter().map(|row| row[1].parse().unwrap()).collect();
    f1.sort_by(f64::total_cmp);
    let close = |key: &str, value: f64| (printed[key].as_f64().unwrap() - value).abs() < 1e-12;
    assert!(close("mean_f1", f1.iter().sum::<f64>() / 12.0), "{printed}");
    assert!(close("worst_f1", f1[0]) && close("worst_decile_f1", (f1[0] + f1[1]) / 2.0), "{printed}");
    let right: f64 = rows[1..].iter().map(|row| row[5].parse::<f64>().unwrap()).sum();
    assert!(close("mean_notes_right", right / 12.0), "{printed}");
    assert!(close("nominal_f1", desk.json("play short.mid --policy run --json")["f1"].as_f64().unwrap()));
    assert_eq!(printed["marginals"].as_array().unwrap().len(), 31);

    // Same worlds, same numbers, on any number of threads; and people get a summary.
    let mut again = desk.command("evaluate short.mid --policy run --worlds 12");
    again.env("RAYON_NUM_THREADS", "1");
    let text = succeed(again);
    assert!(text.contains("worst tenth") && text.contains("what matters most"), "{text}");
    assert_eq!(desk.bytes("out/short-run/worlds.csv"), desk.bytes("table/worlds.csv"));
    // A player that strikes its keys: another seed draws other worlds, which show.
    let seeded = |seed: u64| {
        let asked = format!("evaluate short.mid --scripted --worlds 12 --seed {seed} -o other.csv --json");
        desk.json(&asked)["scores"].clone()
    };
    assert_ne!(seeded(0), seeded(1));
}

#[test]
fn an_interruption_ends_it_without_a_table() {
    let desk = Desk::new();
    let mut command = desk.command("evaluate short.mid --scripted --worlds 100000 -o worlds.csv");
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // The handler is there before the first world is; a signal before that ends it too, with another code.
    std::thread::sleep(Duration::from_millis(500));
    let sent = Command::new("sh").arg("-c").arg(format!("kill -INT {}", child.id())).status().unwrap();
    assert!(sent.success());
    let output = child.wait_with_output().unwrap();
    assert!(matches!(output.status.code(), Some(3) | None), "{:?}: {}", output.status, errors(&output));
    assert!(output.stdout.is_empty() && !desk.path("worlds.csv").exists());
}
