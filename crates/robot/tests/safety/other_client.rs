//! Another client of the arm's controller that sends it servo targets beside ours.

use std::time::Duration;

use etude_emulators::ReportKind;
use etude_emulators::faults::FaultPlan;
use etude_robot::{Fault, Implausible, Phase};
use etude_twin::{TwinParams, calibration};

use crate::bench::{Bench, start_pose};
use crate::faults::arm::target_beside;
use crate::policy::Policy;

/// Time for which it sends targets, ms.
const SENDS: u32 = 3000;

fn following(name: &str, reports: ReportKind) -> Bench {
    let twin_params = TwinParams::load(name).unwrap();
    let mut bench = Bench::with_rig(&twin_params.rig(), &twin_params, &calibration("twin"));
    bench.lockstep.reports = reports;
    bench.place_arm_at_the_keyboard();
    bench.start_and_hold();
    bench.follow(Policy::Smooth);
    bench.run(1000);
    bench
}

/// Whatever it sends and however often, if that moves the arm.
#[test]
fn who_else_sends_targets_is_seen_and_named() {
    for reports in [ReportKind::Real, ReportKind::Control] {
        for name in ["mild", "worn"] {
            // Ours come every 5 ms. Targets that are in force for less than half of the time do not
            // move the arm, but are reported.
            let moves = [(1, 0.02), (2, -0.05), (4, 0.02), (4, 0.0)];
            let reported: &[_] = if reports == ReportKind::Control { &[(7, -0.05), (11, 0.1)] } else { &[] };
            for &(period, by_rad) in moves.iter().chain(reported) {
                let mut bench = following(name, reports);
                let request = target_beside(&bench, by_rad);
                let begun = bench.now();
                for ms in 0..SENDS {
                    if ms % period == 0 {
                        bench.other_client(&request);
                    }
                    bench.step();
                    if bench.robot.phase() == Phase::Fault {
                        break;
                    }
                }
                let took = bench.now() - begun;
                let fault = bench.robot.fault();
                let place =
                    format!("{name}, {reports:?}, every {period} ms, {by_rad} rad: {took:?}, {fault:?}");
                println!("{place}");
                let text = fault.unwrap_or_else(|| panic!("unseen: {place}")).to_string();
                assert!(text.contains("another program"), "{place}");
                if reported.contains(&(period, by_rad)) {
                    let exact =
                        matches!(fault, Some(Fault::Implausible(Implausible::ArmTargetForeign { .. })));
                    assert!(exact && took < Duration::from_millis(1500), "{place}");
                }
            }
        }
    }
}

/// An arm that lags and rings, whose replies come late, and whose controller stands still now and
/// then.
#[test]
fn an_arm_that_lags_is_not_taken_for_one_that_others_move() {
    let drawn = (1..=6).map(|seed| format!("random:{seed}"));
    for name in ["standard", "worn"].map(str::to_string).into_iter().chain(drawn) {
        for reports in [ReportKind::Real, ReportKind::Control] {
            let arm = FaultPlan { delay_secs: 0.001, jitter_secs: 0.003, ..FaultPlan::default() };
            let text = format!("[links.arm]\n{}", toml::to_string(&arm).unwrap());
            let twin_params = TwinParams::load(&name).unwrap().with(&text).unwrap();
            let mut bench = Bench::with_rig(&twin_params.rig(), &twin_params, &calibration("twin"));
            bench.lockstep.reports = reports;
            bench.start_and_hold();
            bench.robot.home(bench.now(), &start_pose()).unwrap();
            bench.run(3000);
            assert_eq!(bench.robot.phase(), Phase::Moving, "{name}: {:?}", bench.robot.fault());
            bench.stop();
            bench.run(200);
            bench.place_arm_at_the_keyboard();
            bench.start_and_hold();
            bench.follow(Policy::Sweeps);
            for round in 0..6 {
                bench.run(600);
                if round % 2 == 1 {
                    bench.stall(80);
                }
            }
            // A lag of the fastest sweeps may be too much, and is then named as that.
            if let Some(Fault::Implausible(found)) = bench.robot.fault() {
                assert!(matches!(found, Implausible::ArmAway { .. }), "{name}: {found}");
            }
        }
    }
}
