//! Changing the numbers of a world that stands is the same as building it with them: randomisation
//! rests on it.

use etude_stage::{PhysicalParams, StageConfig, World};
use proptest::prelude::*;

use crate::bench::{self, Gesture, all_targets};

/// Values for every row: its default times a factor, or for rows about zero a small share of the
/// range.
fn params() -> impl Strategy<Value = PhysicalParams> {
    let rows = PhysicalParams::rows().count();
    prop::collection::vec(0.0f64..1.0, rows).prop_map(|shares| {
        let mut params = PhysicalParams::default();
        for ((path, row, default), share) in PhysicalParams::rows().zip(shares) {
            let value = if default == 0.0 {
                let [low, high] = [row.range[0].max(-0.05), row.range[1].min(0.05)];
                low + share * (high - low)
            } else {
                default * (0.6 + 0.9 * share)
            };
            params.set(&path, value.clamp(row.range[0], row.range[1])).unwrap();
        }
        params
    })
}

proptest! {
    #![proptest_config(bench::cases(12))]
    #[test]
    fn set_params_is_building_anew(
        config in bench::config(),
        params in params(),
        before in bench::gestures(),
        after in bench::gestures(),
    ) {
        let mut changed = World::new(&config, &PhysicalParams::default()).unwrap();
        for targets in all_targets(&changed, &before) {
            changed.step(&targets);
        }
        changed.set_params(&params);
        changed.reset();
        let mut fresh = World::new(&config, &params).unwrap();
        prop_assert_eq!(changed.start_pose(), fresh.start_pose());
        for targets in all_targets(&fresh, &after) {
            prop_assert_eq!(changed.step(&targets), fresh.step(&targets));
            prop_assert_eq!(changed.snapshot(), fresh.snapshot());
            prop_assert_eq!(changed.events(), fresh.events());
        }
    }
}

/// One row at a time, so that a number which is forgotten is named.
#[test]
fn every_row_takes_effect_without_building_anew() {
    let config = StageConfig::default();
    let press = |key, height| Gesture::Reach { finger: 1, key, height, steps: 8 };
    let gestures = [press(24, -0.012), press(25, -0.01), Gesture::Fling { shares: [0.9; 13], steps: 4 }];
    let play = |world: &mut World| {
        let targets = all_targets(&bench::nominal(), &gestures);
        for targets in targets {
            world.step(&targets);
        }
        world.snapshot()
    };
    let nominal = play(&mut bench::nominal());
    let mut world = bench::nominal();
    let mut wrong = Vec::new();
    for (path, row, default) in PhysicalParams::rows() {
        let value = match default {
            0.0 => 0.1 * row.range[1],
            _ if 0.7 * default < row.range[0] => 1.5 * default,
            _ => 0.7 * default,
        };
        let mut params = PhysicalParams::default();
        params.set(&path, value).unwrap();
        world.set_params(&params);
        world.reset();
        let changed = play(&mut world);
        if changed != play(&mut World::new(&config, &params).unwrap()) {
            wrong.push(format!("{path}: not as built anew"));
        }
        // The thresholds change what sounds, not what moves; limits that are never met change nothing,
        // nor does a multiple of no friction.
        let unseen = [
            "key.threshold",
            "key.hysteresis",
            "torque_limit",
            "velocity_limit",
            "acceleration_limit",
            "jerk_limit",
            "friction_at_rest",
        ];
        if changed == nominal && !unseen.iter().any(|name| path.ends_with(name)) {
            wrong.push(format!("{path}: no effect"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
