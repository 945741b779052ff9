//! Policies that ask for anything.

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
    /// The same while a bent middle finger comes among the keys and out again.
    Dips,
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
            Self::Sweeps | Self::Dips if joint == RAIL => 0.3f64.copysign((3.0 * secs).sin()),
            // The last joint lifts the tip from where it began.
            Self::Dips if joint == 7 => from[7] + 0.5 + 0.5f64.copysign((7.3 * secs).sin()),
            Self::Sweeps | Self::Dips => from[joint],
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
