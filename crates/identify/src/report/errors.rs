//! Errors joint by joint: before, after, and how far from the noise.

use etude_stage::JOINT_NAMES;

use super::ReportInput;
use super::document::{Element, Table, numbers, words};
use super::number::{factor, milli, milli_unit, number};
use crate::assessment::Assessment;

/// Tables of the errors in held-out and in fitted motions.
pub(super) fn elements(input: &ReportInput<'_>) -> Vec<Element> {
    let mut elements = vec![Element::Paragraph(
        "Root mean square of simulated less measured positions. The noise is that of readings of the joint \
         at rest: no simulator can do better."
            .to_string(),
    )];
    for (caption, errors) in
        [("Held-out recordings", input.held_out_errors), ("Fitted recordings", input.fit_errors)]
    {
        if !errors.joints.is_empty() {
            elements.push(Element::Table(table(caption, errors)));
        }
    }
    elements
}

fn table(caption: &str, errors: &Assessment) -> Table {
    let line = |name: &str, unit: &str, [before, after]: [f64; 2], noise: f64| {
        let over = if noise > 0.0 { number(after / noise) } else { "–".to_string() };
        vec![
            name.to_string(),
            unit.to_string(),
            milli(before),
            milli(after),
            factor([before, after]),
            milli(noise),
            if after.is_finite() { over } else { "–".to_string() },
        ]
    };
    let mut rows: Vec<Vec<String>> = errors
        .joints
        .iter()
        .map(|joint| {
            let index = JOINT_NAMES.iter().position(|name| *name == joint.joint).unwrap_or(0);
            line(&joint.joint, milli_unit(index), [joint.before, joint.after], joint.noise)
        })
        .collect();
    if errors.fingers[0] > 0.0 {
        rows.push(line("fingers together", milli_unit(0), errors.fingers, errors.fingers_noise));
    }
    Table {
        caption: caption.to_string(),
        columns: vec![
            words("joint"),
            words("unit"),
            numbers("before"),
            numbers("after"),
            numbers("times less"),
            numbers("noise"),
            numbers("after / noise"),
        ],
        rows,
    }
}
