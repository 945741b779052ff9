//! The numbers: estimated with their intervals, and held with the reason.

use std::collections::BTreeSet;

use etude_stage::PhysicalParams;

use super::ReportInput;
use super::document::{Element, Table, numbers, words};
use super::held::held;
use super::number::{number, unit};
use crate::estimate::{Bound, Estimate};

/// Tables of what was estimated, one a group, and of what was held.
pub(super) fn elements(input: &ReportInput<'_>) -> Vec<Element> {
    let mut elements = vec![Element::Paragraph(
        "Intervals are cut at the bounds; that of a number at a bound is computed as if the bound were not \
         there. They count correlated residuals once and say how closely these recordings tie the number \
         down in this simulator; where what is left is far above the noise, the simulator is another machine \
         than the robot, and its best number need not be the robot's. Those of the keyboard include what was \
         believed before any key was touched: that each lies near where it started."
            .to_string(),
    )];
    for (group, estimate) in &input.identified.estimates {
        elements.push(Element::Table(table(group, estimate, input.before)));
    }
    let estimated: BTreeSet<&str> = (input.identified.estimates.iter())
        .flat_map(|(_, estimate)| &estimate.parameters)
        .map(|parameter| parameter.path.as_str())
        .collect();
    elements.push(Element::Table(held(&estimated, input.after)));
    elements
}

fn table(group: &str, estimate: &Estimate, before: &PhysicalParams) -> Table {
    let row = |parameter: &crate::ParameterEstimate| {
        let path = &parameter.path;
        let unit =
            PhysicalParams::rows().find(|(known, ..)| known == path).map(|(_, row, _)| unit(path, row));
        let bound = match parameter.at_bound {
            None => "",
            Some(Bound::Low) => "lower",
            Some(Bound::High) => "upper",
        };
        vec![
            path.clone(),
            unit.unwrap_or_default(),
            before.get(path).map_or_else(|_| "–".to_string(), number),
            number(parameter.value),
            number(parameter.interval[0]),
            number(parameter.interval[1]),
            bound.to_string(),
            if parameter.is_identifiable { "yes" } else { "no" }.to_string(),
        ]
    };
    Table {
        caption: group.to_string(),
        columns: vec![
            words("parameter"),
            words("unit"),
            numbers("before"),
            numbers("after"),
            numbers("95 % from"),
            numbers("to"),
            words("at bound"),
            words("identifiable"),
        ],
        rows: estimate.parameters.iter().map(row).collect(),
    }
}
