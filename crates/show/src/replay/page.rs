//! The page's HTML: the program and the styles of `viewer/`, and the takes as data.

use std::path::Path;

use etude_perform::write_file;
use maud::{PreEscaped, html};
use serde::Serialize;

use super::take::Take;
use crate::html::document;

/// The program of the page, built by `npm run build` in `viewer/`.
const SCRIPT: &str = include_str!("../../../../viewer/dist/replay.js");
const STYLE: &str = include_str!("../../../../viewer/dist/replay.css");
/// The content security policy: only this script and these styles, whatever the data contains.
const POLICY: &str = include_str!("../../../../viewer/dist/csp.txt");

/// Version of the data.
const VERSION: u32 = 1;
/// Two moments in which the takes differ are joined if they agree for at most so many steps in
/// between.
const MAX_GAP_STEPS: usize = 2;

#[derive(Serialize)]
struct Data<'a> {
    version: u32,
    takes: &'a [Take],
    /// Times in which the first two takes sound different keys, s.
    differences: Vec<[f64; 2]>,
}

/// Writes a page that shows `takes`, the first two side by side.
///
/// # Errors
/// If the file cannot be written.
pub fn replay_page(takes: &[Take], path: &Path) -> anyhow::Result<()> {
    Ok(write_file(path, &page(takes)?)?)
}

fn page(takes: &[Take]) -> serde_json::Result<String> {
    let title = takes.first().map_or("Replay", |take| &take.song);
    let title = if title.is_empty() { "Replay" } else { title };
    let data = Data { version: VERSION, takes, differences: differences(takes) };
    // No text in it can end the element that holds it.
    let data = serde_json::to_string(&data)?.replace('<', "\\u003c");
    let body = html! {
        noscript { "This replay needs JavaScript, which is part of the page; it loads nothing." }
        div id="replay" {}
        script type="application/json" id="data" { (PreEscaped(data)) }
        script { (PreEscaped(SCRIPT)) }
    };
    Ok(document(title, Some(POLICY.trim()), STYLE, &body))
}

/// Where the first two takes of the same song sound different keys, each on its own time.
fn differences(takes: &[Take]) -> Vec<[f64; 2]> {
    let [one, other, ..] = takes else { return Vec::new() };
    // Their first keys are due at the same time after these steps of silence.
    let silence = [one, other].map(|take| take.due.iter().take_while(|due| due.is_empty()).count());
    let [skipped, skipped_there] = silence.map(|steps| steps - silence[0].min(silence[1]));
    let theirs = other.scored_keys.iter().enumerate().skip(skipped_there);
    let mut differences: Vec<[usize; 2]> = Vec::new();
    for ((step, ours), (there, theirs)) in one.scored_keys.iter().enumerate().skip(skipped).zip(theirs) {
        if one.due.get(step) != other.due.get(there) {
            break;
        }
        if ours != theirs {
            match differences.last_mut() {
                Some(last) if step <= last[1] + MAX_GAP_STEPS => last[1] = step + 1,
                _ => differences.push([step, step + 1]),
            }
        }
    }
    differences
        .iter()
        .map(|steps| steps.map(|step| step as f64 / one.control_hz - one.early_secs + one.late_secs))
        .collect()
}
