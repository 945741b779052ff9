//! What the hand's frames say: positions, state, temperatures.

use std::time::Duration;

use super::Hand;
use crate::allegro::assembly::Taken;
use crate::allegro::fault::HandFault;
use crate::allegro::messages::{Finger, Information, StatusBits};
use crate::allegro::state::{HandEvent, HandState, Step};

/// Late replies in a row that are a fault: the program that polls may itself have been held up
/// during one.
const LATE_REPLIES: u32 = 3;
const GENERATION: u8 = 4;
/// A share of impossible readings of another finger with which they are not one encoder's fault.
const OTHER_SHARE: f64 = 0.03;

impl Hand {
    pub(super) fn take_position(&mut self, now: Duration, finger: Finger, counts: [i16; 4]) -> HandEvent {
        if let Some(at) = self.known.finger_at.get_mut(finger.number()) {
            *at = Some(now);
        }
        let taken = self.known.assembly.take(now, finger.number(), counts);
        let event = self.tick(taken);
        if event == HandEvent::Positions {
            self.known.positions_at = Some(now);
        }
        if taken.duplicate {
            return event;
        }
        let period = Duration::from_millis(self.config.period_ms.into());
        if self.state == HandState::Ready && self.known.frame_rate.take(now, period) {
            self.fail(HandFault::TwoHands);
        }
        let first = 4 * finger.number();
        for (joint, counts) in (first..).zip(counts) {
            let encoder = self.known.encoders.get_mut(joint);
            if let Some(Err(fault)) = encoder.map(|encoder| encoder.take(now, joint, counts)) {
                let two_hands =
                    matches!(fault, HandFault::EncoderUnsteady { .. }) && self.is_unsteady_beside(finger);
                self.fail(if two_hands { HandFault::TwoHands } else { fault });
            }
        }
        event
    }

    /// Whether another finger has impossible readings as well.
    fn is_unsteady_beside(&self, finger: Finger) -> bool {
        let fingers = self.known.encoders.as_chunks::<4>().0.iter().enumerate();
        let mut others = fingers.filter(|(other, _)| *other != finger.number());
        others.any(|(_, joints)| joints.iter().any(|encoder| encoder.impossible_share() > OTHER_SHARE))
    }

    pub(super) fn tick(&mut self, taken: Taken) -> HandEvent {
        let Some(at) = taken.tick else { return HandEvent::Nothing };
        self.known.positions_at = Some(at);
        HandEvent::Positions
    }

    pub(super) fn take_information(&mut self, now: Duration, information: Information) {
        self.known.information = Some((now, information));
        let status = information.status;
        if status.of(StatusBits::HOST_TIMEOUT) == 0 {
            self.known.host_timeout_cleared = true;
        }
        let mut faults = StatusBits::TEMPERATURE | StatusBits::INTERNAL | StatusBits::PALM_TEMPERATURE;
        if self.known.host_timeout_cleared {
            faults |= StatusBits::HOST_TIMEOUT;
        }
        let (celsius, limit) = (information.board_celsius, self.config.max_board_celsius);
        if information.generation() != GENERATION {
            self.fail(HandFault::WrongVersion { generation: information.generation() });
        } else if information.side != self.config.side {
            self.fail(HandFault::WrongSide { found: information.side });
        } else if status.of(faults) != 0 {
            self.fail(HandFault::Reported { bits: status.of(faults) });
        } else if celsius > limit {
            self.fail(HandFault::BoardHot { celsius, limit });
        } else if self.state == HandState::Ready && !status.servo_on() {
            self.fail(HandFault::ServoOff);
        } else if self.state == HandState::Starting {
            match self.step {
                Step::Ask => self.step = Step::SwitchOn,
                Step::Wait { .. } => self.known.servo_was_on |= status.servo_on(),
                _ => {}
            }
        }
    }

    /// Frames of the hand reach us in the order in which they were sent: if a reply is late, so are
    /// the positions. Each finger is asked in turn, so a reply is not taken for that to an earlier
    /// question.
    pub(super) fn take_temperature(&mut self, now: Duration, finger: Finger, celsius: [u8; 4]) {
        let asked = self.known.asked.get_mut(finger.number()).and_then(Option::take);
        if let Some(by) = asked.map(|at| now.saturating_sub(at)) {
            // There and back.
            let late = by.as_secs_f64() > 2.0 * self.config.stale_after_secs;
            self.known.late_replies = if late { self.known.late_replies + 1 } else { 0 };
            if self.known.late_replies >= LATE_REPLIES {
                self.fail(HandFault::FramesLate { by });
            }
        }
        let limit = self.config.max_joint_celsius;
        for (joint, celsius) in (4 * finger.number()..).zip(celsius) {
            if celsius > limit {
                self.fail(HandFault::JointHot { joint, celsius, limit });
            }
        }
    }
}
