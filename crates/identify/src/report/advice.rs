//! Which motion would identify parameters that the recordings do not: a table from parameters to
//! advice.

/// Why parameters are not identifiable, and what to record.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Advice {
    /// Parameters: the last part of a joint's path, or the whole path of another parameter.
    pub rows: &'static [&'static str],
    /// The advice applies if at least so many of them take part in a direction.
    least: usize,
    /// Why the recordings do not identify them.
    pub why: &'static str,
    /// What to record.
    pub motion: &'static str,
}

/// Advice for combined parameters comes before that for single ones.
const ADVICE: &[Advice] = &[
    Advice {
        rows: &["stiffness", "viscosity", "friction", "armature"],
        least: 3,
        why: "together they are one scale of torque: multiplied by the same factor they move the joint in \
              the same way while its drive is below its limit",
        motion: "a motion against a known load: hold a weight, or press keys with a measured spring; otherwise take \
                 one of them from the maker's data and trust only their ratios",
    },
    Advice {
        rows: &["delay", "low_pass", "armature", "jerk_limit"],
        least: 2,
        why: "each of them delays the joint, and slow motion shows only their total delay",
        motion: "faster sweeps: near the highest frequency that the joint follows, a delay changes only \
                 the phase, while a low-pass and inertia reduce the amplitude too; and steps, for the \
                 jerk limit",
    },
    Advice {
        rows: &["keyboard.height", "encoder_bias"],
        least: 2,
        why: "a lower keyboard and encoders that read too far make a finger reach a key in the same way",
        motion: "touch the same keys with the finger bent and stretched, and with every finger; or measure \
                 the keyboard's height",
    },
    Advice {
        rows: &["key.stiffness", "key.threshold", "key.damping"],
        least: 2,
        why: "a softer key and a lower threshold make the key sound at the same time",
        motion: "strike keys slowly and fast, and hold some halfway; or weigh a key down to where it sounds",
    },
    Advice {
        rows: &["jerk_limit"],
        least: 1,
        why: "the targets never jumped far enough for the limit to matter",
        motion: "larger and faster steps of the target: half the joint's range at once",
    },
    Advice {
        rows: &["encoder_bias"],
        least: 1,
        why: "without key contact the joint's true zero has no effect",
        motion: "pieces that touch keys, with this finger too",
    },
    Advice {
        rows: &["delay"],
        least: 1,
        why: "motion was too slow to show a few milliseconds",
        motion: "faster sweeps, and steps at irregular times",
    },
    Advice {
        rows: &["low_pass", "armature"],
        least: 1,
        why: "their effect grows with the frequency, and the motion was slow",
        motion: "faster sweeps, towards the highest frequency that the joint follows",
    },
    Advice {
        rows: &["friction_at_rest", "dead_band"],
        least: 1,
        why: "only where a joint comes to rest and breaks loose do they show, and there they are one torque",
        motion: "slow swings with many turning points, and small steps of the target of a joint that stands",
    },
    Advice {
        rows: &["load"],
        least: 1,
        why: "friction held the joint wherever it stood",
        motion: "slow swings: the load is what the drive needs on the way up and not on the way down",
    },
    Advice {
        rows: &["friction"],
        least: 1,
        why: "dry friction shows where a joint changes direction or moves slowly",
        motion: "slow swings of all sizes: many turning points, and stretches below 0.1 rad/s (0.01 m/s)",
    },
    Advice {
        rows: &["damping", "viscosity"],
        least: 1,
        why: "the joint neither rang after a step nor swung near its resonance",
        motion: "steps with a second of rest after each, and sweeps through the resonance",
    },
    Advice {
        rows: &["stiffness"],
        least: 1,
        why: "the joint followed its target equally well with any gain",
        motion: "a push against a known load or a key's spring, and sweeps through the resonance",
    },
    Advice {
        rows: &["keyboard.height"],
        least: 1,
        why: "too few keys were touched, or all in the same way",
        motion: "pieces with every finger, on white and black keys, over the whole keyboard",
    },
    Advice {
        rows: &["key.threshold", "key.stiffness", "key.damping"],
        least: 1,
        why: "too few keys were struck, or all with the same speed",
        motion: "soft and loud notes, repeated and held",
    },
];

/// The part of a path that identifies its advice.
pub(super) fn row_of(path: &str) -> &str {
    match path.strip_prefix("joint.") {
        Some(rest) => rest.split_once('.').map_or(rest, |(_, row)| row),
        None => path,
    }
}

/// The advice for the parameters of a weak direction, in the order of the table.
pub(super) fn advice<'a>(paths: impl Iterator<Item = &'a str>) -> Vec<&'static Advice> {
    let mut open: Vec<&str> = paths.map(row_of).collect();
    open.sort_unstable();
    open.dedup();
    let all = open.clone();
    let mut found = Vec::new();
    for advice in ADVICE {
        let takes_part = all.iter().filter(|row| advice.rows.contains(*row)).count() >= advice.least;
        if takes_part && open.iter().any(|row| advice.rows.contains(row)) {
            open.retain(|row| !advice.rows.contains(row));
            found.push(advice);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameter_bounds::{contact_parameters, joint_parameters};
    use etude_stage::{PhysicalParams, RAIL};
    use proptest::prelude::*;

    fn estimated() -> Vec<String> {
        let before = PhysicalParams::default();
        let drives = (0..=RAIL).flat_map(|joint| joint_parameters(joint, &before));
        drives.chain(contact_parameters(&before)).map(|parameter| parameter.path).collect()
    }

    #[test]
    fn every_estimated_row_has_advice_and_no_advice_is_idle() {
        let paths = estimated();
        for path in &paths {
            let found = advice([path.as_str()].into_iter());
            assert_eq!(found.len(), 1, "{path}");
            assert!(found[0].rows.contains(&row_of(path)));
        }
        for advice in ADVICE {
            for row in advice.rows {
                assert!(paths.iter().any(|path| row_of(path) == *row), "no row is called {row}");
            }
        }
    }

    #[test]
    fn rows_that_act_together_are_taken_together() {
        let scale =
            ["stiffness", "viscosity", "armature", "friction"].map(|row| format!("joint.ring_0.{row}"));
        let found = advice(scale.iter().map(String::as_str));
        assert_eq!(found.len(), 1);
        assert!(found[0].why.contains("scale of torque"));
        let late = advice(["joint.index_1.delay", "joint.index_1.low_pass"].into_iter());
        assert!(late.len() == 1 && late[0].motion.contains("faster sweeps"));
        assert!(
            advice(["joint.index_1.jerk_limit"].into_iter())[0].motion.contains("larger and faster steps")
        );
        assert!(advice(["no.such.row"].into_iter()).is_empty());
    }

    proptest! {
        #[test]
        fn every_direction_is_covered(
            choice in proptest::collection::vec(any::<prop::sample::Index>(), 1..9),
        ) {
            let paths = estimated();
            let choose = |index: &prop::sample::Index| paths[index.index(paths.len())].as_str();
            let chosen: Vec<&str> = choice.iter().map(choose).collect();
            let found = advice(chosen.iter().copied());
            for path in chosen {
                prop_assert!(found.iter().any(|advice| advice.rows.contains(&row_of(path))), "{path}");
            }
        }
    }
}
