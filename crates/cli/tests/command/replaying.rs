//! `etude replay`, `compare` and `gallery`: pages of recordings.

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::Value;

use crate::browser::{all_pass, browser_tests};
use crate::{Sandbox, csv, errors, succeed};

/// The data of a replay page.
fn data(page: &[u8]) -> Value {
    let page = std::str::from_utf8(page).unwrap();
    let (_, rest) = page.split_once("<script type=\"application/json\" id=\"data\">").unwrap();
    serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
}

/// A sandbox with `out/1/recording.mcap`, the scripted baseline's performance of `short.mid`.
pub fn played() -> Sandbox {
    let sandbox = Sandbox::new();
    sandbox.ok("play short.mid --scripted -o out");
    sandbox
}

/// The command fails, and its message has this part.
fn refuses(sandbox: &Sandbox, args: &str, part: &str) {
    let output = sandbox.command(args).output().unwrap();
    let said = errors(&output);
    assert!(output.status.code() == Some(1) && said.contains(part), "{args}: {said}");
}

#[test]
fn a_page_holds_what_was_recorded() {
    let sandbox = played();
    let printed = sandbox.json("replay out --json");
    let page = sandbox.bytes("out/1/replay.html");
    assert_eq!(printed["bytes"], page.len());
    assert!(page.len() < 4_000_000, "{} bytes", page.len());
    let data = data(&page);
    let take = &data["takes"][0];
    let rows = csv(&sandbox.bytes("out/1/frames.csv"));
    let pitches = |text: &str| -> Vec<u64> { text.split_whitespace().map(|p| p.parse().unwrap()).collect() };
    for (step, row) in rows[1..].iter().enumerate() {
        let of = |list: &str| -> Vec<u64> {
            take[list][step].as_array().unwrap().iter().map(|pitch| pitch.as_u64().unwrap()).collect()
        };
        assert_eq!((of("due"), of("pressed")), (pitches(&row[1]), pitches(&row[2])), "step {step}");
    }
    assert_eq!(take["positions"].as_array().unwrap().len(), rows.len() - 1);
    let report: Value = serde_json::from_slice(&sandbox.bytes("out/1/report.json")).unwrap();
    let f1 = report["f1"].as_f64().unwrap();
    assert!((take["final"]["f1"].as_f64().unwrap() - f1).abs() < 1e-12);
    assert!((take["running"]["f1"].as_array().unwrap().last().unwrap().as_f64().unwrap() - f1).abs() < 1e-4);
    // The terms add up to what the performance earned.
    let terms = take["rewards"].as_array().unwrap();
    let names: BTreeSet<&str> = terms.iter().map(|term| term["name"].as_str().unwrap()).collect();
    assert_eq!(names, BTreeSet::from(["action_change", "collision", "energy", "key_press", "wrong_travel"]));
    let values = terms.iter().flat_map(|term| term["values"].as_array().unwrap());
    let sum: f64 = values.map(|value| value.as_f64().unwrap()).sum();
    assert!((sum - report["reward"].as_f64().unwrap()).abs() < 0.01, "{sum}");
    assert!(take["bar_secs"].as_array().is_some_and(|bars| !bars.is_empty()));
    assert!(take["incomplete"].is_null());
}

/// Pitches that sound so long after the end of a control step, by the notes of the page.
fn heard(take: &Value, step: usize, late_secs: f64) -> Value {
    let secs = (step + 1) as f64 / 20.0 + late_secs;
    let notes = take["notes"].as_array().unwrap().iter();
    let sounds = |note: &&Value| note["start"].as_f64() <= Some(secs) && note["end"].as_f64() > Some(secs);
    let mut pitches: Vec<u64> = notes.filter(sounds).map(|note| note["pitch"].as_u64().unwrap()).collect();
    pitches.sort_unstable();
    pitches.into()
}

