//! Marks on the time line: phases, warnings, faults, clamps.

use std::collections::BTreeMap;

use etude_perform::Recording;
use serde::Serialize;

use super::rewards::rounded;

/// Clamps of one joint by one limit that are no further apart than this are one mark, s.
const CLAMPS_APART_SECS: f64 = 0.25;
const MAX_TEXT_CHARS: usize = 400;

/// The kind of a mark on the time line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum MarkKind {
    /// A safety stop.
    Fault,
    /// A warning to the operator.
    Warning,
    /// The robot entered another phase.
    Phase,
    /// The limiter changed set-points.
    Clamp,
}

/// A mark on the time line.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Mark {
    /// Its time.
    pub secs: f64,
    /// Its kind.
    pub kind: MarkKind,
    /// What happened.
    pub text: String,
}

/// All marks of a recording in order.
pub(super) fn marks(recording: &Recording) -> Vec<Mark> {
    let early_secs = recording.header.latency_compensation_secs;
    let mut marks: Vec<Mark> = recording
        .events
        .iter()
        .filter_map(|(secs, note)| {
            let kind = match note.kind.as_str() {
                "fault" => MarkKind::Fault,
                "warning" => MarkKind::Warning,
                "phase" => MarkKind::Phase,
                _ => return None,
            };
            let text = note.text.chars().take(MAX_TEXT_CHARS).collect();
            Some(Mark { secs: rounded(*secs), kind, text })
        })
        .collect();
    marks.extend(clamps(recording));
    // On the page's time; what comes before its beginning stays at it.
    for mark in &mut marks {
        mark.secs = rounded((mark.secs - early_secs).max(0.0));
    }
    marks.sort_by(|one, other| one.secs.total_cmp(&other.secs));
    marks
}

/// Clamps of the same joint by the same limit in a row are one mark.
fn clamps(recording: &Recording) -> Vec<Mark> {
    let mut open: BTreeMap<(usize, &str), [f64; 2]> = BTreeMap::new();
    let mut marks = Vec::new();
    let mark = |(joint, limit): (usize, &str), [from, to]: [f64; 2]| {
        let name = recording.header.joints.get(joint).map_or("a joint", String::as_str);
        let limit: String = limit.chars().take(MAX_TEXT_CHARS).collect();
        Mark {
            secs: rounded(from),
            kind: MarkKind::Clamp,
            text: format!("{name}: set-points clamped by the limit of {limit} for {:.2} s", to - from),
        }
    };
    for (secs, point) in &recording.setpoints {
        for (joint, limit) in &point.clamps {
            let row = open.entry((*joint, limit.as_str())).or_insert([*secs; 2]);
            if *secs > row[1] + CLAMPS_APART_SECS {
                marks.push(mark((*joint, limit), *row));
                row[0] = *secs;
            }
            row[1] = *secs;
        }
    }
    marks.extend(open.into_iter().map(|(which, row)| mark(which, row)));
    marks
}
