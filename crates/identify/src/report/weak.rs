//! Directions that the data do not tell, and what to record so that they do.

use super::advice::{Advice, advice, row_of};
use super::correlation::short;
use super::document::{Element, Table, numbers, words};
use super::number::number;
use crate::estimate::WeakDirection;
use crate::identification::Identified;

/// Half a 95 % interval, in standard errors.
const HALF_INTERVAL: f64 = 1.96;
/// Beyond so many ranges it does not matter how many.
const MOST_RANGES: f64 = 10.0;

/// What is not identifiable, and which motion would make it so.
pub(super) fn elements(identified: &Identified) -> Vec<Element> {
    let directions: Vec<(&str, &WeakDirection)> = (identified.estimates.iter())
        .flat_map(|(group, estimate)| estimate.weak.iter().map(move |weak| (group.as_str(), weak)))
        .collect();
    if directions.is_empty() {
        return vec![Element::Paragraph(
            "Nothing among what was estimated: every direction of the parameters shows in these recordings."
                .to_string(),
        )];
    }
    // In the order in which they are met; the tables refer to them by number.
    let mut used: Vec<(&'static Advice, Vec<String>)> = Vec::new();
    let mut rows = Vec::new();
    for (group, weak) in directions {
        let mut refer = Vec::new();
        for advice in advice(weak.parts.iter().map(|(path, _)| path.as_str())) {
            let place = used.iter().position(|(known, _)| *known == advice).unwrap_or_else(|| {
                used.push((advice, Vec::new()));
                used.len() - 1
            });
            refer.push((place + 1).to_string());
            let concerned = weak.parts.iter().filter(|(path, _)| advice.rows.contains(&row_of(path)));
            for owner in concerned.filter_map(|(path, _)| owner(path)) {
                if !used[place].1.contains(&owner) {
                    used[place].1.push(owner);
                }
            }
        }
        rows.push(vec![group.to_string(), parts(weak), half_interval(weak), refer.join(", ")]);
    }
    let advice = used.into_iter().enumerate().map(|(index, (advice, owners))| {
        vec![
            (index + 1).to_string(),
            advice.rows.join(", "),
            owners.join(", "),
            advice.why.to_string(),
            advice.motion.to_string(),
        ]
    });
    vec![
        Element::Paragraph(
            "Along each of these directions the parameters can move together (with these signs and shares, \
             each on its own scale from bound to bound) and the residuals hardly show it."
                .to_string(),
        ),
        Element::Table(Table {
            caption: "What is not identifiable, the weakest of each group first".to_string(),
            columns: vec![
                words("group"),
                words("direction"),
                numbers("95 % ± (ranges)"),
                numbers("what would tell it"),
            ],
            rows,
        }),
        Element::Table(Table {
            caption: "Which motion would make it so".to_string(),
            columns: vec![
                numbers("no."),
                words("rows"),
                words("joints"),
                words("why these recordings do not tell it"),
                words("record"),
            ],
            rows: advice.collect(),
        }),
    ]
}

/// The joint that a path is of.
fn owner(path: &str) -> Option<String> {
    path.strip_prefix("joint.")?.split('.').next().map(str::to_string)
}

fn half_interval(weak: &WeakDirection) -> String {
    let half = HALF_INTERVAL * weak.standard_error;
    if half > MOST_RANGES { format!("> {MOST_RANGES}") } else { number(half) }
}

/// The parts of a direction, the largest first and positive.
fn parts(weak: &WeakDirection) -> String {
    let sign = weak.parts.first().map_or(1.0, |(_, component)| component.signum());
    let one = |(path, component): &(String, f64)| format!("{:+.2} {}", sign * component, short(path));
    weak.parts.iter().map(one).collect::<Vec<_>>().join(", ")
}
