//! Which parameters were fixed, and why.

use std::collections::{BTreeMap, BTreeSet};

use etude_stage::{DRIVEN_JOINTS, JOINT_NAMES, PhysicalParams, RAIL};

use super::number::number;

/// Columns of the parameters without an estimate.
pub(super) const COLUMNS: [&str; 5] = ["row", "joints", "value", "unit", "why it was fixed"];

/// The parameters without an estimate: rows of a table.
pub(super) fn fixed(estimated: &BTreeSet<&str>, params: &PhysicalParams) -> Vec<Vec<String>> {
    // Rows of joints that are fixed for the same reason are one line; the order is that of the
    // rows.
    let mut lines: Vec<(String, String, &'static str)> = Vec::new();
    let mut joints: BTreeMap<(String, &'static str), Vec<(usize, f64)>> = BTreeMap::new();
    for (path, row, default) in PhysicalParams::rows() {
        if estimated.contains(path.as_str()) {
            continue;
        }
        let why = why(&path, estimated);
        let key = match joint_of(&path) {
            // The rail has other units and defaults than the fingers.
            Some(RAIL) | None => path.clone(),
            Some(_) => format!("joint.*.{}", row.name),
        };
        let value = params.get(&path).unwrap_or(default);
        let of_row = joints.entry((key.clone(), why)).or_default();
        if of_row.is_empty() {
            lines.push((key, row.unit.to_string(), why));
        }
        of_row.push((joint_of(&path).unwrap_or(DRIVEN_JOINTS), value));
    }
    let line = |(key, unit, why): (String, String, &'static str)| {
        let fixed = joints.get(&(key.clone(), why)).map_or(&[][..], Vec::as_slice);
        let low = fixed.iter().map(|(_, value)| *value).fold(f64::INFINITY, f64::min);
        let high = fixed.iter().map(|(_, value)| *value).fold(f64::NEG_INFINITY, f64::max);
        let value = if low < high { format!("{} … {}", number(low), number(high)) } else { number(low) };
        let names: Vec<&str> =
            fixed.iter().filter_map(|(joint, _)| JOINT_NAMES.get(*joint).copied()).collect();
        let of = match names.len() {
            _ if !key.contains('*') => String::new(),
            RAIL => "all of the fingers".to_string(),
            _ => names.join(", "),
        };
        vec![key, of, value, unit, why.to_string()]
    };
    lines.into_iter().map(line).collect()
}

fn joint_of(path: &str) -> Option<usize> {
    let name = path.strip_prefix("joint.")?.split('.').next()?;
    JOINT_NAMES.iter().position(|joint| *joint == name)
}

const LIMITED: &str = "Étude limits a robot's commands to it; it is the value of the rig's file";

/// Why a row was not estimated (`parameter_bounds.rs` decides that).
fn why(path: &str, estimated: &BTreeSet<&str>) -> &'static str {
    let touches = estimated.contains("key.threshold");
    let Some(joint) = joint_of(path) else {
        return match path {
            "key.armature" | "key.friction" | "hand.start" => "it hardly changes which keys sound, and when",
            "rail.key_down_velocity" => LIMITED,
            "key.hysteresis" => {
                "what is played shows one contact only: slow presses show both (`etude record --excitation keys`)"
            }
            "key.preload" => {
                "what is played shows it only with the threshold: slow presses show it (`etude record --excitation keys`)"
            }
            "keyboard.lateral" | "keyboard.depth" => {
                "what is played does not show it: the excitation `keys` does"
            }
            _ if touches => "no fit estimates it",
            _ => "no recording that was fitted touches a key",
        };
    };
    match super::advice::row_of(path) {
        "velocity_limit" | "acceleration_limit" => LIMITED,
        "viscosity" if joint == RAIL => "it has the same effect as the damping",
        "encoder_bias" if joint == RAIL => "it has the same effect as keyboard.lateral",
        "encoder_bias" if joint % etude_stage::hand::JOINTS_PER_FINGER == 0 => {
            "what is played does not show it: the excitation `keys` does"
        }
        "encoder_bias" if !touches => "only recordings that touch keys identify it, and none was fitted",
        "encoder_bias" => {
            "keys show only where a fingertip is: the biases that are estimated stand for all of its joints"
        }
        "armature" if joint == RAIL => "it scales with the rail's gains: one of them must be given",
        "torque_limit" if joint == RAIL => "the arm does not report when its drive is at its limit",
        _ if !estimated.contains(format!("joint.{}.stiffness", JOINT_NAMES[joint]).as_str()) => {
            "the joint does not move in any recording that was fitted without touching keys"
        }
        "damping" | "torque_limit" => "it is scaled with the stiffness: both belong to one motor",
        _ => "no fit estimates it",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameter_bounds::{contact_parameters, joint_parameters};

    #[test]
    fn every_row_is_estimated_or_fixed_for_a_reason() {
        let before = PhysicalParams::default();
        for (touches, moving) in [(true, 0..=RAIL), (false, 0..=RAIL), (true, 4..=7), (true, 0..=0)] {
            let mut paths: Vec<String> = moving
                .flat_map(|joint| joint_parameters(joint, &before))
                .map(|parameter| parameter.path)
                .collect();
            if touches {
                paths.extend(contact_parameters(&before).into_iter().map(|parameter| parameter.path));
            }
            let estimated: BTreeSet<&str> = paths.iter().map(String::as_str).collect();
            let rows = fixed(&estimated, &before);
            assert!(rows.iter().all(|row| row.len() == COLUMNS.len()));
            for (path, row, _) in PhysicalParams::rows() {
                if estimated.contains(path.as_str()) {
                    continue;
                }
                assert_ne!(why(&path, &estimated), "no fit estimates it", "{path}");
                let joint = path.split('.').nth(1).unwrap_or_default();
                let shown = |cells: &Vec<String>| {
                    cells[0] == path
                        || cells[0] == format!("joint.*.{}", row.name)
                            && (cells[1].starts_with("all") || cells[1].split(", ").any(|name| name == joint))
                };
                assert!(rows.iter().any(shown), "{path}");
            }
        }
    }
}
