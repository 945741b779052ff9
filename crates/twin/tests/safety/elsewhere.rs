//! Each joint of the arm, reported elsewhere than where it was sent.

use std::fmt::Write as _;

use etude_robot::{Doubt, Fault, Phase};
use etude_twin::Truth;

use crate::bench::{Bench, Policy};
use crate::faults::arm::report_joint;

/// How far off a joint is, rad.
const OFF_RAD: f32 = 0.3;
/// Longest time until the hand has no torque and the arm is stopped, ms.
const WITHIN: u32 = 200;

#[test]
fn each_joint_of_the_arm_that_is_elsewhere_stops_the_robot() {
    let mut table = String::new();
    for joint in 0..7 {
        for off in [-OFF_RAD, OFF_RAD] {
            for follows in [false, true] {
                let mut bench = Bench::at_the_keyboard(&Truth::load("standard").unwrap());
                bench.start_and_hold();
                bench.run(50);
                if follows {
                    bench.follow(Policy::Smooth);
                    bench.run(300);
                }
                let place = format!("joint {}, {off:+} rad, {:?}", joint + 1, bench.robot.phase());
                report_joint(&mut bench, joint, move |rad| rad + off);
                let took = bench.until(WITHIN, |bench| {
                    bench.robot.phase() == Phase::Fault && bench.hand_is_off() && bench.arm_is_stopped()
                });
                let fault = bench.robot.fault();
                let away = match fault {
                    Some(Fault::Doubted(Doubt::ArmAway { turned_rad, .. })) => {
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
