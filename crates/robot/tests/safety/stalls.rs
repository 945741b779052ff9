//! A controller that stands still for a while: it continues, or what it says names that.

use std::fmt::Write as _;

use etude_emulators::ReportKind;
use etude_robot::{Fault, Phase};
use etude_twin::{FaultKind, TwinParams, calibration};

use crate::bench::Bench;
use crate::dice::Dice;
use crate::faults::{WHENS, When};
use crate::matrix::{bring, expected_phase};

/// Longest gap for a robot with torques on, ms; a poll takes one more.
const MAX_GAP: u32 = 99;
/// Time in which something may come of a stall, ms.
const AFTERMATH: u32 = 1500;

fn bench(dice: &mut Dice) -> Bench {
    let timeout = ["", "[hand]\ntorque_timeout_secs = 0.05\n"][dice.below(2) as usize];
    let name = ["mild", "worn"][dice.below(2) as usize];
    let text = format!("{timeout}[keyboard]\nsensing_secs = 0.1");
    let twin_params = TwinParams::load(name).unwrap().with(&text).unwrap();
    let mut bench = Bench::new(&twin_params, &calibration("twin"));
    bench.lockstep.reports = [ReportKind::Real, ReportKind::Control][dice.below(2) as usize];
    bench
}

fn names_the_stall(bench: &Bench) -> bool {
    matches!(bench.robot.fault(), Some(Fault::Stalled { .. } | Fault::AfterStall { .. }))
}

/// At any moment of each phase, of any length.
#[test]
fn a_stall_is_borne_or_named() {
    let mut dice = Dice::new(16);
    let mut table = String::new();
    for when in WHENS {
        for shortest in [30, 50, 70, 85, 100, 200, 1000, 3000] {
            let mut bench = bench(&mut dice);
            bring(&mut bench, when);
            bench.run(dice.below(150) as u32);
            let millis = shortest + dice.below(u64::from(shortest / 8)) as u32;
            let before = bench.robot.phase();
            bench.stall(millis);
            bench.step();
            let place = format!("{when:?}, {millis} ms");
            let is_live = !matches!(before, Phase::Starting | Phase::Stopped);
            if is_live && millis > MAX_GAP {
                let fault = bench.robot.fault();
                assert!(matches!(fault, Some(Fault::Stalled { .. })), "{place}: {fault:?}");
            }
            bench.run(AFTERMATH);
            let phase = bench.robot.phase();
            let goes_on = expected_phase(when).contains(&phase);
            assert!(goes_on || names_the_stall(&bench), "{place}: {phase:?}, {:?}", bench.notes);
            // What waited in the buffers is no fault.
            let borne = when == When::Stopped || millis <= MAX_GAP;
            assert!(goes_on || !borne, "{place}: {:?}", bench.notes);
            writeln!(
                table,
                "{place}: {phase:?} {}",
                bench.robot.fault().map_or(String::new(), ToString::to_string)
            )
            .unwrap();
        }
    }
    println!("{table}");
}

/// The guard stops hand and arm after 70 ms, so the controller finds them stopped.
#[test]
fn what_the_guard_did_meanwhile_is_not_the_cause() {
    for when in [When::Holding, When::Homing, When::Moving, When::Following] {
        for stopped in [
            &[FaultKind::HandOff][..],
            &[FaultKind::ArmStopped],
            &[FaultKind::HandOff, FaultKind::ArmStopped],
        ] {
            let mut bench = bench(&mut Dice::new(when as u64));
            bring(&mut bench, when);
            bench.stall(70);
            stopped.iter().for_each(|kind| bench.begin(*kind));
            bench.stall(15);
            assert!(bench.until(200, |bench| bench.robot.phase() == Phase::Fault).is_some(), "{when:?}");
            let fault = bench.robot.fault().unwrap().to_string();
            assert!(fault.contains("stood still for 86 ms"), "{when:?}, {stopped:?}: {fault}");
        }
    }
}

/// Half a second later a wire that breaks is what it is.
#[test]
fn what_breaks_long_after_a_stall_is_named_itself() {
    let mut bench = bench(&mut Dice::new(1));
    bring(&mut bench, When::Following);
    bench.stall(60);
    bench.run(510);
    bench.begin(FaultKind::FingerSilent(1));
    bench.until_phase(Phase::Fault, 30);
    assert!(matches!(bench.robot.fault(), Some(Fault::Hand(_))), "{:?}", bench.robot.fault());
}
