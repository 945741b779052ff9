//! Faults of the links: what comes late, out of order, twice, or in one direction only.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

use etude_twin::FaultKind;

use super::End::{Fault, GoesOn};
use super::{Lost, ROW, Row};

pub const ROWS: &[Row] = &[
    Row {
        name: "the CAN bus delays frames by up to 3 ms, each by another time",
        twin: "[links.can]\njitter_secs = 0.003",
        ..ROW
    },
    Row { name: "frames of the CAN bus overtake each other", twin: "[links.can]\nreorder = 0.1", ..ROW },
    Row {
        name: "the keyboard's bytes come up to 20 ms late, each by another time",
        twin: "[links.midi]\njitter_secs = 0.02",
        ..ROW
    },
    Row {
        name: "the CAN bus carries nothing for 10 ms",
        strike: |b| {
            b.begin(FaultKind::CanSilent);
            b.run(10);
            b.end(FaultKind::CanSilent);
        },
        ..ROW
    },
    Row {
        name: "the CAN bus carries nothing for 50 ms",
        // A start that is under way asks again. The hand is told when it is told again.
        ends: [GoesOn, Fault(110), Fault(110), Fault(110), Fault(110), GoesOn],
        says: "no angles from finger",
        strike: |b| {
            b.begin(FaultKind::CanSilent);
            b.run(50);
            b.end(FaultKind::CanSilent);
        },
        ..ROW
    },
    Row {
        name: "the arm's link delays everything by 2 to 8 ms, each time by another",
        twin: "[links.arm]\ndelay_secs = 0.002\njitter_secs = 0.006",
        ..ROW
    },
    Row { name: "a reply of the arm comes 50 ms late", strike: |b| b.hold_replies(50), ..ROW },
    Row {
        name: "the arm's reports pause for 50 ms",
        strike: |b| {
            let mut left = 5;
            b.mischief.alter_reports = Some(Box::new(move |bytes| {
                if left > 0 {
                    left -= 1;
                    bytes.clear();
                }
            }));
        },
        ..ROW
    },
    Row {
        name: "each report of the arm comes twice",
        strike: |b| b.mischief.alter_reports = Some(Box::new(|bytes| *bytes = bytes.repeat(2))),
        ..ROW
    },
    Row {
        name: "frames to the hand are lost, those from it arrive",
        ends: [Fault(2100), Fault(1110), Fault(1110), Fault(1110), Fault(1110), GoesOn],
        says: "the hand does not answer|the hand has not reported its state",
        lost: Lost::HandHolds,
        stays: true,
        strike: |b| b.mischief.to_hand = Some(Box::new(|_| vec![])),
        ..ROW
    },
    Row {
        name: "the CAN adapter gives back what is sent",
        ends: [Fault(250), Fault(160), Fault(160), Fault(160), Fault(160), GoesOn],
        says: "another program drives the hand",
        stays: true,
        strike: |b| {
            let sent = Rc::new(RefCell::new(VecDeque::new()));
            let echo = sent.clone();
            b.mischief.to_hand = Some(Box::new(move |frame| {
                sent.borrow_mut().push_back(frame);
                vec![frame]
            }));
            b.mischief.from_hand =
                Some(Box::new(move |frame| echo.borrow_mut().drain(..).chain([frame]).collect()));
        },
        ..ROW
    },
];
