//! `etude replay`, `gallery` and `render`: what people open, see and hear.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::{Desk, csv, errors, root, succeed};

/// The data of a replay page.
fn data(page: &[u8]) -> Value {
    let page = std::str::from_utf8(page).unwrap();
    let (_, rest) = page.split_once("<script type=\"application/json\" id=\"data\">").unwrap();
    serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
}

/// A desk with `out/recording.mcap`, the scripted baseline's performance of `short.mid`.
fn played() -> Desk {
    let desk = Desk::new();
    desk.ok("play short.mid --scripted -o out");
    desk
}

/// The command fails, and its message has this part.
fn refuses(desk: &Desk, args: &str, part: &str) {
    let output = desk.command(args).output().unwrap();
    let said = errors(&output);
    assert!(output.status.code() == Some(1) && said.contains(part), "{args}: {said}");
}

/// Says why nothing is tested; CI, which installs everything, must test.
pub fn skip(why: &str) {
    assert!(std::env::var_os("ETUDE_NEEDS_ALL").is_none(), "{why}");
    println!("skipped: {why}");
}

/// Tests of the viewer, `files`, which leave their screenshots in `desk`; none where no browser can run them.
pub fn browser_tests(desk: &Desk, files: &[&str]) -> Option<Command> {
    let viewer = root().join("viewer");
    let chromium = std::env::var("ETUDE_CHROMIUM").unwrap_or_else(|_| "/usr/bin/chromium".to_string());
    if !viewer.join("node_modules").is_dir() || !Path::new(&chromium).is_file() {
        skip("there is no Node.js with the viewer's packages (cd viewer && npm ci), or no Chromium");
        return None;
    }
    let mut tests = Command::new("node");
    tests.arg("--test").args(files).current_dir(viewer).env("ETUDE_SCREENSHOTS", desk.path("screenshots"));
    Some(tests)
}

/// Runs them; all must pass. Gives what they said.
pub fn all_pass(mut tests: Command) -> String {
    let output = tests.output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{said}\n{}", errors(&output));
    said
}

