//! The simulator's numbers on the page of a rehearsal: what changed most in words, and all of them
//! behind a fold.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use etude_lab::Iteration;
use etude_stage::PhysicalParams;
use maud::{Markup, html};

use crate::html::table;

/// Quantities that are named of those that have changed most.
const NAMED: usize = 3;

/// A number that an iteration has changed.
struct Changed {
    path: String,
    unit: &'static str,
    default: f64,
    value: f64,
}

impl Changed {
    /// The joint that has it; none for a number of the world.
    fn joint(&self) -> Option<&str> {
        Some(self.path.strip_prefix("joint.")?.split_once('.')?.0)
    }

    /// What it is, whichever joint has it.
    fn quantity(&self) -> String {
        let name = match self.joint() {
            Some(_) => self.path.rsplit('.').next().unwrap_or(&self.path),
            None => &self.path,
        };
        name.replace(['.', '_'], " ")
    }

    fn with_unit(&self, value: f64) -> String {
        // A ratio has the unit 1.
        if self.unit == "1" { number(value) } else { format!("{} {}", number(value), self.unit) }
    }

    /// By how many times it is another, up or down, as a logarithm. None of one that is zero, or
    /// whose sign has changed.
    fn times(&self) -> Option<f64> {
        let times = (self.value / self.default).ln().abs();
        times.is_finite().then_some(times)
    }
}

/// Every parameter that an iteration has changed.
pub(super) fn numbers(iterations: &[&Iteration]) -> Markup {
    let fitted: Vec<&&Iteration> =
        iterations.iter().filter(|iteration| !iteration.physics.is_empty()).collect();
    let Some(last) = fitted.last() else { return Markup::default() };
    let mut columns = ["parameter", "unit", "default"].map(String::from).to_vec();
    columns.extend(fitted.iter().map(|iteration| format!("iteration {}", iteration.iteration)));
    let changed = PhysicalParams::rows()
        .filter(|(path, _, _)| fitted.iter().any(|iteration| iteration.physics.contains_key(path)));
    let rows = changed.map(|(path, row, default)| {
        let values = fitted.iter().map(|iteration| iteration.physics.get(&path).copied().unwrap_or(default));
        let values: Vec<String> = values.map(number).collect();
        [vec![path, row.unit.to_string(), number(default)], values].concat()
    });
    let rows: Vec<_> = rows.collect();
    html! {
        section {
            h2 { "The simulator’s parameters" }
            p { (in_words(last)) }
            details {
                summary { "Changed parameters: " (rows.len()) }
                (table("The default simulator and the iterations", &columns, rows))
            }
        }
    }
}

/// What an iteration has changed most.
fn in_words(iteration: &Iteration) -> String {
    let mut by_quantity: BTreeMap<String, Vec<Changed>> = BTreeMap::new();
    let mut count = 0;
    for (path, row, default) in PhysicalParams::rows() {
        if let Some(value) = iteration.physics.get(&path).filter(|value| **value != default) {
            let changed = Changed { path, unit: row.unit, default, value: *value };
            by_quantity.entry(changed.quantity()).or_default().push(changed);
            count += 1;
        }
    }
    // Of a quantity that is zero in the default simulator nobody can say how many times it is
    // another.
    let (new, mut other): (Vec<_>, Vec<_>) =
        by_quantity.into_iter().partition(|(_, all)| all.iter().all(|number| number.default == 0.0));
    other.sort_by(|(_, one), (_, two)| most(two).total_cmp(&most(one)));
    other.truncate(NAMED);
    let new: Vec<String> =
        new.iter().take(NAMED).map(|(name, all)| format!("{name} ({})", largest(all))).collect();
    let other: Vec<String> = other
        .iter()
        .filter(|(_, all)| most(all) > 0.0)
        .filter_map(|(name, all)| {
            let most = all.iter().filter(|number| number.times().is_some());
            let most =
                most.max_by(|one, two| one.times().partial_cmp(&two.times()).unwrap_or(Ordering::Equal))?;
            let of = most.joint().map_or_else(String::new, |joint| format!(" of {}", name_of(joint)));
            Some(format!("{name}{of}, from {} to {}", number(most.default), most.with_unit(most.value)))
        })
        .collect();
    let mut text =
        format!("Iteration {} changes {count} parameters of the default simulator.", iteration.iteration);
    if !other.is_empty() {
        text += &format!(" Changed most: {}.", other.join("; "));
    }
    if !new.is_empty() {
        text += &format!(" Not zero any more: {}.", new.join("; "));
    }
    text
}

fn most(all: &[Changed]) -> f64 {
    all.iter().filter_map(Changed::times).fold(0.0, f64::max)
}

/// The largest value, and whose it is.
fn largest(all: &[Changed]) -> String {
    let Some(most) = all.iter().max_by(|one, two| one.value.abs().total_cmp(&two.value.abs())) else {
        return String::new();
    };
    let value = most.with_unit(most.value);
    match most.joint() {
        Some(joint) if all.len() > 1 => {
            format!("{} joints, largest for {}: {value}", all.len(), name_of(joint))
        }
        Some(joint) => format!("{}: {value}", name_of(joint)),
        None => value,
    }
}

/// A joint's name as a word: `the rail`, `index_1`.
fn name_of(joint: &str) -> String {
    if joint == "rail" { "the rail".to_string() } else { joint.to_string() }
}

/// Four significant digits.
fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".to_string();
    }
    let digits = 3 - value.abs().log10().floor() as i32;
    format!("{value:.*}", digits.clamp(0, 9) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_changed_most_is_said_in_words() {
        let physics = [
            ("joint.rail.jerk_limit", 142.5),
            ("joint.index_1.jerk_limit", 190_000.0),
            ("key.threshold", 0.55),
            ("joint.index_1.delay", 0.0123),
            ("joint.ring_2.delay", 0.004),
            ("keyboard.height", -0.002),
        ];
        let physics = physics.map(|(path, value)| (path.to_string(), value));
        let iteration =
            Iteration { iteration: 2, physics: physics.into(), ..super::super::tests::iteration(2) };
        assert_eq!(
            in_words(&iteration),
            "Iteration 2 changes 6 parameters of the default simulator. Changed most: jerk limit of the rail, from 1425 to 142.5 \
             m/s³; key threshold, from 0.5000 to 0.5500 fraction of travel. Not zero any more: delay (2 joints, largest for index_1: \
             0.01230 s); keyboard height (-0.002000 m)."
        );
    }

    /// Nobody can say how many times a number is another that was zero or has another sign.
    #[test]
    fn a_number_without_a_ratio_is_not_the_one_that_changed_most() {
        let number =
            |default, value| Changed { path: "joint.index_1.delay".to_string(), unit: "s", default, value };
        assert!([(0.0, 0.1), (0.1, -0.1), (0.1, 0.0)].map(|(a, b)| number(a, b).times()) == [None; 3]);
        assert!((number(2.0, 1.0).times().unwrap() - 2.0_f64.ln()).abs() < 1e-12);
        assert!(most(&[number(0.0, 0.1), number(0.1, 0.2)]) < 1.0);
    }
}
