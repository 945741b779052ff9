//! Correlations of a group's parameters: a drawing, and a table of the strong ones.

use std::fmt::Write as _;

use super::document::{Picture, Table, numbers, words};
use super::html::escape;
use super::number::number;
use crate::estimate::Estimate;

/// Correlations from here on are named.
const STRONG: f64 = 0.9;
/// The strongest are named, no more than so many.
const MOST_NAMED: usize = 12;
/// Weaker ones are not drawn.
const DRAWN: f64 = 0.1;
/// Side of a cell, and room for names, in units of the drawing.
const CELL: f64 = 16.0;
const NAMES: f64 = 150.0;

/// A path without what all of them begin with.
pub(super) fn short(path: &str) -> &str {
    path.strip_prefix("joint.").unwrap_or(path)
}

/// Strong correlations, the strongest first; how many there are beyond those is in the caption.
pub(super) fn strong(group: &str, estimate: &Estimate) -> Table {
    let mut pairs: Vec<(f64, String)> = Vec::new();
    for (i, row) in estimate.correlation.iter().enumerate() {
        for (j, &r) in row.iter().enumerate().take(i) {
            if r.abs() >= STRONG
                && let (Some(a), Some(b)) = (estimate.parameters.get(j), estimate.parameters.get(i))
            {
                pairs.push((r, format!("{} and {}", short(&a.path), short(&b.path))));
            }
        }
    }
    pairs.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
    let all = pairs.len();
    pairs.truncate(MOST_NAMED);
    let caption = match all {
        0 => format!("{group}: no two parameters correlate by {STRONG} or more"),
        _ if all > pairs.len() => {
            format!("{group}: the strongest {} of {all} correlations of {STRONG} or more", pairs.len())
        }
        _ => format!("{group}: correlations of {STRONG} or more"),
    };
    let row = |(r, names): (f64, String)| vec![names, format!("{r:+.3}")];
    Table {
        caption,
        columns: vec![words("parameters"), numbers("correlation")],
        rows: pairs.into_iter().map(row).collect(),
    }
}

/// The matrix: a square as large as the correlation, filled where it is positive and hollow where it is
/// negative.
pub(super) fn matrix(group: &str, estimate: &Estimate) -> Picture {
    let count = estimate.parameters.len() as f64;
    let (width, height) = (NAMES + CELL * count + 6.0, CELL * count + 24.0);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" role=\"img\" \
         style=\"width:{width}px\" aria-label=\"correlations of the parameters of {}\">",
        escape(group)
    );
    // Writing to a string cannot fail.
    for (i, parameter) in estimate.parameters.iter().enumerate() {
        let y = CELL * (i as f64 + 0.75);
        let name = escape(short(&parameter.path));
        let _ = write!(
            svg,
            "<text x=\"{:.0}\" y=\"{y:.0}\" text-anchor=\"end\">{name} {}</text>",
            NAMES - 4.0,
            i + 1
        );
        let x = NAMES + CELL * (i as f64 + 0.5);
        let _ = write!(
            svg,
            "<text x=\"{x:.0}\" y=\"{:.0}\" text-anchor=\"middle\" font-size=\"9\">{}</text>",
            CELL * count + 12.0,
            i + 1
        );
        for (j, &r) in estimate.correlation.get(i).into_iter().flatten().enumerate().take(i + 1) {
            if !(DRAWN..=1.0).contains(&r.abs()) {
                continue;
            }
            let side = (CELL - 2.0) * r.abs().sqrt();
            let from = |place: usize| CELL * (place as f64 + 0.5) - side / 2.0;
            let class = if r > 0.0 { "plus" } else { "minus" };
            let _ = write!(
                svg,
                "<rect class=\"{class}\" x=\"{:.1}\" y=\"{:.1}\" width=\"{side:.1}\" height=\"{side:.1}\"/>",
                NAMES + from(j),
                from(i)
            );
        }
    }
    svg.push_str("</svg>");
    Picture {
        svg,
        caption: format!(
            "{group}: the area of a square is the size of the correlation; filled is positive, hollow \
             negative"
        ),
    }
}

/// Singular values of a group's Jacobian in words.
pub(super) fn singular_values(group: &str, estimate: &Estimate) -> String {
    let values: Vec<String> = estimate.singular_values.iter().map(|value| number(*value)).collect();
    format!("{group}: condition {}; singular values {}", number(estimate.condition), values.join(", "))
}
