//! Faults of the policy and of the computer, and the operator's stop.

use std::time::Duration;

use etude_twin::FaultKind;

use super::End::{self, Fault, GoesOn, Never};
use super::{ROW, Row};
use crate::bench::Bench;
use crate::policy::Policy;

pub const ROWS: &[Row] = &[
    Row {
        name: "policy falls silent",
        ends: [Never, Never, Never, Never, Fault(205), Never],
        says: "no new command",
        strike: |b| b.policy = Policy::Silent,
        ..ROW
    },
    Row {
        name: "policy asks for NaN and infinity",
        ends: [Never, Never, Never, Never, GoesOn, Never],
        strike: |b| b.policy = Policy::Nonsense,
        ..ROW
    },
    Row {
        name: "policy jumps all over its ranges",
        ends: [Never, Never, Never, Never, GoesOn, Never],
        strike: |b| b.policy = Policy::Jumps,
        ..ROW
    },
    Row {
        name: "controller does not run for 200 ms, while the hand holds its torque",
        ends: [GoesOn, Fault(2), Fault(2), Fault(2), Fault(2), GoesOn],
        says: "did not run",
        strike: |b| {
            // What is on its way arrives.
            b.stall(2);
            let held = b.lockstep.twin.devices.hand.pwm();
            b.stall(198);
            assert_eq!(b.lockstep.twin.devices.hand.pwm(), held);
        },
        ..ROW
    },
    Row {
        name: "controller does not run for 80 ms",
        // What waits in the buffers meanwhile is not old.
        strike: |b| b.stall(80),
        ..ROW
    },
    Row {
        name: "controller does not run for 5 s",
        ends: [Fault(5), Fault(2), Fault(2), Fault(2), Fault(2), GoesOn],
        says: "the controller did not run for 5001 ms|this program stood still for 5001 ms",
        strike: |b| b.stall(5000),
        ..ROW
    },
    Row {
        name: "controller does not run for 85 ms, and its guard stops hand and arm",
        // A start that is under way switches both on again.
        ends: [GoesOn, Fault(110), Fault(110), Fault(110), Fault(110), GoesOn],
        says: "this program stood still for 86 ms",
        strike: |b| {
            b.stall(70);
            b.begin(FaultKind::HandOff);
            b.begin(FaultKind::ArmStopped);
            b.stall(15);
        },
        ..ROW
    },
    Row { name: "operator's stop", ends: [End::Stopped; 6], strike: Bench::stop, ..ROW },
    Row {
        name: "policy's clock is an hour ahead",
        ends: [Never, Never, Never, Never, GoesOn, Never],
        strike: |b| b.ahead = Duration::from_secs(3600),
        mend: |b| b.ahead = Duration::ZERO,
        ..ROW
    },
    Row {
        name: "policy's commands are 80 ms old when they come",
        ends: [Never, Never, Never, Never, GoesOn, Never],
        strike: |b| b.behind = Duration::from_millis(80),
        mend: |b| b.behind = Duration::ZERO,
        ..ROW
    },
    Row {
        name: "policy's commands are 300 ms old when they come",
        ends: [Never, Never, Never, Never, Fault(60), Never],
        says: "no new command",
        strike: |b| b.behind = Duration::from_millis(300),
        mend: |b| b.behind = Duration::ZERO,
        ..ROW
    },
];
