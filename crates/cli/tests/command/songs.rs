//! `etude songs`.

use std::process::Command;

use etude_music::{Note, Song};

use crate::{Sandbox, TINY, csv, errors, root, succeed};

#[test]
fn all_seven_are_listed_with_the_papers_lengths() {
    let sandbox = Sandbox::new();
    let text = sandbox.ok("songs");
    let list = sandbox.json("songs --json");
    let found: Vec<(&str, u64)> = list
        .as_array()
        .unwrap()
        .iter()
        .map(|s| (s["id"].as_str().unwrap(), s["frames"].as_u64().unwrap()))
        .collect();
    let expected = [
        ("are-you-sleeping", 661),
        ("happy-birthday", 501),
        ("ode-to-joy", 661),
        ("twinkle", 181),
        ("c-major-scale", 231),
        ("d-major-scale", 231),
        ("chord-progression", 181),
    ];
    assert_eq!(found, expected);
    for (id, frames) in expected {
        assert!(
            text.lines().any(|l| l.starts_with(id) && l.contains(&frames.to_string())),
            "{id} in\n{text}"
        );
    }
    for song in list.as_array().unwrap() {
        assert!(["title", "notes", "secs", "policy"].iter().all(|key| !song[key].is_null()), "{song}");
    }
}

#[test]
fn a_song_is_shown_and_its_frames_are_written() {
    let sandbox = Sandbox::new();
    let text = sandbox.ok("songs show twinkle --frames f.csv");
    assert!(text.contains("Twinkle") && text.contains("bar   1"), "{text}");
    let rows = csv(&sandbox.bytes("f.csv"));
    assert_eq!(rows[0], ["step", "due"]);
    assert_eq!(rows.len(), 1 + 181);
    assert!(rows[1..].iter().enumerate().all(|(step, row)| row[0] == step.to_string() && row.len() == 2));
    // One second of silence, then middle C.
    assert!(rows[1..21].iter().all(|row| row[1].is_empty()));
    assert_eq!(rows[21][1], "60");

    // Another configuration plans other frames.
    sandbox.ok("songs show twinkle --frames p.csv --preset paper");
    let papers = csv(&sandbox.bytes("p.csv"));
    assert_eq!(papers.len(), rows.len());
    assert_ne!(papers, rows, "RoboPianist's rule is another");
    let text = sandbox.ok("songs show twinkle --set task.initial_silence_secs=0");
    assert!(text.contains(" 161 frames with 0 s of silence first"), "{text}");

    // Keys that are struck together, and how many beats they last.
    let chords = sandbox.ok("songs show chord-progression");
    assert!(chords.contains("  bar   2  F4+A4+C5 4\n"), "{chords}");

    let shown = sandbox.json("songs show short.mid --json --reference short.wav");
    assert!(
        sandbox.bytes("short.wav").starts_with(b"RIFF")
            && sandbox.bytes("short.wav").iter().any(|byte| *byte > 1)
    );
    let bars = shown["bars"].as_array().unwrap();
    assert_eq!((&bars[0]["bar"], &bars[0]["secs"]), (&1.into(), &0.0.into()));
    assert_eq!(bars[0]["chords"], serde_json::json!(["C4 0.6", "D4 0.6", "E4 0.6"]));
    assert_eq!((&shown["notes"], &shown["lowest"], &shown["highest"]), (&3.into(), &60.into(), &64.into()));
    assert!(
        shown["frames"].as_u64().unwrap() > 30 && shown["warnings"].is_array() && shown["secs"].is_number()
    );
}

#[test]
fn notes_that_the_hand_cannot_play_as_written_are_named_with_their_place() {
    let sandbox = Sandbox::new();
    let text = sandbox.ok("songs show d-major-scale");
    assert!(text.contains("With three fingers: 15 notes, ") && text.contains("s shorter: "), "{text}");
    let shown = sandbox.json("songs show d-major-scale --json");
    let limits = shown["fingering"]["limits"].as_array().unwrap();
    assert!(!limits.is_empty());
    let song = etude_music::repertoire::get("d-major-scale").unwrap();
    for limit in limits {
        let (secs, bar) = (limit["secs"].as_f64().unwrap(), limit["bar"].as_u64().unwrap());
        let note = song.notes().iter().find(|note| (note.start_secs - secs).abs() < 1e-9);
        let note = note.unwrap_or_else(|| panic!("no note begins there: {limit}"));
        assert_eq!(limit["note"], etude_music::pitch_name(note.pitch));
        assert_eq!(bar, u64::from(song.position(note.start_secs).bar));
    }
}

