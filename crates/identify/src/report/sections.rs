//! The sections of a report, in the order in which a reader decides: what was fitted, how well, what is
//! missing, which numbers to believe.

use std::path::Path;

use etude_stage::JOINTS;

use super::ReportInput;
use super::document::{Document, Element, Section, Table, numbers, words};
use super::number::{about, milli, number};
use super::overlay::{Replayed, overlay};
use super::{correlation, errors, parameters, weak, what_is_left};
use crate::config::MethodConfig;
use crate::motion::Motion;

/// The whole report.
pub(super) fn document(
    input: &ReportInput<'_>,
    fitted: &[Replayed<'_>],
    held_out: &[Replayed<'_>],
) -> Document {
    let rig = input.fitted.first().map_or("", |motion| motion.rig.name.as_str());
    // What was never fitted tells the truth; without it, what was. Where keys are touched, more than the
    // joints differs.
    let telling: Vec<&Replayed<'_>> = match held_out {
        [] => fitted.iter().filter(|replayed| replayed.motion.keys.is_empty()).collect(),
        _ => held_out.iter().collect(),
    };
    let left = what_is_left::parts(&telling);
    Document {
        title: format!("Identification of the rig {rig}"),
        sections: vec![
            Section { title: "In short", elements: vec![Element::List(in_short(input, &left))] },
            Section { title: "What was fitted", elements: what_was_fitted(input) },
            Section { title: "Errors", elements: errors::elements(input) },
            Section {
                title: "What the simulator cannot express",
                elements: what_is_left::elements(&left, !held_out.is_empty()),
            },
            Section { title: "Before and after", elements: overlays(&telling) },
            Section { title: "Parameters", elements: parameters::elements(input) },
            Section { title: "Correlations", elements: correlations(input) },
            Section {
                title: "What these recordings do not tell",
                elements: weak::elements(input.identified),
            },
        ],
    }
}

/// The end of a path.
pub(super) fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

fn in_short(input: &ReportInput<'_>, left: &[what_is_left::Part]) -> Vec<String> {
    let (errors, which) = match input.held_out {
        [] => (input.fit_errors, "in the recordings that were fitted"),
        _ => (input.held_out_errors, "in recordings that were not fitted"),
    };
    let [before, after] = errors.fingers;
    let mut items = Vec::new();
    if !after.is_finite() {
        items.push(format!(
            "The identified world diverges {which}: do not use it. Record calmer motion, or begin at other \
             numbers with --from."
        ));
    } else if !before.is_finite() {
        items.push(format!(
            "Before the fit the world diverged {which}; now the fingers are {} mrad off (root mean square).",
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
            "A reading at rest scatters by {} mrad: what is left is {} times the noise floor.",
            milli(errors.fingers_noise),
            about(after / errors.fingers_noise)
        ));
    }
    items.extend(what_is_left::in_short(left));
    if input.held_out.is_empty() {
        items.push(
            "No recording was held out, so these errors flatter the fit: record one more motion \
             (etude record --excitation held-out) and give it too."
                .to_string(),
        );
    }
    let estimates = || input.identified.estimates.iter().flat_map(|(_, estimate)| &estimate.parameters);
    let told = estimates().filter(|parameter| parameter.is_identifiable).count();
    items.push(format!(
        "{told} of {} estimated numbers are told by these recordings, {} are not, and {} are at a bound of \
         their range.",
        estimates().count(),
        estimates().count() - told,
        estimates().filter(|parameter| parameter.at_bound.is_some()).count()
    ));
    items
}

fn what_was_fitted(input: &ReportInput<'_>) -> Vec<Element> {
    let config = input.config;
    let method = match &config.method {
        MethodConfig::Lm(_) => "Levenberg–Marquardt",
        MethodConfig::Bo(_) => "Bayesian optimisation",
    };
    let start = match config.start.len() {
        0 => "the defaults".to_string(),
        count => format!("{count} numbers given and the defaults"),
    };
    let recording = |use_of: &'static str| {
        move |motion: &Motion| {
            let moving = motion.moves.iter().filter(|moves| **moves).count();
            vec![
                motion.path.display().to_string(),
                motion.mode.clone(),
                number(motion.secs()),
                format!("{moving} of {JOINTS}"),
                motion.keys.iter().filter(|event| event.velocity > 0).count().to_string(),
                use_of.to_string(),
            ]
        }
    };
    let recordings = (input.fitted.iter().map(recording("fitted")))
        .chain(input.held_out.iter().map(recording("held out")))
        .collect();
    let stages = input.identified.stages.iter().map(|end| {
        vec![
            end.stage.name().to_string(),
            end.replays.to_string(),
            number(end.secs),
            number(end.rms[0]),
            number(end.rms[1]),
        ]
    });
    vec![
        Element::Paragraph(format!(
            "Method: {method}, at most {} replays of all recordings a group; seed {}; started at {start} \
             within the rig's limits.",
            config.method.max_evaluations(),
            config.seed
        )),
        Element::Table(Table {
            caption: "Recordings".to_string(),
            columns: vec![
                words("recording"),
                words("motion"),
                numbers("seconds"),
                numbers("joints that move"),
                numbers("keys struck"),
                words("use"),
            ],
            rows: recordings,
        }),
        Element::Table(Table {
            caption: "Stages: residuals are root mean squares in standard deviations of the readings' noise"
                .to_string(),
            columns: vec![
                words("stage"),
                numbers("replays"),
                numbers("seconds"),
                numbers("residuals before"),
                numbers("after"),
            ],
            rows: stages.collect(),
        }),
    ]
}

fn overlays(telling: &[&Replayed<'_>]) -> Vec<Element> {
    let pictures: Vec<_> = (0..JOINTS).filter_map(|joint| overlay(joint, telling)).collect();
    vec![
        Element::Paragraph(format!(
            "report.html draws {} joints, each over the two seconds in which it moves most. Measured: wide \
             grey band; before the fit: dashed, orange; after it: thin, blue. Below each: what is left.",
            pictures.len()
        )),
        Element::Pictures(pictures),
    ]
}

fn correlations(input: &ReportInput<'_>) -> Vec<Element> {
    let estimates = &input.identified.estimates;
    let mut elements = vec![
        Element::Paragraph(
            "Of the estimates' errors, by linear theory where the fit ended. Two numbers that correlate \
             strongly are known together better than each by itself. Singular values are residuals, in \
             standard deviations of the noise, for a move over a whole range along one direction of the \
             parameters; the condition is the largest over the smallest."
                .to_string(),
        ),
        Element::List(
            estimates.iter().map(|(group, estimate)| correlation::singular_values(group, estimate)).collect(),
        ),
        Element::Pictures(
            estimates.iter().map(|(group, estimate)| correlation::matrix(group, estimate)).collect(),
        ),
    ];
    elements.extend(
        estimates.iter().map(|(group, estimate)| Element::Table(correlation::strong(group, estimate))),
    );
    elements
}
