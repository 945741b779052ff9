//! `etude songs`.

use crate::{Desk, csv, errors};

#[test]
fn all_seven_are_listed_with_the_papers_lengths() {
    let desk = Desk::new();
    let text = desk.ok("songs");
    let list = desk.json("songs --json");
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
    let desk = Desk::new();
    let text = desk.ok("songs show twinkle --frames f.csv");
    assert!(text.contains("Twinkle") && text.contains("bar   1"), "{text}");
    let rows = csv(&desk.bytes("f.csv"));
    assert_eq!(rows[0], ["step", "due"]);
    assert_eq!(rows.len(), 1 + 181);
    assert!(rows[1..].iter().enumerate().all(|(step, row)| row[0] == step.to_string() && row.len() == 2));
    // One second of silence, then middle C.
    assert!(rows[1..21].iter().all(|row| row[1].is_empty()));
    assert_eq!(rows[21][1], "60");

    // Keys that are struck together, and how many beats they last.
    let chords = desk.ok("songs show chord-progression");
    assert!(chords.contains("  bar   2  F4+A4+C5 4\n"), "{chords}");

    let shown = desk.json("songs show short.mid --json");
    assert_eq!((&shown["notes"], &shown["lowest"], &shown["highest"]), (&3.into(), &60.into(), &64.into()));
    assert!(
        shown["frames"].as_u64().unwrap() > 30 && shown["warnings"].is_array() && shown["secs"].is_number()
    );
}

#[test]
fn notes_that_the_hand_cannot_play_as_written_are_named_with_their_place() {
    let desk = Desk::new();
    let text = desk.ok("songs show d-major-scale");
    assert!(text.contains("With three fingers: 15 notes, ") && text.contains("ends 0."), "{text}");
    let shown = desk.json("songs show d-major-scale --json");
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

#[test]
fn a_song_that_does_not_fit_is_arranged() {
    let desk = Desk::new();
    desk.write_song("high.mid", [84, 86, 91]);
    let refused = |args: &str| {
        let output = desk.command(args).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{args}");
        errors(&output)
    };
    let advice = refused("songs show high.mid");
    assert!(advice.contains("-12 keeps its key: `etude songs arrange`"), "{advice}");
    let said = desk.ok("songs arrange high.mid --transpose -12 --stretch 2 -o low.mid");
    assert!(said.contains("etude train low.mid"), "{said}");
    let (high, low) = (desk.json("songs show short.mid --json"), desk.json("songs show low.mid --json"));
    assert_eq!((&low["notes"], &low["lowest"], &low["highest"]), (&3.into(), &72.into(), &79.into()));
    let ratio = low["secs"].as_f64().unwrap() / high["secs"].as_f64().unwrap();
    assert!((ratio - 2.0).abs() < 0.02, "{ratio}");

    for (arguments, said) in [
        ("songs arrange high.mid -o new.mid", "outside the keyboard"),
        ("songs arrange high.mid --transpose -200 -o new.mid", "transpose by less"),
        ("songs arrange low.mid --stretch 0 -o new.mid", "stretch"),
        ("songs arrange low.mid --transpose 1 -o ./low.mid", "another name with -o"),
        ("songs arrange low.mid --transpose 1 -o nowhere/new.mid", "nowhere"),
    ] {
        let error = refused(arguments);
        assert!(error.contains(said), "{arguments}: {error}");
        assert!(!desk.path("new.mid").exists());
    }
    assert_eq!(desk.json("songs show low.mid --json"), low, "refused, and left as it was");
}