#[test]
fn simulation_and_twin_stand_side_by_side_with_the_moments_where_they_part() {
    let sandbox = played();
    // The same lead in both, so that they can be compared step by step.
    sandbox
        .ok("perform short.mid --scripted --robot twin --mode real --set task.plan.latency_compensation_secs=0.025 -o twin");
    let notes = |args: &str| errors(&sandbox.command(args).output().unwrap());
    assert_eq!(notes("replay out twin -o both.html"), "");
    // With a lead a robot is heard later; the piece is still the same, and so is its F1 on the
    // page.
    sandbox.ok("perform short.mid --scripted --robot twin --mode real --set task.plan.latency_compensation_secs=0.11 -o led");
    assert_eq!(notes("replay led out -o led.html"), "");
    let led = self::data(&sandbox.bytes("led.html"));
    assert_eq!(led["takes"][0]["due"], led["takes"][1]["due"]);
    let report: Value = serde_json::from_slice(&sandbox.bytes("led/1/report.json")).unwrap();
    let f1 = led["takes"][0]["final"]["f1"].as_f64().unwrap();
    assert!((f1 - report["robot_f1"].as_f64().unwrap()).abs() < 1e-9, "{f1}");
    // They part where other keys are heard, and nowhere else at both ends: 0.11 s − 25 ms after the
    // end of each control step, which is 25 ms before it on the axis of the notes.
    let apart: Vec<[f64; 2]> = serde_json::from_value(led["differences"].clone()).unwrap();
    let parts = |step: usize| heard(&led["takes"][0], step, -0.025) != led["takes"][1]["pressed"][step];
    for step in 0..led["takes"][0]["due"].as_array().unwrap().len() {
        let middle = (step as f64 + 0.5) / 20.0 - 0.025;
        assert!(!parts(step) || apart.iter().any(|[from, to]| (*from..*to).contains(&middle)), "step {step}");
    }
    assert!(!apart.is_empty(), "where they part");
    for edge in apart.iter().flat_map(|[from, to]| [*from, *to - 0.05]) {
        assert!(parts(((edge + 0.025) * 20.0).round() as usize), "at {edge} s");
    }
    sandbox.write_song("other.mid", [64, 62, 60]);
    sandbox.ok("play other.mid --scripted -o other");
    assert!(notes("replay out other -o others.html").contains("of the same notes"));
    let data = data(&sandbox.bytes("both.html"));
    let [simulation, twin] = [&data["takes"][0], &data["takes"][1]];
    assert_eq!(
        (&simulation["rig"], &twin["rig"], &twin["mode"]),
        (&"simulation".into(), &"twin (standard)".into(), &"real".into())
    );
    let apart: Vec<[f64; 2]> = serde_json::from_value(data["differences"].clone()).unwrap();
    let pressed = |take: &Value, step: usize| take["pressed"][step].clone();
    for step in 0..simulation["due"].as_array().unwrap().len() {
        let middle = (step as f64 + 0.5) / 20.0 - 0.025;
        let told = apart.iter().any(|[from, to]| (*from..*to).contains(&middle));
        assert!(told || pressed(simulation, step) == pressed(twin, step), "step {step}");
    }
    // Nowhere do they agree for more than a moment within one of them.
    for [from, to] in &apart {
        let [begin, end] = [from, to].map(|secs| ((secs + 0.025) * 20.0).round() as usize);
        let steps = begin..end;
        let differ: Vec<bool> = steps.map(|step| pressed(simulation, step) != pressed(twin, step)).collect();
        assert!(
            differ[0] && differ[differ.len() - 1] && differ.windows(3).all(|three| three.contains(&true))
        );
    }
    assert!(twin["rewards"].as_array().is_some_and(|terms| terms.iter().any(|t| t["name"] == "key_press")));
    assert!(twin["rewards_note"].as_str().is_some_and(|note| note.contains("energy")));
    assert!(twin["marks"].as_array().is_some_and(|marks| marks.iter().any(|mark| mark["kind"] == "phase")));
}

#[test]
fn half_a_recording_is_shown_as_far_as_it_goes() {
    let sandbox = played();
    let whole = sandbox.bytes("out/1/recording.mcap");
    std::fs::write(sandbox.path("half.mcap"), &whole[..whole.len() / 2]).unwrap();
    let output = sandbox.command("replay half.mcap -o half.html").output().unwrap();
    assert!(
        output.status.success() && errors(&output).contains("control steps are shown"),
        "{}",
        errors(&output)
    );
    let data = data(&sandbox.bytes("half.html"));
    let take = &data["takes"][0];
    let (shown, due) = (take["positions"].as_array().unwrap().len(), take["due"].as_array().unwrap().len());
    assert!(0 < shown && shown < due, "{shown} of {due}");
    assert!(take["incomplete"].as_str().is_some_and(|text| text.contains("incomplete")));
}

