//! The simulator's parameters on the page of a rehearsal.

use etude_lab::Iteration;
use etude_stage::PhysicalParams;
use maud::{Markup, html};

use crate::figure::short;
use crate::html::table;

/// Every parameter that an iteration has changed.
pub(super) fn parameters(iterations: &[&Iteration]) -> Markup {
    let fitted: Vec<&&Iteration> =
        iterations.iter().filter(|iteration| !iteration.physics.is_empty()).collect();
    if fitted.is_empty() {
        return Markup::default();
    }
    let mut columns = ["parameter", "unit", "default"].map(String::from).to_vec();
    columns.extend(fitted.iter().map(|iteration| format!("iteration {}", iteration.iteration)));
    let changed = PhysicalParams::rows()
        .filter(|(path, _, _)| fitted.iter().any(|iteration| iteration.physics.contains_key(path)));
    let rows = changed.map(|(path, row, default)| {
        let values = fitted.iter().map(|iteration| iteration.physics.get(&path).copied().unwrap_or(default));
        let values: Vec<String> = values.map(|value| short(value, 6)).collect();
        [vec![path, row.unit.to_string(), short(default, 6)], values].concat()
    });
    let rows: Vec<_> = rows.collect();
    html! {
        section {
            h2 { "The simulator’s parameters" }
            details {
                summary { "Parameters changed by the fits: " (rows.len()) }
                (table("The default simulator and the iterations", &columns, rows))
            }
        }
    }
}
