//! The way to the keyboard: straight fingers first, and up from beside the keys.

use etude_robot::joints::{DRIVEN, RAIL};
use etude_robot::xarm::SafetyBox;
use etude_robot::xarm::kinematics::{ARM_JOINTS, PAPER_HOME_DEG, forward, inverse};
use etude_robot::{Fault, Phase, Robot};
use nalgebra::{Rotation3, Vector3};

use crate::bench::{Bench, path, rig};

#[test]
fn the_arm_does_not_set_out_before_the_fingers_are_straight() {
    let mut bench = Bench::new();
    bench.devices.arm.place(beside(0.0, 0.05, 0.3));
    bench.devices.guided[9] = Some(0.5);
    // Encoders that are not noisy would look as if they repeated themselves.
    bench.devices.hand.config_mut().noise_counts = 2;
    bench.start();
    bench.until(Phase::Holding, 3000);
    let stands = bench.devices.arm.joints();
    bench.robot.home(bench.now(), &[0.0; DRIVEN]).unwrap();
    bench.run(2500);
    assert_eq!((bench.robot.phase(), bench.devices.arm.joints()), (Phase::Moving, stands));
    bench.until(Phase::Fault, 3000);
    assert!(matches!(bench.robot.fault(), Some(Fault::NotFollowing { joint: 9, .. })), "{}", bench.fault());
    assert_eq!(bench.devices.arm.joints(), stands);
    // And one that gets free in time goes on.
    bench.start();
    bench.until(Phase::Holding, 3000);
    bench.robot.home(bench.now(), &[0.0; DRIVEN]).unwrap();
    bench.run(1000);
    bench.guide(9, 0.1);
    bench.until(Phase::Holding, 60_000);
    assert!(bench.robot.place().beside_m < 1e-3);
}

/// Joints of an arm beside and above a place on the path, m.
fn beside(rail_m: f64, forward_m: f64, up_m: f64) -> [f64; ARM_JOINTS] {
    let path = path();
    let mut joints = *path.middle();
    for step in 1..=20 {
        joints = path.joints(rail_m * f64::from(step) / 20.0, &joints).unwrap();
    }
    let mut pose = path.pose(rail_m);
    (pose.position_m.x, pose.position_m.z) = (pose.position_m.x + forward_m, pose.position_m.z + up_m);
    inverse(&pose, &joints).unwrap()
}

#[test]
fn a_joint_that_does_not_hold_still_is_named() {
    let mut bench = Bench::new();
    bench.devices.arm.place(beside(0.0, 0.05, 0.3));
    bench.start();
    bench.until(Phase::Holding, 3000);
    bench.run(500);
    assert_eq!(bench.robot.astray(), None);
    bench.guide(9, 0.5);
    let (joint, by_rad) = bench.robot.astray().unwrap();
    assert!(joint == 9 && (by_rad - 0.5).abs() < 0.02, "joint {joint}, {by_rad} rad");
}

#[test]
fn the_first_targets_lead_from_where_the_arm_stands_onto_its_path() {
    let path = path();
    let high = beside(0.0, 0.0, 0.0045);
    let mut pose = path.pose(0.0);
    pose.rotation = Rotation3::from_axis_angle(&Vector3::x_axis(), 0.025) * pose.rotation;
    let turned = inverse(&pose, path.middle()).unwrap();
    for stood in [high, turned] {
        let far = |joints: &[f64; ARM_JOINTS]| {
            joints.iter().zip(&stood).map(|(joint, stood)| (joint - stood).abs()).fold(0.0, f64::max)
        };
        let mut bench = Bench::new();
        bench.devices.arm.place(stood);
        bench.start();
        bench.until(Phase::Holding, 3000);
        let (mut before, mut fastest) = (None::<[f64; ARM_JOINTS]>, 0.0f64);
        for _ in 0..4000 {
            bench.step();
            let Some(sent) = bench.robot.arm().sent() else { continue };
            match before {
                None => assert!(far(&sent) < 1e-4, "{} rad in the first target", far(&sent)),
                Some(before) => {
                    let turns = sent.iter().zip(before).map(|(now, before)| (now - before).abs());
                    fastest = turns.fold(fastest, f64::max);
                }
            }
            before = Some(sent);
        }
        let place = path.place(&before.unwrap());
        assert!(place.beside_m < 1e-5 && place.turned_rad < 1e-5, "{place:?}");
        assert!(fastest < 1e-3, "{fastest} rad from one target to the next");
        assert_eq!(bench.robot.phase(), Phase::Holding, "{}", bench.fault());
    }
}

#[test]
fn from_beside_the_keys_it_goes_straight_up_first() {
    for (rail_m, forward_m, up_m) in [(0.2, -0.1, 0.0), (-0.25, 0.03, 0.02), (0.0, 0.0, 0.04)] {
        let mut bench = Bench::new();
        let from = beside(rail_m, forward_m, up_m);
        bench.devices.arm.place(from);
        bench.start();
        bench.until(Phase::Holding, 3000);
        bench.robot.home(bench.now(), &[0.0; DRIVEN]).unwrap();
        let (from, path_z) = (forward(&from).position_m, path().pose(rail_m).position_m.z);
        let mut highest = from.z;
        for _ in 0..20_000 {
            bench.step();
            let at = forward(&bench.devices.arm.joints()).position_m;
            highest = highest.max(at.z);
            if highest > path_z + 0.078 {
                break;
            }
            assert!((at - from).xy().norm() < 0.006, "beside its place before it is clear: {at} from {from}");
            assert!(at.z > from.z - 1e-3);
        }
        assert!(highest > path_z + 0.078, "{:?} {}", bench.robot.phase(), bench.fault());
        bench.until(Phase::Holding, 60_000);
        assert!(bench.robot.place().beside_m < 1e-3);
    }
}

