//! The controller's records, for recordings.

use std::collections::VecDeque;
use std::time::Duration;

use crate::allegro;
use crate::joints::DRIVEN;
use crate::keyboard::KeyChange;
use crate::limiter::Clamp;
use crate::xarm::kinematics;

/// One thing that happened.
#[derive(Clone, Debug, PartialEq)]
pub enum Record {
    /// A set-point was computed.
    SetPoint {
        /// When.
        at: Duration,
        /// What was asked: driven joints, rad and m.
        asked: [f64; DRIVEN],
        /// What the limiter sent.
        sent: [f64; DRIVEN],
        /// Which joints are elsewhere than asked, and why; those of the thumb are numbered on after
        /// the driven ones.
        clamps: Vec<(usize, Clamp)>,
    },
    /// A period of the hand's joint loop.
    Hand {
        /// When its positions were in.
        at: Duration,
        /// Measured angles, as on the wire, rad.
        positions: [f64; allegro::WIRE_JOINTS],
        /// Angles to be at, rad.
        reference: [f64; allegro::WIRE_JOINTS],
        /// The PWM that the joint loop wanted, before it was cut to the limits.
        wanted: [f64; allegro::WIRE_JOINTS],
        /// What was sent.
        pwm: [i16; allegro::WIRE_JOINTS],
    },
    /// Angles of the hand while it is not driven: while it starts, and in the first second after it
    /// was released.
    Idle {
        /// When they were in.
        at: Duration,
        /// Measured angles, as on the wire, rad.
        positions: [f64; allegro::WIRE_JOINTS],
    },
    /// A report of the arm.
    Arm {
        /// When.
        at: Duration,
        /// Measured joints, rad.
        measured: [f64; kinematics::ARM_JOINTS],
        /// The joints that it was last asked for, rad; `None` while it follows nothing.
        sent: Option<[f64; kinematics::ARM_JOINTS]>,
        /// Its place on the rail, m.
        rail_m: f64,
    },
    /// A key was struck or released.
    Key(KeyChange),
    /// A message for the operator: a new phase, a warning, a fault.
    Note {
        /// When.
        at: Duration,
        /// `phase`, `warning` or `fault`.
        kind: &'static str,
        /// What happened.
        text: String,
    },
}

/// Records that were not taken yet: at most [`MAX_RECORDS`], of which the oldest are dropped.
#[derive(Debug, Default)]
pub(super) struct Journal {
    records: VecDeque<Record>,
    lost: u64,
}

/// Largest number of records that are kept: some ten seconds of a robot.
const MAX_RECORDS: usize = 8192;

impl Journal {
    pub fn push(&mut self, record: Record) {
        if self.records.len() >= MAX_RECORDS {
            self.records.pop_front();
            self.lost += 1;
        }
        self.records.push_back(record);
    }

    pub fn take(&mut self) -> impl Iterator<Item = Record> + '_ {
        self.records.drain(..)
    }

    pub fn lost(&self) -> u64 {
        self.lost
    }
}
