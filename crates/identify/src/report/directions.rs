//! Directions of the parameters that are not identifiable, and which motion would make them so.

use super::advice::{Advice, advice, row_of};
use super::correlation::short;
use super::document::{paragraph, table};
use super::number::number;
use crate::estimate::{HALF_INTERVAL, WeakDirection};
use crate::identification::Identified;

/// Wider intervals are printed as wider than this, in ranges.
const MAX_RANGES: f64 = 10.0;

/// Tables of the weak directions and of the advice.
pub(super) fn elements(identified: &Identified) -> Vec<String> {
    // Advice in the order of its first use; the first table refers to it by number.
    let mut used: Vec<(&'static Advice, Vec<String>)> = Vec::new();
    let mut rows = Vec::new();
    for (group, estimate) in &identified.estimates {
        for weak in &estimate.weak {
            let mut refer = Vec::new();
            for advice in advice(weak.parts.iter().map(|(path, _)| path.as_str())) {
                let index = used.iter().position(|(known, _)| *known == advice).unwrap_or_else(|| {
                    used.push((advice, Vec::new()));
                    used.len() - 1
                });
                refer.push((index + 1).to_string());
                let concerned = weak.parts.iter().filter(|(path, _)| advice.rows.contains(&row_of(path)));
                for joint in concerned.filter_map(|(path, _)| joint_of(path)) {
                    if !used[index].1.contains(&joint) {
                        used[index].1.push(joint);
                    }
                }
            }
            rows.push(vec![group.clone(), parts(weak), half_interval(weak), refer.join(", ")]);
        }
    }
    if rows.is_empty() {
        return vec![paragraph("Every direction of the estimated parameters is identifiable.")];
    }
    let advice = used.into_iter().enumerate().map(|(index, (advice, joints))| {
        let number = (index + 1).to_string();
        vec![
            number,
            advice.rows.join(", "),
            joints.join(", "),
            advice.why.to_string(),
            advice.motion.to_string(),
        ]
    });
    vec![
        paragraph(
            "Along each of these directions the parameters can move together (with these signs and shares, each on its own \
             scale from bound to bound) and the residuals hardly change.",
        ),
        table(
            "What is not identifiable, the weakest direction of each group first",
            &["group", "direction", "95 % ± (ranges)", "advice"],
            rows,
        ),
        table(
            "Which motion would make it identifiable",
            &["no.", "rows", "joints", "why it is not identifiable", "record"],
            advice,
        ),
    ]
}

fn joint_of(path: &str) -> Option<String> {
    path.strip_prefix("joint.")?.split('.').next().map(str::to_string)
}

fn half_interval(weak: &WeakDirection) -> String {
    let half = HALF_INTERVAL * weak.standard_error;
    if half > MAX_RANGES { format!("> {MAX_RANGES}") } else { number(half) }
}

/// The parts of a direction, the largest first and positive.
fn parts(weak: &WeakDirection) -> String {
    let sign = weak.parts.first().map_or(1.0, |(_, component)| component.signum());
    let one = |(path, component): &(String, f64)| format!("{:+.2} {}", sign * component, short(path));
    weak.parts.iter().map(one).collect::<Vec<_>>().join(", ")
}
