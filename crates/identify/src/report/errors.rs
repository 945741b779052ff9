//! Errors by joint: before and after the fit, and how far from the noise.

use etude_stage::JOINT_NAMES;

use super::document::{paragraph, table};
use super::input::ReportInput;
use super::number::{factor, milli, milli_unit, number};
use crate::assessment::Assessment;

/// Tables of the errors in held-out and in fitted motions.
pub(super) fn elements(input: &ReportInput<'_>) -> Vec<String> {
    let mut elements = vec![paragraph(
        "Root mean square of simulated minus measured positions. The noise is that of the joint's readings at rest: no \
         simulator can do better.",
    )];
    let both = [("Held-out recordings", input.held_out_errors), ("Fitted recordings", input.fit_errors)];
    let both = both.into_iter().filter(|(_, errors)| !errors.joints.is_empty());
    elements.extend(both.map(|(caption, errors)| assessed(caption, errors)));
    elements
}

fn assessed(caption: &str, errors: &Assessment) -> String {
    let line = |name: &str, unit: &str, [before, after]: [f64; 2], noise: f64| {
        let is_known = noise > 0.0 && after.is_finite();
        let over = if is_known { number(after / noise) } else { "–".to_string() };
        let numbers = [milli(before), milli(after), factor([before, after]), milli(noise), over];
        [name.to_string(), unit.to_string()].into_iter().chain(numbers).collect()
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
    table(caption, &["joint", "unit", "before", "after", "times less", "noise", "after / noise"], rows)
}
