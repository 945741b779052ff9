//! Faults that a parameter set orders: each kind, in the middle of a performance, ends it as it
//! must.

use etude_robot::Phase;
use etude_twin::{FaultKind, TwinParams};

use crate::bench::Bench;
use crate::policy::Policy;

/// When it happens, s since the twin was switched on: after half a second of playing, most of the
/// way to go still.
const AT_SECS: f64 = 0.9;
/// The slowest to be seen is an arm that is held: its targets must first have run away from it.
const SEEN_WITHIN: u32 = 4000;

#[test]
fn every_kind_ends_a_performance() {
    // A joint without torque endangers nobody. It is found by `robot check --joints`, or where it
    // is sent both ways (`faults/hand.rs`).
    for kind in FaultKind::examples().filter(|kind| !matches!(kind, FaultKind::JointDead(_))) {
        let text = format!(
            "faults = [{{ kind = \"{kind}\", at_secs = {AT_SECS} }}]\n[keyboard]\nsensing_secs = 0.1"
        );
        let twin_params = TwinParams::load("mild").unwrap().with(&text).unwrap();
        let mut bench = Bench::at_the_keyboard(&twin_params);
        bench.start_and_hold();
        bench.follow(Policy::Smooth);
        while bench.now().as_secs_f64() < AT_SECS {
            bench.step();
            assert_eq!(bench.robot.phase(), Phase::Following, "{kind} came too early: {:?}", bench.notes);
        }
        let took = bench.until(SEEN_WITHIN, |bench| bench.robot.phase() == Phase::Fault);
        let took = took.unwrap_or_else(|| panic!("{kind} is not seen"));
        // What the wire still carries arrives within milliseconds.
        bench.run(20);
        let deaf = matches!(kind, FaultKind::CanBusOff | FaultKind::CanSilent);
        assert_eq!(bench.hand_is_off(), !deaf, "{kind}: {:?}", bench.lockstep.twin.devices.hand.pwm());
        assert_eq!(bench.arm_is_stopped(), kind != FaultKind::ArmDisconnect, "{kind}");
        let fault = bench.robot.fault().unwrap().to_string();
        println!("{kind}: {took} ms, {fault}");
        bench.policy = Policy::Silent;
        bench.run(500);
        assert_eq!(bench.robot.phase(), Phase::Fault, "{kind}: latched");
        assert!(bench.try_follow(Policy::Smooth).is_err(), "{kind}");
        match kind {
            FaultKind::CanBusOff => {
                assert!(fault.contains("`ip link set can0 down`") && fault.contains("bus-off"), "{fault}");
                assert!(fault.contains("bitrate 1000000"), "{fault}");
            }
            FaultKind::Estop => assert!(fault.contains("error 1"), "{fault}"),
            _ => {}
        }
    }
}

/// Two faults, of which each is over by itself, and a start after each.
#[test]
fn a_fault_that_is_over_is_started_after() {
    let ordered = ["can-bus-off@1+0.5", "estop@3+0.5"].map(|text| text.parse().unwrap());
    let twin_params = TwinParams::load("mild").unwrap().with_faults(&ordered).unwrap();
    let mut bench = Bench::at_the_keyboard(&twin_params);
    for (from_secs, said) in [(1.0, "bus-off"), (3.0, "error 1")] {
        bench.start_and_hold();
        bench.follow(Policy::Smooth);
        while bench.now().as_secs_f64() < from_secs {
            bench.step();
        }
        bench.until_phase(Phase::Fault, 100);
        // Not before it is over: the bus tells at once, the arm when it is asked.
        bench.start();
        bench.until_phase(Phase::Fault, 450);
        let fault = bench.robot.fault().unwrap().to_string();
        assert!(fault.contains(said), "{fault}");
        while bench.now().as_secs_f64() < from_secs + 0.51 {
            bench.step();
        }
    }
    bench.start_and_hold();
}
