//! The result in short, and what was fitted.

use etude_stage::DRIVEN_JOINTS;

use super::document::{paragraph, table};
use super::input::ReportInput;
use super::number::{about, milli, number};
use super::remaining_error::{self, RemainingError};
use crate::config::MethodConfig;
use crate::gravity_compensation::fit_gravity_compensation;
use crate::motion::RecordedMotion;
use crate::presses;

/// The result in a few sentences.
pub(super) fn in_short(input: &ReportInput<'_>, parts: &[RemainingError]) -> Vec<String> {
    let (errors, which) = match input.held_out {
        [] => (input.fit_errors, "in the recordings that were fitted"),
        _ => (input.held_out_errors, "in recordings that were not fitted"),
    };
    let [before, after] = errors.fingers;
    let mut items = Vec::new();
    if !after.is_finite() {
        items.push(format!(
            "The identified simulation diverges {which}: do not use it. Record calmer motion, or start from other values with \
             --from."
        ));
    } else if !before.is_finite() {
        items.push(format!(
            "Before the fit the simulation diverged {which}; now the fingers' error is {} mrad (root mean square).",
            milli(after)
        ));
    } else if after > 0.0 {
        items.push(format!(
            "The fingers' error {which} fell {}-fold, from {} to {} mrad (root mean square).",
            about(before / after),
            milli(before),
            milli(after)
        ));
    }
    if after.is_finite() && after > 0.0 && errors.fingers_noise > 0.0 {
        items.push(format!(
            "A reading at rest has a standard deviation of {} mrad: the remaining error is {} times the noise floor.",
            milli(errors.fingers_noise),
            about(after / errors.fingers_noise)
        ));
    }
    items.extend(remaining_error::in_short(parts));
    if let Some((gravity, motion)) = fit_gravity_compensation(input.fitted).zip(input.fitted.first()) {
        let advice = gravity.advice(motion.rig.joint_loop.gravity_pwm_per_nm);
        items.push(format!("From the duties of the motors {advice}."));
    }
    if let Some(keyboard) = presses::describe(input.fitted, &input.identified.measured) {
        items.push(format!("Of the keyboard: {keyboard}."));
    }
    if input.held_out.is_empty() {
        items.push(
            "No recording was held out, so these errors are optimistic: record one more motion \
             (etude record --excitation held-out) and pass it too."
                .to_string(),
        );
    }
    let estimates = || input.identified.estimates.iter().flat_map(|(_, estimate)| &estimate.parameters);
    items.push(format!(
        "{} of {} estimated parameters are identifiable from these recordings; {} are at a bound of their range.",
        estimates().filter(|parameter| parameter.is_identifiable).count(),
        estimates().count(),
        estimates().filter(|parameter| parameter.at_bound.is_some()).count()
    ));
    items
}

/// Method, recordings and passes.
pub(super) fn what_was_fitted(input: &ReportInput<'_>) -> Vec<String> {
    let config = input.config;
    let method = match &config.method {
        MethodConfig::Lm(_) => "Levenberg–Marquardt",
        MethodConfig::Bo(_) => "Bayesian optimisation",
    };
    let start = match config.start.len() {
        0 => "the defaults".to_string(),
        count => format!("{count} given values and the defaults"),
    };
    let recording = |motion: &RecordedMotion, use_of: &str| {
        vec![
            motion.path.display().to_string(),
            motion.mode.clone(),
            number(motion.secs()),
            format!("{} of {DRIVEN_JOINTS}", motion.moves.iter().filter(|moves| **moves).count()),
            motion.keys.iter().filter(|event| event.velocity > 0).count().to_string(),
            use_of.to_string(),
        ]
    };
    let fitted = input.fitted.iter().map(|motion| recording(motion, "fitted"));
    let held_out = input.held_out.iter().map(|motion| recording(motion, "held out"));
    let passes = input.identified.passes.iter().map(|end| {
        let [before, after] = end.rms.map(number);
        vec![end.pass.name().to_string(), end.replays.to_string(), number(end.secs), before, after]
    });
    vec![
        paragraph(&format!(
            "Method: {method}, at most {} replays of all recordings a group; seed {}; started at {start} within the rig's \
             limits.",
            config.method.max_evaluations(),
            config.seed
        )),
        table(
            "Recordings",
            &["recording", "motion", "seconds", "joints that move", "keys struck", "use"],
            fitted.chain(held_out),
        ),
        table(
            "Passes; residuals are root mean squares in standard deviations of the readings' noise",
            &["pass", "replays", "seconds", "residuals before", "after"],
            passes,
        ),
    ]
}
