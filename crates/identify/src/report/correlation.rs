//! Correlations of a group's parameters.

use super::document::{list, paragraph, table};
use super::number::number;
use crate::estimate::Estimate;

/// Correlations from this size on are listed.
const STRONG: f64 = 0.9;
/// So many of each group at most.
const MAX_LISTED: usize = 12;

/// A path without the prefix that all joints share.
pub(super) fn short(path: &str) -> &str {
    path.strip_prefix("joint.").unwrap_or(path)
}

/// Singular values, and the strong correlations of each group.
pub(super) fn elements(estimates: &[(String, Estimate)]) -> Vec<String> {
    let values = |(group, estimate): &(String, Estimate)| {
        let values: Vec<String> = estimate.singular_values.iter().map(|value| number(*value)).collect();
        format!("{group}: condition {}; singular values {}", number(estimate.condition), values.join(", "))
    };
    vec![
        paragraph(
            "Correlations of the estimates' errors, by linear theory at the end of the fit. Two strongly correlated \
             parameters are known better together than each by itself. A singular value is the change of the residuals, in \
             standard deviations of the noise, for a move over the whole range along one direction of the parameters. \
             The condition is the largest over the smallest. identification.json has the whole matrices.",
        ),
        list(&estimates.iter().map(values).collect::<Vec<_>>()),
        table(
            &format!("Correlations of {STRONG} or more, at most {MAX_LISTED} a group, the strongest first"),
            &["group", "parameters", "correlation"],
            estimates.iter().flat_map(|(group, estimate)| strong(group, estimate)),
        ),
    ]
}

fn strong(group: &str, estimate: &Estimate) -> Vec<Vec<String>> {
    let name = |index: usize| short(&estimate.parameters[index].path);
    let mut pairs: Vec<(f64, String)> = Vec::new();
    for (i, row) in estimate.correlation.iter().enumerate() {
        let strong = row.iter().enumerate().take(i).filter(|(_, r)| r.abs() >= STRONG);
        pairs.extend(strong.map(|(j, r)| (*r, format!("{} and {}", name(j), name(i)))));
    }
    pairs.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
    pairs.truncate(MAX_LISTED);
    pairs.into_iter().map(|(r, names)| vec![group.to_string(), names, format!("{r:+.3}")]).collect()
}