/// Writes notes (start, length, pitch) as a song.
fn write(sandbox: &Sandbox, name: &str, notes: impl IntoIterator<Item = (f64, f64, u8)>) {
    let note =
        |(start_secs, secs, pitch)| Note { pitch, start_secs, end_secs: start_secs + secs, velocity: 80 };
    let notes: Vec<Note> = notes.into_iter().map(note).collect();
    let secs = notes.iter().map(|note| note.end_secs).fold(0.0, f64::max);
    Song::new("Song", notes, secs).unwrap().save(sandbox.path(name)).unwrap();
}

#[test]
fn what_is_too_fast_for_the_hand_is_named_with_its_place() {
    let sandbox = Sandbox::new();
    // Three octaves up and back within half a second, in the second bar.
    write(
        &sandbox,
        "leap.mid",
        [(0.0, 1.9, 48), (2.0, 0.4, 50), (2.5, 0.2, 84), (2.75, 1.0, 50), (3.75, 0.25, 52)],
    );
    let text = sandbox.ok("songs show leap.mid");
    let place = "bar 2, beat 2 (2.50 s)";
    assert!(
        text.contains("1.2 notes a second; at most 3 in one, from bar 2, beat 1 (2.00 s) on\n"),
        "{text}"
    );
    assert!(
        text.contains(&format!("Omitted or shortened because of leaps: 1, the first at {place}\n")),
        "{text}"
    );
    assert!(
        text.contains(&format!("{place}: C6 is omitted: ")) && text.contains(" mm from D3, too far"),
        "{text}"
    );
    let shown = sandbox.json("songs show leap.mid --json");
    assert_eq!(shown["busiest_second"]["notes"], 3);
    assert_eq!(shown["fingering"]["limits"][0]["leap"], true);

    // Where the fingers need more time than the rail, there is no leap.
    let text = sandbox.ok("songs show chord-progression --set task.change_steps=3");
    assert!(text.contains("11 notes, ") && !text.contains("Leaps"), "{text}");
}

/// Repeats that are quicker than control steps are one stroke; the notes are counted all the same.
#[test]
fn the_counts_of_a_song_agree() {
    let sandbox = Sandbox::new();
    write(&sandbox, "quick.mid", (0..40).map(|index| (0.04 * f64::from(index), 0.035, 60)));
    let text = sandbox.ok("songs show quick.mid");
    assert!(text.contains("\n40 notes from C4 to C4, "), "{text}");
    assert!(
        text.contains("With three fingers: 40 notes, ")
            && text.contains(" too soon after one of the same key")
    );
    let warnings = sandbox.json("songs show quick.mid --json")["warnings"].as_array().unwrap().len();
    let printed = text.lines().filter(|line| line.starts_with("warning: ")).count();
    assert!(
        printed == 12 && text.contains(&format!("  … and {} more: --json has all", warnings - 12)),
        "{text}"
    );
}

/// Writes a song whose fingering takes seconds to plan.
pub fn write_slow(sandbox: &Sandbox, name: &str) {
    let chord = |index: u8| [0, 3, 6, 9, 13].map(|up| (0.4 * f64::from(index), 0.3, 48 + index % 8 + up));
    write(sandbox, name, (0..50).flat_map(chord));
}

#[test]
fn planning_that_takes_long_says_how_far_it_is() {
    let sandbox = Sandbox::new();
    write_slow(&sandbox, "chords.mid");
    let train = TINY.iter().map(|set| format!(" --set {set}")).collect::<String>();
    for verb in [
        "songs show chords.mid",
        "play chords.mid --scripted",
        &format!("train chords.mid{train}"),
        "evaluate chords.mid --worlds 1",
        // What is learned in so short a time may push until the twin is stopped.
        "perform chords.mid",
    ] {
        let output = sandbox.command(verb).output().unwrap();
        assert!(output.status.success() || verb.starts_with("perform"), "{verb}: {}", errors(&output));
        assert!(errors(&output).contains("planning the fingering, "), "{verb}: {}", errors(&output));
    }
    let output = sandbox.command("songs show chords.mid --json").output().unwrap();
    assert_eq!(errors(&output), "");
}