#[test]
fn a_page_holds_what_was_recorded() {
    let desk = played();
    let printed = desk.json("replay out --json");
    let page = desk.bytes("out/replay.html");
    assert_eq!(printed["bytes"], page.len());
    assert!(page.len() < 4_000_000, "{} bytes", page.len());
    let data = data(&page);
    let take = &data["takes"][0];
    let rows = csv(&desk.bytes("out/frames.csv"));
    let pitches = |text: &str| -> Vec<u64> { text.split_whitespace().map(|p| p.parse().unwrap()).collect() };
    for (step, row) in rows[1..].iter().enumerate() {
        let of = |list: &str| -> Vec<u64> {
            take[list][step].as_array().unwrap().iter().map(|pitch| pitch.as_u64().unwrap()).collect()
        };
        assert_eq!((of("due"), of("pressed")), (pitches(&row[1]), pitches(&row[2])), "step {step}");
    }
    assert_eq!(take["positions"].as_array().unwrap().len(), rows.len() - 1);
    let report: Value = serde_json::from_slice(&desk.bytes("out/report.json")).unwrap();
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
    let desk = played();
    // The same lead in both, so that they can be compared step by step.
    desk.ok("perform short.mid --scripted --robot twin --mode real --set task.plan.latency_compensation_secs=0.025 -o twin");
    let notes = |args: &str| errors(&desk.command(args).output().unwrap());
    assert_eq!(notes("replay out twin -o both.html"), "");
    // With a lead a robot is heard later; the piece is still the same, and so is its F1 on the page.
    desk.ok("perform short.mid --scripted --robot twin --mode real --set task.plan.latency_compensation_secs=0.11 -o led");
    assert_eq!(notes("replay led out -o led.html"), "");
    let led = self::data(&desk.bytes("led.html"));
    assert_eq!(led["takes"][0]["due"], led["takes"][1]["due"]);
    let report: Value = serde_json::from_slice(&desk.bytes("led/report.json")).unwrap();
    let f1 = led["takes"][0]["final"]["f1"].as_f64().unwrap();
    assert!((f1 - report["robot_f1"].as_f64().unwrap()).abs() < 1e-9, "{f1}");
    // They part where other keys are heard, 0.11 s − 25 ms after the end of each control step, and nowhere else at both ends.
    let apart: Vec<[f64; 2]> = serde_json::from_value(led["partings"].clone()).unwrap();
    let parts = |step: usize| heard(&led["takes"][0], step, 0.085) != led["takes"][1]["pressed"][step];
    for step in 0..led["takes"][0]["due"].as_array().unwrap().len() {
        let middle = (step as f64 + 0.5) / 20.0 + 0.085;
        assert!(!parts(step) || apart.iter().any(|[from, to]| (*from..*to).contains(&middle)), "step {step}");
    }
    assert!(!apart.is_empty(), "where they part");
    for edge in apart.iter().flat_map(|[from, to]| [*from, *to - 0.05]) {
        assert!(parts(((edge - 0.085) * 20.0).round() as usize), "at {edge} s");
    }
    desk.write_song("other.mid", [64, 62, 60]);
    desk.ok("play other.mid --scripted -o other");
    assert!(notes("replay out other -o others.html").contains("of the same notes"));
    let data = data(&desk.bytes("both.html"));
    let [simulation, twin] = [&data["takes"][0], &data["takes"][1]];
    assert_eq!(
        (&simulation["rig"], &twin["rig"], &twin["mode"]),
        (&"simulation".into(), &"twin (standard)".into(), &"real".into())
    );
    let apart: Vec<[f64; 2]> = serde_json::from_value(data["partings"].clone()).unwrap();
    let pressed = |take: &Value, step: usize| take["pressed"][step].clone();
    for step in 0..simulation["due"].as_array().unwrap().len() {
        let middle = (step as f64 + 0.5) / 20.0;
        let told = apart.iter().any(|[from, to]| (*from..*to).contains(&middle));
        assert!(told || pressed(simulation, step) == pressed(twin, step), "step {step}");
    }
    // Nowhere do they agree for more than a moment within one of them.
    for [from, to] in &apart {
        let steps = ((from * 20.0).round() as usize)..((to * 20.0).round() as usize);
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
    let desk = played();
    let whole = desk.bytes("out/recording.mcap");
    std::fs::write(desk.path("half.mcap"), &whole[..whole.len() / 2]).unwrap();
    let output = desk.command("replay half.mcap -o half.html").output().unwrap();
    assert!(output.status.success() && errors(&output).contains("as far as it goes"), "{}", errors(&output));
    let data = data(&desk.bytes("half.html"));
    let take = &data["takes"][0];
    let (shown, due) = (take["positions"].as_array().unwrap().len(), take["due"].as_array().unwrap().len());
    assert!(0 < shown && shown < due, "{shown} of {due}");
    assert!(take["incomplete"].as_str().is_some_and(|text| text.contains("cut short")));
}

#[test]
fn two_performances_are_compared_note_by_note() {
    let desk = played();
    // The same strokes, and notes that should be heard 25 ms later.
    desk.ok("play short.mid --scripted --set task.plan.latency_compensation_secs=0.05 -o early");
    let compared = desk.json("compare out early -o both.html --json");
    let notes = compared["notes"].as_array().unwrap();
    for (side, folder) in ["out", "early"].into_iter().enumerate() {
        let report: Value = serde_json::from_slice(&desk.bytes(format!("{folder}/report.json"))).unwrap();
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
    let both = data(&desk.bytes("both.html"));
    assert_eq!(both["takes"].as_array().unwrap().len(), 2);
    assert_eq!(both["takes"][1]["due_notes"].as_array().unwrap().len(), notes.len());
    let text = desk.ok("compare out early");
    let row = text.lines().find(|line| line.contains(notes[0]["name"].as_str().unwrap())).unwrap();
    assert!(row.contains(&format!("{:+.0}", onset(0).unwrap() * 1e3)), "{text}");
    // What cannot be compared is named.
    desk.ok("play twinkle --scripted -o other");
    for (args, part) in [
        ("compare out other", "are not of the same notes"),
        ("compare out short.mid", "short.mid is not a recording of Étude"),
        ("compare . out", "name one of them"),
    ] {
        refuses(&desk, args, part);
    }
}

#[test]
fn no_text_of_a_recording_becomes_markup() {
    let desk = Desk::new();
    let evil = "a<img src=x onerror=alert(1)>\"'<!--<script>.mid";
    std::fs::rename(desk.path("short.mid"), desk.path(evil)).unwrap();
    let run = |args: &[&str]| {
        let mut command = desk.command("");
        succeed({
            command.args(args);
            command
        })
    };
    run(&["play", evil, "--scripted", "-o", "out"]);
    run(&["replay", "out"]);
    run(&["gallery", "out", "-o", "gallery"]);
    let page = String::from_utf8(desk.bytes("out/replay.html")).unwrap();
    let index = String::from_utf8(desk.bytes("gallery/index.html")).unwrap();
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
    let desk = played();
    std::fs::create_dir(desk.path("empty")).unwrap();
    std::fs::write(desk.path("text.mcap"), "no recording").unwrap();
    std::fs::create_dir(desk.path("out/short")).unwrap();
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
        refuses(&desk, args, part);
    }
}

#[test]
fn a_gallery_leads_to_every_replay() {
    let desk = played();
    desk.ok("play short.mid --scripted --set task.stage.side=right -o more");
    // One that cannot be read is named, and hinders no other; one that is named twice hangs once.
    std::fs::write(desk.path("more/text.mcap"), "no recording").unwrap();
    let said = errors(&desk.command("gallery out more -o gallery").output().unwrap());
    assert!(said.contains("showing ") && said.contains(" (1 of "), "{said}");
    let printed = desk.json("gallery out more out -o gallery --json");
    assert!(printed["left_out"][0].as_str().is_some_and(|why| why.contains("text.mcap")));
    let exhibits = printed["exhibits"].as_array().unwrap();
    assert_eq!(exhibits.len(), 2);
    let index = String::from_utf8(desk.bytes("gallery/index.html")).unwrap();
    // Two hands, two pictures.
    let pictures: Vec<_> = exhibits.iter().filter_map(|exhibit| exhibit["picture"].as_str()).collect();
    if let [one, other] = pictures[..] {
        let [one, other] = [one, other].map(|name| desk.bytes(Path::new("gallery").join(name)));
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
            assert!(!desk.bytes(Path::new("gallery").join(name)).is_empty());
        }
    }
}

