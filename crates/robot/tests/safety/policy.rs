//! Policies that ask for anything.

use std::f64::consts::PI;

use etude_robot::joints::{DRIVEN, RAIL};

use crate::dice::Dice;

/// What the policy asks for while it is followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Policy {
    /// Nothing any more.
    Silent,
    /// To stand where it began.
    Still,
    /// Waves within the limits, over a third of the keyboard.
    Smooth,
    /// From one end of the keyboard to the other, as fast as the limits allow.
    Sweeps,
    /// The same with rests at the ends, in which the middle finger presses what is below it; it lets
    /// go half a second after the hand moves on.
    Drags,
    /// Something else at every set-point.
    Jumps,
    /// Numbers that are none.
    Nonsense,
}

impl Policy {
    pub fn waypoint(self, from: &[f64; DRIVEN], secs: f64, dice: &mut Dice) -> [f64; DRIVEN] {
        let rise = |amplitude: f64, speed: f64| amplitude * (1.0 - (speed * secs).cos());
        std::array::from_fn(|joint| match self {
            Self::Silent | Self::Still => from[joint],
            Self::Smooth if joint == RAIL => from[RAIL] + rise(0.12, 1.5),
            Self::Smooth if joint % 4 == 0 => from[joint],
            Self::Smooth => from[joint] + rise(0.1, 6.0 + joint as f64 * 0.1),
            Self::Sweeps if joint == RAIL => 0.3f64.copysign((3.0 * secs).sin()),
            Self::Drags if joint == RAIL => 0.3f64.copysign((PI * secs / 2.0).sin()),
            // The proximal link presses, the rest of the finger stays upright.
            Self::Drags if !(0.5..1.4).contains(&(secs % 2.0)) => match joint {
                5 => from[5] + 0.6,
                6 => from[6] - 0.6,
                _ => from[joint],
            },
            Self::Sweeps | Self::Drags => from[joint],
            Self::Jumps if joint == RAIL => dice.signed(),
            Self::Jumps => dice.signed() * 3.0,
            Self::Nonsense => match dice.below(5) {
                0 => f64::INFINITY,
                1 => f64::NEG_INFINITY,
                2 => dice.signed() * 1e300,
                _ => f64::NAN,
            },
        })
    }
}
