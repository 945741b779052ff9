//! The viewer's tests, in Chromium.

use std::path::Path;
use std::process::Command;

use crate::{Sandbox, errors, root};

/// Says why nothing is tested; CI, which installs everything, must test.
pub fn skip(why: &str) {
    assert!(std::env::var_os("ETUDE_NEEDS_ALL").is_none(), "{why}");
    println!("skipped: {why}");
}

/// Tests of the viewer, `files`, which leave their screenshots in `sandbox`; none where no browser
/// can run them.
pub fn browser_tests(sandbox: &Sandbox, files: &[&str]) -> Option<Command> {
    let viewer = root().join("viewer");
    let chromium = std::env::var("ETUDE_CHROMIUM").unwrap_or_else(|_| "/usr/bin/chromium".to_string());
    if !viewer.join("node_modules").is_dir() || !Path::new(&chromium).is_file() {
        skip("there is no Node.js with the viewer's packages (cd viewer && npm ci), or no Chromium");
        return None;
    }
    let mut tests = Command::new("node");
    tests.arg("--test").args(files).current_dir(viewer).env("ETUDE_SCREENSHOTS", sandbox.path("screenshots"));
    Some(tests)
}

/// Runs them; all must pass. Gives what they said.
pub fn all_pass(mut tests: Command) -> String {
    let output = tests.output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{said}\n{}", errors(&output));
    said
}