/// Whether pictures can be drawn here at all.
pub fn draws(desk: &Desk) -> bool {
    let output = desk.command("render out --at 0 --size 64x48 -o probe.png").output().unwrap();
    if !output.status.success() {
        assert!(errors(&output).contains("no off-screen OpenGL here"), "{}", errors(&output));
        skip("there is no off-screen OpenGL here");
    }
    output.status.success()
}

#[test]
fn a_still_has_its_size_and_every_view_is_another() {
    let desk = played();
    if !draws(&desk) {
        return;
    }
    let mut seen = BTreeSet::new();
    for view in ["player", "side", "top", "fingers"] {
        desk.ok(&format!("render out --at 0.5 --view {view} --size 320x180 -o {view}.png"));
        let png = desk.bytes(format!("{view}.png"));
        assert_eq!(png[..8], *b"\x89PNG\r\n\x1a\n");
        let number = |at: usize| u32::from_be_bytes(png[at..at + 4].try_into().unwrap());
        assert_eq!((number(16), number(20)), (320, 180));
        seen.insert(png);
    }
    assert_eq!(seen.len(), 4);
    for (args, part) in [
        ("render out --at 99 -o x.png", "there is no picture at 99.00 s"),
        ("render out --at 0 --size 9999x1 -o x.png", "at most 1920 × 1080"),
    ] {
        let output = desk.command(args).output().unwrap();
        assert!(output.status.code() == Some(1) && errors(&output).contains(part), "{}", errors(&output));
    }
}