#[test]
fn a_song_that_does_not_fit_is_arranged() {
    let sandbox = Sandbox::new();
    sandbox.write_song("high.mid", [84, 86, 91]);
    let refused = |args: &str| {
        let output = sandbox.command(args).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{args}");
        errors(&output)
    };
    let advice = refused("songs show high.mid");
    assert!(
        advice.contains("-12 keeps its key: `etude songs arrange FILE.mid --transpose -12 -o NEW.mid`"),
        "{advice}"
    );
    let shown = sandbox.command("songs show high.mid").output().unwrap();
    let shown = String::from_utf8(shown.stdout).unwrap();
    assert!(shown.contains("3 notes from C6 to G6") && !shown.contains("frames"), "{shown}");
    write(&sandbox, "two-hands.mid", [(0.0, 2.0, 48), (0.0, 0.9, 72), (1.0, 0.9, 74)]);
    sandbox.ok("songs arrange two-hands.mid --melody -o melody.mid");
    let melody = sandbox.json("songs show melody.mid --json");
    assert_eq!((&melody["notes"], &melody["lowest"]), (&2.into(), &72.into()));
    // Two octaves up and down are too far for the time, and more than an octave together too wide.
    // Of what would fit it shows how to write it, and that holds.
    write(&sandbox, "leaps.mid", (0..6).map(|index: u8| (0.4 * f64::from(index), 0.35, 48 + index % 2 * 24)));
    write(&sandbox, "wide.mid", (0..8).map(|index: u8| (f64::from(index / 2), 0.9, 52 + index % 2 * 20)));
    for (song, option) in [("leaps.mid", "--stretch"), ("wide.mid", "--melody")] {
        let shown = sandbox.json(&format!("songs show {song} --json"));
        let easier = &shown["easier"];
        assert_eq!(easier["left_out"], 0, "{song}: {easier}");
        let said = sandbox.ok(&format!("songs show {song}"));
        let command = said.split("Arranged by `etude ").nth(1).and_then(|rest| rest.split('`').next());
        let command = command.unwrap_or_else(|| panic!("{said}"));
        assert!(command.contains(option), "{command}");
        sandbox.ok(command);
        let arranged = sandbox.json("songs show easier.mid --json");
        assert_eq!(arranged["notes"], easier["notes"]);
        assert_eq!(arranged["zero_shot"]["notes_right"], arranged["notes"], "{arranged}");
        assert!(arranged["easier"].is_null(), "there is nothing to gain");
        std::fs::remove_file(sandbox.path("easier.mid")).unwrap();
    }
    let said = sandbox.ok("songs arrange high.mid --transpose -12 --stretch 2 -o low.mid");
    assert!(said.contains("etude train low.mid"), "{said}");
    let (high, low) =
        (sandbox.json("songs show short.mid --json"), sandbox.json("songs show low.mid --json"));
    assert_eq!((&low["notes"], &low["lowest"], &low["highest"]), (&3.into(), &72.into(), &79.into()));
    let ratio = low["secs"].as_f64().unwrap() / high["secs"].as_f64().unwrap();
    assert!((ratio - 2.0).abs() < 0.02, "{ratio}");

    for (arguments, said) in [
        ("songs arrange high.mid -o new.mid", "outside the keyboard"),
        ("songs arrange high.mid --transpose -200 -o new.mid", "transpose by less"),
        ("songs arrange low.mid --stretch 0 -o new.mid", "stretch"),
        ("songs arrange low.mid --transpose 1 -o ./low.mid", "another name with -o"),
        ("songs arrange low.mid --transpose 1 -o nowhere/new.mid", "nowhere"),
        ("songs arrange low.mid --transpose 1 -o new.wav", "must end in .mid"),
        ("songs make --part test --seed 18446744073709551615 -o new.mid", "no melody of this part"),
    ] {
        let error = refused(arguments);
        assert!(error.contains(said), "{arguments}: {error}");
        assert!(!sandbox.path("new.mid").exists());
    }
    assert_eq!(sandbox.json("songs show low.mid --json"), low, "refused, and left as it was");
}

#[test]
fn what_a_file_holds_and_is_not_played_is_said() {
    let sandbox = Sandbox::new();
    let case = |name: &str| root().join("crates/music/tests/golden/cases").join(name).display().to_string();
    let shown = sandbox.ok(&format!("songs show {}", case("left-hand-on-channel-10.mid")));
    assert!(shown.contains("note: 4 strokes on channel 10"), "{shown}");
    let silent = case("a-minute-of-silence.mid");
    let shown = sandbox.json(&format!("songs show {silent} --json"));
    assert_eq!(shown["secs"], 2.0, "{shown}");
    assert!(shown["remarks"][0].as_str().unwrap().starts_with("60.0 s of silence"), "{shown}");
    let kept = sandbox.json(&format!("songs show {silent} --keep-silence --json"));
    assert_eq!((&kept["secs"], &kept["remarks"]), (&62.0.into(), &serde_json::json!([])));
    // A training learns the notes, not the silence.
    assert!(succeed(sandbox.tiny(&format!("{silent} -o run"))).contains("Finished"));
    assert_eq!(sandbox.json("songs show run/song.mid --json")["secs"], 2.0);
}

