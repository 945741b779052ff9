//! The limiter: the only path from a policy, a simulation or an operator to a set-point that a
//! device is asked to follow.
//!
//! One [`Axis`] per joint moves a set-point on a fixed time grid. Position, velocity, acceleration
//! and jerk, all taken as differences of what was sent on that grid, stay within [`AxisLimits`] for
//! any target, NaN and infinity included. A stream that keeps the limits passes through unchanged;
//! one that does not is followed as fast as the limits allow. A target that jumps and then stands
//! still is not passed, except by what the jerk limit moves an axis in one step when the jump is as
//! small as that (jerk · step³): the first step of a stream looks the same.
//!
//! Why the limits hold: a state is *viable* if braking from it keeps them until rest. The axis
//! starts at rest, which is viable, and takes only steps to viable states. Braking on is one of
//! them by definition, so there is always one.

mod axis;
mod axis_state;
mod clamp;
mod limits;

pub use axis::Axis;
pub use clamp::Clamp;
pub use limits::AxisLimits;
