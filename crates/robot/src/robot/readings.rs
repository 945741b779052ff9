//! What a controller shows: its state, what the devices have reported, and what was sent.

use std::time::Duration;

use super::axes::driven;
use super::following::farthest;
use super::{Fault, Phase, Robot, Warmth};
use crate::allegro::Hand;
use crate::calibration::RailPlace;
use crate::joints::{DRIVEN, from_wire};
use crate::keyboard::Keyboard;
use crate::rig::RigConfig;
use crate::xarm::Arm;

impl Robot {
    /// What it is doing.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Why it was stopped.
    pub fn fault(&self) -> Option<&Fault> {
        self.fault.as_ref()
    }

    /// Measured positions of the driven joints: rad, the rail in m.
    pub fn joints(&self) -> [f64; DRIVEN] {
        from_wire(&self.hand.positions(), self.place().rail_m)
    }

    /// The last set-points of the driven joints: rad, the rail in m.
    pub fn sent(&self) -> [f64; DRIVEN] {
        driven(&self.setpoints())
    }

    /// The joint of the hand, as on the wire, that is farther from its set-point than `start_finger_rad`, and how far, rad.
    pub fn astray(&self) -> Option<(usize, f64)> {
        let (joint, by_rad) = farthest(&self.hand.positions(), &self.setpoints());
        (by_rad > self.config.limits.start_finger_rad).then_some((joint, by_rad))
    }

    /// Where the hand is, seen from the rail; in the middle before the arm has reported.
    pub fn place(&self) -> RailPlace {
        self.path.place(&self.arm.joints().unwrap_or(*self.path.middle()))
    }

    /// Keys that are down: bit 0 is the lowest.
    pub fn pressed(&self) -> u64 {
        self.keyboard.pressed()
    }

    /// Set-points that were clamped so far, counted by joint.
    pub fn clamped(&self) -> u64 {
        self.clamped
    }

    /// The hand.
    pub fn hand(&self) -> &Hand {
        &self.hand
    }

    /// The arm.
    pub fn arm(&self) -> &Arm {
        &self.arm
    }

    /// The keyboard.
    pub fn keyboard(&self) -> &Keyboard {
        &self.keyboard
    }

    /// The rig that it controls.
    pub fn config(&self) -> &RigConfig {
        &self.config
    }

    /// How warm the motors of the hand are. It counts from one start to the next.
    pub fn warmth(&self) -> Warmth {
        self.doubts.warmth
    }

    /// When the hand was released first since the start.
    pub fn let_go_at(&self) -> Option<Duration> {
        self.let_go_at
    }

    /// Records that were dropped because they were not taken.
    pub fn lost_records(&self) -> u64 {
        self.journal.lost()
    }
}