#[test]
fn notes_that_the_keyboard_does_not_have_are_left_out_on_request() {
    let sandbox = Sandbox::new();
    write(&sandbox, "wide.mid", [(0.0, 0.4, 30), (0.5, 0.4, 60), (1.0, 0.4, 62), (1.5, 0.4, 100)]);
    let output = sandbox.command("songs show wide.mid").output().unwrap();
    let advice = errors(&output);
    assert!(advice.contains("`etude songs arrange FILE.mid --within-range -o NEW.mid`"), "{advice}");
    sandbox.ok("songs arrange wide.mid --within-range -o inside.mid");
    assert_eq!(sandbox.json("songs show inside.mid --json")["notes"], 2);
}

/// Names without Latin letters: each song has folders, a run and a model of its own.
#[test]
fn names_of_every_script_are_kept_apart() {
    let sandbox = Sandbox::new();
    let names = ["月光", "春", "Für Elise", "für elise"];
    for (index, name) in names.iter().enumerate() {
        sandbox.write_song(&format!("{name}.mid"), [60 + index as u8, 62, 64]);
    }
    let run = |args: &[&str]| {
        let mut command = sandbox.command("");
        command.args(args);
        succeed(command)
    };
    let sets: Vec<&str> = TINY.iter().flat_map(|set| ["--set", set]).collect();
    for name in names {
        let file = format!("{name}.mid");
        run(&["play", &file, "--scripted"]);
        run(&[&["train", file.as_str()], sets.as_slice()].concat());
        run(&["export", "onnx", &file]);
    }
    for folder in ["out", "runs"] {
        let made: Vec<_> = std::fs::read_dir(sandbox.path(folder)).unwrap().collect();
        assert_eq!(made.len(), names.len(), "{folder}: {made:?}");
    }
    assert!(sandbox.path("月光.onnx").is_file() && sandbox.path("runs/春__fast__0").is_dir());
}

/// Songs of one name in two folders: each has folders of its own, and a note says so of the second.
#[test]
fn songs_of_one_name_in_two_folders_share_none() {
    let sandbox = Sandbox::new();
    for (folder, pitches) in [("a", [60, 62, 64]), ("b", [64, 62, 60])] {
        std::fs::create_dir(sandbox.path(folder)).unwrap();
        sandbox.write_song(&format!("{folder}/tune.mid"), pitches);
    }
    let said = |command: &mut Command| {
        let output = command.output().unwrap();
        assert!(output.status.success(), "{command:?}: {}", errors(&output));
        errors(&output)
    };
    let other = "is of another song of this name: that of this one is";
    for (verb, folder) in [
        ("play --scripted", "out/tune-scripted"),
        ("perform --scripted --mode real", "out/tune-scripted-real"),
        ("evaluate --scripted --worlds 2", "out/tune-scripted-worlds"),
    ] {
        for (song, own) in [("a", folder.to_string()), ("b", format!("{folder}-2"))] {
            for number in [1, 2] {
                let told = said(&mut sandbox.command(&format!("{verb} {song}/tune.mid")));
                assert_eq!(told.contains(&format!("{folder} {other} {own}")), song == "b", "{told}");
                let kept = Song::load(sandbox.path(format!("{own}/{number}/song.mid"))).unwrap();
                assert!(
                    kept.has_the_notes_of(&Song::load(sandbox.path(format!("{song}/tune.mid"))).unwrap())
                );
            }
        }
    }
    let trained = ["a", "b"].map(|song| said(&mut sandbox.tiny(&format!("{song}/tune.mid"))));
    assert!(!trained[0].contains(other) && trained[1].contains("runs/tune__fast__0-2"), "{trained:?}");
    let again = sandbox.tiny("b/tune.mid").output().unwrap();
    let resume = "etude train --resume runs/tune__fast__0-2";
    assert!(errors(&again).contains(resume), "{}", errors(&again));
    // Each is played by what has learned it.
    for (song, run) in [("a", "tune__fast__0/"), ("b", "tune__fast__0-2/")] {
        let model =
            sandbox.json(&format!("export onnx {song}/tune.mid --policy runs/{run} -o {song}.onnx --json"));
        assert!(model["policy"].as_str().unwrap().contains(run), "{model}");
    }
}
