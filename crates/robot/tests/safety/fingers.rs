//! The controller's own measures of the fingers, and its interlock, against those of the simulated
//! world.

use etude_robot::allegro::{self, tip_depths};
use etude_robot::{MAX_AHEAD_M, ROOTS_OVER_KEYS_M, drag_ways_m};
use etude_stage::geometry::WHITE;
use etude_stage::hand::{MOUNT, TIP_RADIUS};
use etude_stage::{DRIVEN_JOINTS, PhysicalParams, Side, StageConfig, World};
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..Default::default() })]
    #[test]
    fn a_fingertip_is_as_low_as_in_the_world(
        rolls in prop::array::uniform3(-0.47..0.47_f64),
        // Above the keys.
        bends in prop::array::uniform9(-0.17..0.25_f64),
        rail in -0.3..0.3_f64,
    ) {
        let mut pose = [0.0; DRIVEN_JOINTS];
        for finger in 0..3 {
            pose[4 * finger] = rolls[finger];
            pose[4 * finger + 1..4 * finger + 4].copy_from_slice(&bends[3 * finger..3 * finger + 3]);
        }
        pose[DRIVEN_JOINTS - 1] = rail;
        let mut positions = [0.0; allegro::WIRE_JOINTS];
        positions[..12].copy_from_slice(&pose[..12]);
        let mut world = World::new(&StageConfig::default(), &PhysicalParams::default()).unwrap();
        world.reset_to(&pose);
        for (finger, depth) in tip_depths(&positions).into_iter().enumerate() {
            let lowest = world.fingertip(finger)[2] - TIP_RADIUS;
            prop_assert!((MOUNT[1] - depth - lowest).abs() < 1e-6, "{depth} and {lowest} m");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2_000, ..Default::default() })]
    #[test]
    fn the_simulators_interlock_is_that_of_the_rig(
        rolls in prop::array::uniform3(-0.47..0.47_f64),
        // From above the keys to below their stops.
        bends in prop::array::uniform9(0.2..0.8_f64),
        behind in prop::array::uniform3(-0.5..0.5_f64),
    ) {
        let (mut pose, mut references) = ([0.0; DRIVEN_JOINTS], [0.0; DRIVEN_JOINTS]);
        for finger in 0..3 {
            pose[4 * finger] = rolls[finger];
            pose[4 * finger + 1..4 * finger + 4].copy_from_slice(&bends[3 * finger..3 * finger + 3]);
            references[4 * finger] = rolls[finger] - behind[finger];
        }
        let on_the_wire = |joints: [f64; DRIVEN_JOINTS]| {
            let mut wire = [0.0; allegro::WIRE_JOINTS];
            wire[..12].copy_from_slice(&joints[..12]);
            wire
        };
        let rigs = drag_ways_m(&on_the_wire(pose), &on_the_wire(references));
        for side in [Side::Left, Side::Right] {
            let ours = etude_stage::drag_ways_m(side, &pose, &references);
            for (rig, ours) in rigs.into_iter().zip(ours) {
                prop_assert!(rig == ours || (rig - ours).abs() < 1e-9, "{rigs:?} and {ours:?}");
            }
        }
    }
}

#[test]
fn the_roots_of_the_fingers_are_as_high_over_the_keys() {
    assert!((MOUNT[1] - WHITE.top() - ROOTS_OVER_KEYS_M).abs() < 1e-12);
    assert_eq!(MAX_AHEAD_M, etude_stage::MAX_AHEAD_M);
}
