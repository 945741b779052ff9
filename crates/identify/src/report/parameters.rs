//! The parameters: estimates with their intervals, and held values with the reason.

use std::collections::BTreeSet;

use etude_stage::PhysicalParams;

use super::document::{paragraph, table};
use super::held::{COLUMNS, held};
use super::input::ReportInput;
use super::number::number;
use crate::estimate::{Bound, Estimate, ParameterEstimate};

/// Tables of the estimates, one a group, and of the parameters that were held.
pub(super) fn elements(input: &ReportInput<'_>) -> Vec<String> {
    let mut elements = vec![paragraph(
        "Intervals are cut at the bounds. The interval of a parameter at a bound is computed as if there were no bound. \
         Intervals account for correlated residuals and say how closely these recordings determine the parameter of this \
         simulator. Where the remaining error is far above the noise, the simulator cannot express what the robot does, and \
         its best value need not be the robot's. Intervals of the keyboard's parameters include the prior: that each \
         lies near its start value.",
    )];
    let estimates = &input.identified.estimates;
    elements.extend(estimates.iter().map(|(group, estimate)| estimated_rows(group, estimate, input.before)));
    let paths = estimates.iter().flat_map(|(_, estimate)| &estimate.parameters);
    let estimated: BTreeSet<&str> = paths.map(|parameter| parameter.path.as_str()).collect();
    elements.push(table("Held at these values", &COLUMNS, held(&estimated, input.after)));
    elements
}

fn estimated_rows(group: &str, estimate: &Estimate, before: &PhysicalParams) -> String {
    let row = |parameter: &ParameterEstimate| {
        let path = &parameter.path;
        let known = PhysicalParams::rows().find(|(known, ..)| known == path);
        let bound = match parameter.at_bound {
            None => "",
            Some(Bound::Low) => "lower",
            Some(Bound::High) => "upper",
        };
        vec![
            path.clone(),
            known.map_or_else(String::new, |(_, row, _)| row.unit.to_string()),
            before.get(path).map_or_else(|_| "–".to_string(), number),
            number(parameter.value),
            number(parameter.interval[0]),
            number(parameter.interval[1]),
            bound.to_string(),
            if parameter.is_identifiable { "yes" } else { "no" }.to_string(),
        ]
    };
    let columns = ["parameter", "unit", "before", "after", "95 % from", "to", "at bound", "identifiable"];
    table(group, &columns, estimate.parameters.iter().map(row))
}
