//! Joints of the hand whose encoder counts in the wrong direction, and fingers that are only
//! pushed.

use etude_robot::Phase;
use etude_robot::allegro::PWM_LIMITS;
use etude_robot::joints::{DRIVEN, HAND_DRIVEN_JOINTS, RAIL};
use etude_twin::{FaultKind, TwinParams, calibration};

use crate::bench::Bench;
use crate::dice::Dice;
use crate::faults::When;
use crate::matrix::bring;
use crate::policy::Policy;

/// Longest time for which a motor may push with all its torque, ms.
const PUSHES: u32 = 1000;
const LIVE: [When; 4] = [When::Holding, When::Homing, When::Moving, When::Following];

/// Brings a robot whose fingers stand anywhere into a phase.
fn bring_from_a_pose(dice: &mut Dice, when: When) -> Bench {
    let name = ["mild", "standard", "worn"][dice.below(3) as usize];
    let mut bench = Bench::new(&TwinParams::load(name).unwrap(), &calibration("twin"));
    let pose = std::array::from_fn(|joint| {
        if joint.is_multiple_of(4) { 0.2 * dice.signed() } else { 0.15 + 0.2 * dice.signed() }
    });
    bench.lockstep.twin.place_fingers(&pose);
    bring(&mut bench, when);
    bench
}

/// How many milliseconds the motor of a joint pushed with nearly all its torque until the fault, or
/// in eight seconds.
fn pushed(bench: &mut Bench, joint: usize) -> u32 {
    let mut pushed = 0;
    for _ in 0..8000 {
        bench.step();
        if bench.robot.phase() == Phase::Fault {
            break;
        }
        let pwm = bench.lockstep.twin.devices.hand.pwm()[joint];
        pushed += u32::from(pwm.unsigned_abs() * 10 >= PWM_LIMITS[joint].unsigned_abs() * 9);
    }
    pushed
}

#[test]
fn an_encoder_of_the_wrong_sign_pushes_for_less_than_a_second() {
    let mut dice = Dice::new(18);
    let mut worst = 0;
    for when in LIVE {
        for joint in 0..16u8 {
            let mut bench = bring_from_a_pose(&mut dice, when);
            bench.run(dice.below(300) as u32);
            bench.begin(FaultKind::JointReversed(joint));
            let millis = pushed(&mut bench, joint.into());
            let place = format!("{when:?}, joint {joint}: {millis} ms, {:?}", bench.robot.fault());
            println!("{place}");
            worst = worst.max(millis);
            assert!(millis <= PUSHES, "{place}");
        }
    }
    println!("it pushed for {worst} ms at most");
}

/// The same from the start on: nothing jumps, and the first way is that to straight fingers.
#[test]
fn an_encoder_that_was_always_of_the_wrong_sign_is_found_as_soon() {
    let mut dice = Dice::new(5);
    for joint in 0..16u8 {
        for name in ["mild", "worn"] {
            let mut bench = Bench::at_the_keyboard(&TwinParams::load(name).unwrap());
            let pose = std::array::from_fn(|joint| {
                if joint % 4 == 0 { 0.1 * dice.signed() } else { -0.1 + 0.03 * dice.signed() }
            });
            bench.lockstep.twin.place_fingers(&pose);
            bench.begin(FaultKind::JointReversed(joint));
            bench.run(20);
            bench.start();
            bench.run(400);
            let mut straight = [0.0; DRIVEN];
            straight[RAIL] = bench.robot.joints()[RAIL];
            // It is refused if a joint has run away already.
            let _ = bench.robot.approach(bench.now(), &straight);
            let millis = pushed(&mut bench, joint.into());
            let place = format!("{name}, joint {joint}: {millis} ms, {:?}", bench.robot.fault());
            println!("{place}");
            assert!(millis <= PUSHES, "{place}");
        }
    }
}

/// Somebody bends a finger of a robot that holds still, keeps it bent, and lets go.
#[test]
fn a_finger_that_a_person_bends_is_no_fault() {
    let mut dice = Dice::new(7);
    for _ in 0..24 {
        let mut bench = Bench::at_the_keyboard(&TwinParams::load("mild").unwrap());
        bench.start_and_hold();
        bench.run(300);
        let mut pose: [f64; HAND_DRIVEN_JOINTS] =
            std::array::from_fn(|joint| bench.lockstep.twin.joints()[joint]);
        let finger = 4 * dice.below(3) as usize;
        let joint = finger + dice.below(4) as usize;
        let speed = 0.5 + 2.0 * (1.0 + dice.signed());
        let by = if joint.is_multiple_of(4) { 0.2 * dice.signed() } else { 0.3 + 0.2 * dice.signed() };
        let from = pose[joint];
        for ms in 0..1800 {
            bench.step();
            let moved = (speed * 1e-3 * f64::from(ms)).min(f64::abs(by)).copysign(by);
            pose[joint] = from + moved;
            bench.lockstep.twin.place_fingers(&pose);
        }
        bench.run(500);
        let phase = bench.robot.phase();
        assert_eq!(phase, Phase::Holding, "joint {joint} by {by} at {speed}: {:?}", bench.robot.fault());
    }
}

/// Fingers that are sent anywhere at once are pushed by keys, and against each other.
#[test]
fn keys_are_no_fault_of_a_sign() {
    for name in ["ideal", "mild", "standard", "worn"] {
        for policy in [Policy::Smooth, Policy::Sweeps, Policy::Jumps] {
            let mut bench = Bench::at_the_keyboard(&TwinParams::load(name).unwrap());
            bench.start_and_hold();
            bench.follow(policy);
            bench.run(4000);
            let fault = bench.robot.fault().map_or(String::new(), ToString::to_string);
            assert!(!fault.contains("against its torque"), "{name}, {policy:?}: {fault}");
        }
    }
}
