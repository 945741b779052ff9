//! The parameters that were estimated, with their intervals.

use etude_stage::PhysicalParams;

use super::document::{paragraph, table};
use super::input::ReportInput;
use super::number::number;
use crate::estimate::{Bound, Estimate, ParameterEstimate};
use crate::presses::Measured;

/// Tables of the estimates, one a group, and of what slow presses measured.
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
    let measured = &input.identified.measured;
    if !measured.is_empty() {
        elements.push(measured_rows(measured, input.before));
    }
    elements
}

/// What slow presses of keys have measured.
fn measured_rows(measured: &[Measured], before: &PhysicalParams) -> String {
    let row = |Measured { path, value, interval }: &Measured| {
        let [from, to] = interval.map(number);
        vec![path.clone(), unit(path), value_of(before, path), number(*value), from, to]
    };
    let columns = ["parameter", "unit", "before", "measured", "95 % from", "to"];
    table("keyboard, from the excitation `keys`", &columns, measured.iter().map(row))
}

fn unit(path: &str) -> String {
    PhysicalParams::rows()
        .find(|(known, ..)| known == path)
        .map_or_else(String::new, |(_, row, _)| row.unit.to_string())
}

fn value_of(params: &PhysicalParams, path: &str) -> String {
    params.get(path).map_or_else(|_| "–".to_string(), number)
}

fn estimated_rows(group: &str, estimate: &Estimate, before: &PhysicalParams) -> String {
    let row = |parameter: &ParameterEstimate| {
        let path = &parameter.path;
        let bound = match parameter.at_bound {
            None => "",
            Some(Bound::Low) => "lower",
            Some(Bound::High) => "upper",
        };
        vec![
            path.clone(),
            unit(path),
            value_of(before, path),
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
