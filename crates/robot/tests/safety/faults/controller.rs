//! Faults of the policy and of the computer, and the operator's stop.

use std::time::Duration;

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
