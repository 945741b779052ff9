//! The frames that the driver sends.

use super::limits::WIRE_JOINTS;
use super::messages::{DeviceId, Finger, HostMessage};
use crate::can::CanFrame;

/// Appends frames to one hand.
#[derive(Clone, Copy, Debug)]
pub(super) struct Commands {
    pub device: DeviceId,
    /// Period of the position frames, ms.
    pub period_ms: u16,
}

impl Commands {
    /// Releases the hand: zero torque `times` times, then servo off.
    pub fn release(&self, times: usize, out: &mut Vec<CanFrame>) {
        for _ in 0..times {
            self.zero(out);
        }
        self.message(HostMessage::ServoOff, out);
    }

    /// Starts the stream of positions.
    pub fn periods(&self, out: &mut Vec<CanFrame>) {
        self.message(HostMessage::Positions(self.period_ms), out);
    }

    /// Stops the stream.
    pub fn silence(&self, out: &mut Vec<CanFrame>) {
        self.message(HostMessage::Positions(0), out);
    }

    /// Switches the servo on, after a zero torque: the hand may still hold an older one.
    pub fn on(&self, out: &mut Vec<CanFrame>) {
        self.zero(out);
        self.message(HostMessage::ServoOn, out);
    }

    /// Zero torque for all joints.
    pub fn zero(&self, out: &mut Vec<CanFrame>) {
        self.torque(&[0; WIRE_JOINTS], out);
    }

    /// The PWM of each flat joint.
    pub fn torque(&self, pwm: &[i16; WIRE_JOINTS], out: &mut Vec<CanFrame>) {
        let (fingers, _) = pwm.as_chunks::<4>();
        for (&finger, &pwm) in Finger::ALL.iter().zip(fingers) {
            self.message(HostMessage::Torque { finger, pwm }, out);
        }
    }

    /// Any message.
    pub fn message(&self, message: HostMessage, out: &mut Vec<CanFrame>) {
        out.push(message.encode(self.device));
    }
}