#[test]
fn two_performances_are_compared_note_by_note() {
    let sandbox = played();
    // The same strokes, and notes that should be heard 25 ms later.
    sandbox.ok("play short.mid --scripted --set task.plan.latency_compensation_secs=0.05 -o early");
    let compared = sandbox.json("compare out early -o both.html --json");
    let notes = compared["notes"].as_array().unwrap();
    for (side, folder) in ["out", "early"].into_iter().enumerate() {
        let report: Value =
            serde_json::from_slice(&sandbox.bytes(format!("{folder}/1/report.json"))).unwrap();
        let count = |what: &str| report[what].as_u64().unwrap() as usize;
        assert_eq!(notes.len(), count("matched") + count("missed"));
        let strokes: Vec<&Value> =
            notes.iter().map(|note| &note["played"][side]).filter(|stroke| !stroke.is_null()).collect();
        let mut late: Vec<f64> = strokes
            .iter()
            .filter(|stroke| stroke["right"] == true)
            .map(|stroke| stroke["onset_error_secs"].as_f64().unwrap())
            .collect();
        assert_eq!(late.len(), count("matched"), "{folder}");
        let strays = compared["strays"][side].as_array().unwrap().len();
        assert_eq!(strokes.len() + strays, count("matched") + count("wrong"), "{folder}");
        late.sort_by(f64::total_cmp);
        if let Some(median) = report["onset_error_median_secs"].as_f64() {
            let middle = late.len() / 2;
            let even = late.len().is_multiple_of(2);
            let ours = if even { (late[middle - 1] + late[middle]) / 2.0 } else { late[middle] };
            assert!((ours - median).abs() < 1e-4, "{folder}: {ours} s, in the report {median} s");
        }
    }
    let onset = |side: usize| notes[0]["played"][side]["onset_error_secs"].as_f64();
    assert!((onset(0).unwrap() - onset(1).unwrap() - 0.025).abs() < 1e-6, "{:?}", [onset(0), onset(1)]);
    // The page has both and its table the same notes.
    let both = data(&sandbox.bytes("both.html"));
    assert_eq!(both["takes"].as_array().unwrap().len(), 2);
    assert_eq!(both["takes"][1]["due_notes"].as_array().unwrap().len(), notes.len());
    let text = sandbox.ok("compare out early");
    let row = text.lines().find(|line| line.contains(notes[0]["name"].as_str().unwrap())).unwrap();
    assert!(row.contains(&format!("{:+.0}", onset(0).unwrap() * 1e3)), "{text}");
    // What cannot be compared is named.
    sandbox.ok("play twinkle --scripted -o other");
    for (args, part) in [
        ("compare out other", "are not of the same notes"),
        ("compare out short.mid", "short.mid is not a recording of Étude"),
        ("compare . out", "name one of them"),
    ] {
        refuses(&sandbox, args, part);
    }
}

#[test]
fn no_text_of_a_recording_becomes_markup() {
    let sandbox = Sandbox::new();
    let evil = "a<img src=x onerror=alert(1)>\"'<!--<script>.mid";
    std::fs::rename(sandbox.path("short.mid"), sandbox.path(evil)).unwrap();
    let run = |args: &[&str]| {
        let mut command = sandbox.command("");
        succeed({
            command.args(args);
            command
        })
    };
    run(&["play", evil, "--scripted", "-o", "out"]);
    run(&["replay", "out"]);
    run(&["gallery", "out", "-o", "gallery"]);
    let page = String::from_utf8(sandbox.bytes("out/1/replay.html")).unwrap();
    let index = String::from_utf8(sandbox.bytes("gallery/index.html")).unwrap();
    assert!(!page.contains("<img src=x") && !index.contains("<img src=x"));
    assert!(index.contains("&lt;img src=x"));
    assert!(page.contains("http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'"));
    // All four: comment or script openings in the data would change how the page is read.
    let (_, rest) = page.split_once("id=\"data\">").unwrap();
    assert!(!rest.split_once("</script>").unwrap().0.contains('<'));
    assert_eq!(data(page.as_bytes())["takes"][0]["song"], evil.strip_suffix(".mid").unwrap());
}