/// The rail is 485 mm before the base, 674 mm long and 170 mm high; home is at 524, 0 and 585 mm.
#[test]
fn a_box_holds_the_keyboard_and_the_way_there_or_nothing_begins() {
    let with_box = |sides: [[i32; 2]; 3]| {
        let mut rig = rig();
        rig.arm.box_mm = Some(SafetyBox(sides));
        rig
    };
    for (sides, said) in [
        ([[300, 700], [-300, 400], [100, 700]], "+0.337 m along the keyboard: y of the flange is -337"),
        ([[300, 700], [-400, 341], [100, 700]], "-0.337 m along the keyboard: y of the flange is 337"),
        ([[300, 700], [-400, 400], [100, 200]], "above the keyboard: z of the flange is"),
        ([[300, 700], [-400, 400], [100, 500]], "home and the keyboard: z of the flange is"),
        ([[300, 500], [-400, 400], [100, 700]], "x of the flange is"),
    ] {
        let error = Robot::new(&with_box(sides), path()).map(drop).unwrap_err().to_string();
        assert!(error.contains(said) && error.contains("arm.box_mm"), "{error}");
    }
    // From everywhere in the box home and to the ends of the keyboard, and the controller never
    // minds.
    let rig = with_box([[300, 700], [-400, 400], [100, 700]]);
    let mut bench = Bench::with(&rig);
    bench.devices.arm.place(PAPER_HOME_DEG.map(f64::to_radians));
    bench.start();
    bench.until(Phase::Holding, 3000);
    let mut goal = [0.0; DRIVEN];
    for rail_m in [0.337, -0.337] {
        goal[RAIL] = rail_m;
        bench.robot.home(bench.now(), &goal).unwrap();
        bench.until(Phase::Holding, 60_000);
        assert!((bench.robot.joints()[RAIL] - rail_m).abs() < 2e-3);
    }
    assert_eq!(bench.devices.arm.error(), 0);
    // Beside the keyboard, behind the base: the arm stands inside a large box, and its way would
    // lead out.
    let mut bench = Bench::with(&with_box([[-700, 700], [-400, 400], [100, 700]]));
    let mut behind = PAPER_HOME_DEG.map(f64::to_radians);
    behind[0] += 3.0;
    bench.devices.arm.place(behind);
    bench.start();
    bench.until(Phase::Holding, 3000);
    let refused = bench.robot.home(bench.now(), &goal).unwrap_err().to_string();
    assert!(refused.contains("leaves its box") && refused.contains("y of the flange"), "{refused}");
    assert_eq!(bench.robot.phase(), Phase::Holding);
}

/// An arm that is so near to its end stands, m.
const STANDS_M: f64 = 1e-3;

/// Controller and guard are killed together, and nobody sends a stop: the arm must stand where it
/// was sent last.
#[test]
fn without_a_controller_the_arm_stands_where_it_was_sent_last() {
    let mut farthest = [0.0_f64; 2];
    let mut longest_ms = [0; 2];
    for at in 0..12 {
        let mut bench = Bench::new();
        bench.devices.arm.place(PAPER_HOME_DEG.map(f64::to_radians));
        bench.start();
        bench.until(Phase::Holding, 3000);
        bench.robot.home(bench.now(), &[0.0; DRIVEN]).unwrap();
        let following = at >= 6;
        if following {
            bench.until(Phase::Holding, 60_000);
            // 0.15 m along the keyboard as fast as the limits allow.
            bench.follow(&[0.0; DRIVEN], 100);
            let mut pose = [0.0; DRIVEN];
            pose[RAIL] = 0.15;
            bench.robot.follow(bench.now(), &[pose; 100]).unwrap();
            bench.run(60 + 40 * (at - 6));
        } else {
            bench.run(1200 + 700 * at);
        }
        let (sent, stood) = (bench.robot.arm().sent().unwrap(), bench.devices.arm.joints());
        // Every millisecond where it is.
        let places: Vec<_> = std::iter::repeat_with(|| {
            bench.pass();
            forward(&bench.devices.arm.joints()).position_m
        })
        .take(500)
        .collect();
        let moves_until = places.iter().rposition(|place| (place - places[499]).norm() > STANDS_M);
        let longest_ms = &mut longest_ms[usize::from(following)];
        *longest_ms = (*longest_ms).max(moves_until.map_or(0, |last| last + 1));
        let ended = bench.devices.arm.joints();
        let beside = ended.iter().zip(sent).map(|(ended, sent)| (ended - sent).abs()).fold(0.0, f64::max);
        assert!(beside < 1e-3, "{at}: {beside} rad from where it was sent");
        let flange_distance_m = (forward(&ended).position_m - forward(&stood).position_m).norm();
        farthest[usize::from(following)] = farthest[usize::from(following)].max(flange_distance_m);
    }
    // What its own lag leaves, at 0.3 rad/s and at 0.8 m/s: a planned move would have taken it half
    // a metre farther.
    println!(
        "after the last target it moved by {:.0} mm on its way, {:.0} mm at the keyboard; to within a millimetre of its end in {} and {} ms",
        farthest[0] * 1e3,
        farthest[1] * 1e3,
        longest_ms[0],
        longest_ms[1]
    );
    // As soon as a robot whose controller hangs.
    assert!(longest_ms.iter().all(|ms| (1..=100).contains(ms)), "{longest_ms:?} ms");
    assert!(
        farthest[0] > 1e-3 && farthest[0] < 0.04 && farthest[1] > 1e-3 && farthest[1] < 0.08,
        "{farthest:?}"
    );
}
