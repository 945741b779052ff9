//! `etude evaluate`: one policy in many worlds.

use std::process::Stdio;

use crate::{Sandbox, csv, errors, processes, succeed, wait_for};

#[test]
fn the_table_holds_what_the_summary_says() {
    let sandbox = Sandbox::new();
    succeed(sandbox.tiny("short.mid -o run --json"));
    let printed = sandbox.json("evaluate short.mid --policy run --worlds 12 --json -o table");
    assert_eq!((&printed["worlds"], &printed["csv"]), (&12.into(), &"table/1/worlds.csv".into()));
    let rows = csv(&sandbox.bytes("table/latest/worlds.csv"));
    let scores = [
        "world",
        "player",
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
    let mut f1: Vec<f64> = rows[1..].iter().map(|row| row[2].parse().unwrap()).collect();
    f1.sort_by(f64::total_cmp);
    let close =
        |which: &str, key: &str, value: f64| (printed[which][key].as_f64().unwrap() - value).abs() < 1e-12;
    assert!(close("mean", "f1", f1.iter().sum::<f64>() / 12.0), "{printed}");
    assert!(close("worst", "f1", f1[0]) && close("worst_decile", "f1", (f1[0] + f1[1]) / 2.0), "{printed}");
    let right: f64 = rows[1..].iter().map(|row| row[6].parse::<f64>().unwrap()).sum();
    assert!(close("mean", "notes_right", right / 12.0), "{printed}");
    assert!(close(
        "nominal",
        "f1",
        sandbox.json("play short.mid --policy run --json")["f1"].as_f64().unwrap()
    ));
    assert_eq!(printed["marginals"].as_array().unwrap().len(), 31);

    // Same worlds, same numbers, on any number of threads; and people get a summary.
    let mut again = sandbox.command("evaluate short.mid --policy run --worlds 12");
    again.env("RAYON_NUM_THREADS", "1");
    let text = succeed(again);
    assert!(text.contains("worst tenth") && text.contains("most influential"), "{text}");
    assert_eq!(sandbox.bytes("out/short-run-worlds/1/worlds.csv"), sandbox.bytes("table/latest/worlds.csv"));
    // A player that strikes its keys: another seed draws other worlds, which show.
    let seeded = |seed: u64| {
        let asked = format!("evaluate short.mid --scripted --worlds 12 --seed {seed} -o other --json");
        sandbox.json(&asked)["scores"].clone()
    };
    assert_ne!(seeded(0), seeded(1));
}

#[test]
fn no_table_is_replaced() {
    let sandbox = Sandbox::new();
    for (number, worlds) in [(1, 1), (2, 2)] {
        sandbox.ok(&format!("evaluate short.mid --scripted --worlds {worlds} -o tables"));
        assert_eq!(csv(&sandbox.bytes(format!("tables/{number}/worlds.csv"))).len(), worlds + 1);
    }
    assert_eq!(sandbox.bytes("tables/latest/worlds.csv"), sandbox.bytes("tables/2/worlds.csv"));
}

#[test]
fn an_interruption_ends_it_without_a_table() {
    let sandbox = Sandbox::new();
    let mut command = sandbox.command("evaluate short.mid --scripted --worlds 100000 -o tables");
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    wait_for("its handler is there", || processes::catches(child.id(), processes::INT));
    processes::signal(child.id(), "INT");
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
    assert!(output.stdout.is_empty() && !sandbox.path("tables").exists());
}
