//! Each joint of the arm, and the flange, reported elsewhere than where they were sent.

use std::fmt::Write as _;

use etude_robot::xarm::kinematics::{forward, inverse};
use etude_robot::{Fault, Implausible, Phase};
use etude_twin::TwinParams;

use crate::bench::Bench;
use crate::faults::arm::{report_joint, report_joints};
use crate::policy::Policy;

/// How far off a joint is, rad.
const OFF_RAD: f32 = 0.3;
/// Longest time until the hand has no torque and the arm is stopped, ms.
const WITHIN: u32 = 200;

/// A robot that holds its pose at the keyboard, or follows.
fn live(follows: bool) -> Bench {
    let mut bench = Bench::at_the_keyboard(&TwinParams::load("mild").unwrap());
    bench.start_and_hold();
    bench.run(50);
    if follows {
        bench.follow(Policy::Smooth);
        bench.run(300);
    }
    bench
}

#[test]
fn each_joint_of_the_arm_that_is_elsewhere_stops_the_robot() {
    let mut table = String::new();
    for joint in 0..7 {
        for off in [-OFF_RAD, OFF_RAD] {
            for follows in [false, true] {
                let mut bench = live(follows);
                let place = format!("joint {}, {off:+} rad, {:?}", joint + 1, bench.robot.phase());
                report_joint(&mut bench, joint, move |rad| rad + off);
                let took = bench.until(WITHIN, |bench| {
                    bench.robot.phase() == Phase::Fault && bench.hand_is_off() && bench.arm_is_stopped()
                });
                let fault = bench.robot.fault();
                let away = match fault {
                    Some(Fault::Implausible(Implausible::ArmAway { turned_rad, .. })) => {
                        (turned_rad - 0.3).abs() < 0.01
                    }
                    _ => false,
                };
                assert!(away && took.is_some(), "{place}: {took:?}, {fault:?}");
                writeln!(table, "{place}: {} ms, {}", took.unwrap(), fault.unwrap()).unwrap();
            }
        }
    }
    println!("{table}");
}

/// The flange is beside its path, or too far along it, without being turned: no single joint shows
/// that.
#[test]
fn a_flange_that_is_elsewhere_stops_the_robot() {
    for follows in [false, true] {
        // Forwards and upwards are beside the path, sideways is along it.
        for (axis, by_m) in [(0, 0.02), (0, -0.02), (2, 0.02), (1, 0.1), (1, -0.1)] {
            let mut bench = live(follows);
            let place = format!("axis {axis}, {by_m:+} m, {:?}", bench.robot.phase());
            report_joints(&mut bench, move |joints| {
                let near = joints.map(f64::from);
                let mut pose = forward(&near);
                pose.position_m[axis] += by_m;
                *joints = inverse(&pose, &near).unwrap().map(|rad| rad as f32);
            });
            let took = bench.until(WITHIN, |bench| {
                bench.robot.phase() == Phase::Fault && bench.hand_is_off() && bench.arm_is_stopped()
            });
            let fault = bench.robot.fault();
            let Some(Fault::Implausible(Implausible::ArmAway { along_m, beside_m, turned_rad })) = fault
            else {
                panic!("{place}: {took:?}, {fault:?}")
            };
            let found = if axis == 1 { along_m } else { beside_m };
            // Along the keyboard the arm is also late.
            let lag_m = if axis == 1 { 0.04 } else { 0.003 };
            assert!((found - by_m.abs()).abs() < lag_m && *turned_rad < 0.02, "{place}: {fault:?}");
            assert!(took.is_some(), "{place}");
        }
    }
}