/// Where the system has no OpenGL, the message says what to install, and nothing is left behind.
#[test]
fn a_machine_without_opengl_is_told_what_to_install() {
    let desk = played();
    let mut command = desk.command("render out -o video.mp4");
    let output = command.env("__EGL_VENDOR_LIBRARY_DIRS", desk.path("nowhere")).output().unwrap();
    let said = errors(&output);
    assert!(output.status.code() == Some(1) && said.contains("libegl1 libgl1-mesa-dri"), "{said}");
    assert!(!desk.path("video.mp4").exists());
}

#[test]
fn a_video_has_picture_and_sound() {
    let desk = played();
    if !draws(&desk) {
        return;
    }
    // Without ffmpeg the pictures and the command are there.
    let frames = succeed({
        let mut command = desk.command("render out --size 64x48 -o without.mp4 --json");
        command.env("PATH", desk.path("nowhere"));
        command
    });
    assert!(!desk.path("without.frames.partial").exists());
    let frames: Value = serde_json::from_str(&frames).unwrap();
    assert_eq!(frames["frames"], "without.frames");
    assert!(frames["command"].as_str().is_some_and(|command| command.starts_with("ffmpeg ")));
    assert!(
        desk.path("without.frames/000000.png").is_file() && desk.path("without.frames/sound.wav").is_file()
    );

    // Beside files of another kind no pictures are written.
    std::fs::write(desk.path("without.frames/notes.txt"), "mine").unwrap();
    let mut again = desk.command("render out --size 64x48 -o without.mp4");
    let output = again.env("PATH", desk.path("nowhere")).output().unwrap();
    assert!(output.status.code() == Some(1) && errors(&output).contains("notes.txt is not of a video"));
    assert_eq!(desk.bytes("without.frames/notes.txt"), b"mine");

    if Command::new("ffprobe").arg("-version").output().is_err() {
        return skip("there is no ffmpeg here");
    }
    let said = errors(&desk.command("render out --size 321x180 -o video.mp4").output().unwrap());
    assert!(said.starts_with("drawing, "), "{said}");
    let probe = Command::new("ffprobe")
        .args([
            "-v",
            "error",
            "-show_entries",
            "stream=codec_type,width,height:format=duration",
            "-of",
            "json",
        ])
        .arg(desk.path("video.mp4"))
        .output()
        .unwrap();
    let probe: Value = serde_json::from_slice(&probe.stdout).unwrap();
    let kinds: BTreeSet<&str> =
        probe["streams"].as_array().unwrap().iter().map(|s| s["codec_type"].as_str().unwrap()).collect();
    assert_eq!(kinds, BTreeSet::from(["audio", "video"]));
    let secs: f64 = probe["format"]["duration"].as_str().unwrap().parse().unwrap();
    let report: Value = serde_json::from_slice(&desk.bytes("out/report.json")).unwrap();
    let played = report["steps"].as_f64().unwrap() / 20.0;
    assert!((secs - played).abs() < 0.2, "{secs} s of {played}");
    assert!(!desk.path("video.partial.mp4").exists() && !desk.path("video.partial.wav").exists());
}

/// The page in a real browser: `viewer/test` plays it, scrubs, changes cameras, listens, and looks at errors.
#[test]
fn a_browser_plays_the_page() {
    let desk = Desk::new();
    let files = ["test/units.test.mjs", "test/bundle.test.mjs", "test/page.test.mjs"];
    let Some(mut tests) = browser_tests(&desk, &files) else { return };
    desk.ok("play twinkle --scripted -o out");
    desk.ok("perform twinkle --scripted --robot twin --mode real -o twin");
    desk.ok("replay out -o page.html");
    desk.ok("replay out twin -o both.html");
    tests.env("ETUDE_REPLAY_PAGE", desk.path("page.html")).env("ETUDE_REPLAY_BOTH", desk.path("both.html"));
    all_pass(tests);
    assert!(std::fs::read_dir(desk.path("screenshots")).unwrap().count() >= 4);
}
