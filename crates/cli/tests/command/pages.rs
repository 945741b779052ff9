//! Every page that the commands write, in a real browser: light and dark, wide and on a phone.

use serde_json::Value;

use crate::browser::{all_pass, browser_tests};
use crate::experiments::{FOUR, tiny};
use crate::{Sandbox, succeed};

/// What a page can show besides the figure of [`FOUR`]: curves, and the paper's numbers.
const MORE: &str = r#"
[[figures]]
name = "training"
title = "Training"
kind = "curves"
x = "step"
y = ["f1"]
by = "variant"
[[paper]]
where = { variant = "fences" }
measure = "sim_f1"
value = 0.9
"#;

const NOTES: &str = "# Setup\n\nPreset `fast`, **one** seed. <b>Text</b>\n\n- one\n- two\n";

/// Plays a rehearsal's first iteration, and puts another one beside it that has the same
/// performance: the same command then writes the page of both.
fn rehearse(sandbox: &Sandbox) {
    let rehearse = "rehearse c-major-scale --robot twin --runs 1 --seed 3 -o rehearsal";
    sandbox.ok(&format!("{rehearse} --iterations 0"));
    let mut iteration: Value =
        serde_json::from_slice(&sandbox.bytes("rehearsal/iteration-0/iteration.json")).unwrap();
    iteration["iteration"] = 1.into();
    iteration["gap"] = (-0.01).into();
    iteration["held_out_rad"] = serde_json::json!([0.013, 0.0017]);
    iteration["physics"] = serde_json::json!({ "joint.rail.delay": 0.0123 });
    std::fs::create_dir(sandbox.path("rehearsal/iteration-1")).unwrap();
    std::fs::write(sandbox.path("rehearsal/iteration-1/iteration.json"), iteration.to_string()).unwrap();
    sandbox.ok(&format!("{rehearse} --iterations 1"));
    let page = String::from_utf8(sandbox.bytes("rehearsal/rehearsal.html")).unwrap();
    assert!(
        page.contains("href=\"iteration-0/performance/1/run-1.html\"") && !page.contains(".mcap"),
        "{page}"
    );
    assert!(page.contains("Notes right on the robot") && page.contains("gap (%)"), "{page}");
}

fn experiment(sandbox: &Sandbox) {
    // Two on one page, of the same trials.
    for name in ["shown.toml", "again.toml"] {
        std::fs::write(sandbox.path(name), format!("{FOUR}{MORE}")).unwrap();
    }
    std::fs::create_dir_all(sandbox.path("report/shown")).unwrap();
    std::fs::write(sandbox.path("report/shown/notes.md"), NOTES).unwrap();
    succeed(tiny(sandbox, "experiment run shown.toml"));
    succeed(tiny(sandbox, "experiment report shown.toml again.toml -o report"));
    let page = String::from_utf8(sandbox.bytes("report/index.html")).unwrap();
    for part in ["- one\n- two</pre>", "&lt;b&gt;Text", "the paper", "control steps of the training"] {
        assert!(page.contains(part), "{part} is not in {page}");
    }
    // A drawing is in the colours of the page; as a file of its own it is on white.
    assert!(page.contains("var(--series-1)") && !page.contains("\"#FFFFFF\""));
    let file = String::from_utf8(sandbox.bytes("report/shown/scores.svg")).unwrap();
    assert!(file.contains("fill=\"#FFFFFF\"") && file.contains("the paper"));
}

#[test]
fn every_page_is_accessible_light_and_dark_wide_and_on_a_phone() {
    let sandbox = Sandbox::new();
    sandbox.ok("play short.mid --scripted -o out");
    sandbox.ok("perform short.mid --scripted --robot twin --mode real --runs 1 -o twin");
    sandbox.ok("replay out -o replay.html");
    sandbox.ok("compare out twin -o compare.html");
    sandbox.ok("gallery out twin -o gallery");
    rehearse(&sandbox);
    experiment(&sandbox);
    let Some(mut tests) = browser_tests(&sandbox, &["test/pages.test.mjs"]) else { return };
    let pages = [
        "replay.html",
        "compare.html",
        "gallery/index.html",
        "rehearsal/rehearsal.html",
        "report/index.html",
    ];
    let pages = std::env::join_paths(pages.map(|page| sandbox.path(page))).unwrap();
    tests.env("ETUDE_PAGES", pages);
    all_pass(tests);
    assert_eq!(std::fs::read_dir(sandbox.path("screenshots")).unwrap().count(), 5 * 4);
}