#[test]
fn what_cannot_be_shown_is_named() {
    let sandbox = played();
    std::fs::create_dir(sandbox.path("empty")).unwrap();
    std::fs::write(sandbox.path("text.mcap"), "no recording").unwrap();
    std::fs::create_dir(sandbox.path("out/short")).unwrap();
    for (args, part) in [
        ("replay short", "there is no recording short; did you mean out/short?"),
        ("replay nothing.mcap", "cannot open the recording nothing.mcap"),
        ("replay empty", "no recording in empty"),
        ("replay text.mcap", "text.mcap is not a recording of Étude"),
        ("replay out -o page.txt", "the name must end in .html"),
        ("replay short.mid", "short.mid is not a recording of Étude"),
        ("gallery empty", "no recording in empty"),
        ("render empty", "no recording in empty"),
        ("render text.mcap -o x.mp4", "text.mcap is not a recording of Étude"),
        ("render text.mcap -o x.avi", "the name must end in .mp4"),
    ] {
        refuses(&sandbox, args, part);
    }
}

#[test]
fn a_gallery_leads_to_every_replay() {
    let sandbox = played();
    sandbox.ok("play short.mid --scripted --set task.stage.side=right -o more");
    // One that cannot be read is named, and hinders no other; one that is named twice hangs once.
    std::fs::write(sandbox.path("more/text.mcap"), "no recording").unwrap();
    let said = errors(&sandbox.command("gallery out more -o gallery").output().unwrap());
    assert!(said.contains("showing ") && said.contains(" (1 of "), "{said}");
    let printed = sandbox.json("gallery out more out -o gallery --json");
    assert!(printed["left_out"][0].as_str().is_some_and(|why| why.contains("text.mcap")));
    let exhibits = printed["exhibits"].as_array().unwrap();
    assert_eq!(exhibits.len(), 2);
    let index = String::from_utf8(sandbox.bytes("gallery/index.html")).unwrap();
    // Two hands, two pictures.
    let pictures: Vec<_> = exhibits.iter().filter_map(|exhibit| exhibit["picture"].as_str()).collect();
    if let [one, other] = pictures[..] {
        let [one, other] = [one, other].map(|name| sandbox.bytes(Path::new("gallery").join(name)));
        assert!(one != other, "the pictures are the same");
    }
    for exhibit in exhibits {
        // What tells two recordings of one song apart.
        let recording = exhibit["recording"].as_str().unwrap();
        assert!(
            recording.ends_with("recording.mcap") && index.contains(&format!("<code>{recording}</code>"))
        );
        assert!(index.contains("<p>2 s"), "its length: {index}");
        assert!(exhibit["notes"]["matched"].is_u64() && index.contains("of 3 notes right"), "{exhibit}");
        for part in ["replay", "picture", "roll", "sound"] {
            // Without OpenGL there is no picture.
            let Some(name) = exhibit[part].as_str() else { continue };
            assert!(index.contains(&format!("\"{name}\"")), "{name} is not linked");
            assert!(!sandbox.bytes(Path::new("gallery").join(name)).is_empty());
        }
    }
}

/// The page in a real browser: `viewer/test` plays it, scrubs, changes cameras, listens, and looks
/// at errors.
#[test]
fn a_browser_plays_the_page() {
    let sandbox = Sandbox::new();
    let files = ["test/units.test.mjs", "test/bundle.test.mjs", "test/page.test.mjs"];
    let Some(mut tests) = browser_tests(&sandbox, &files) else { return };
    sandbox.ok("play twinkle --scripted -o out");
    sandbox.ok("perform twinkle --scripted --robot twin --mode real -o twin");
    sandbox.ok("replay out -o page.html");
    sandbox.ok("replay out twin -o both.html");
    tests
        .env("ETUDE_REPLAY_PAGE", sandbox.path("page.html"))
        .env("ETUDE_REPLAY_BOTH", sandbox.path("both.html"));
    all_pass(tests);
    assert!(std::fs::read_dir(sandbox.path("screenshots")).unwrap().count() >= 4);
}
