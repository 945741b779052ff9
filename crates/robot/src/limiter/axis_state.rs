//! A set-point's state on the grid, and how it comes to rest within the limits.

use super::limits::AxisLimits;

/// Position, velocity and acceleration of a set-point, as differences on the grid.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct AxisState {
    pub position: f64,
    pub velocity: f64,
    pub acceleration: f64,
}

/// Steps that are looked ahead while braking: far more than a stop may take on a grid of
/// milliseconds.
const MAX_BRAKE_STEPS: usize = 20_000;
/// Rounding allowed for in comparisons with limits, as a fraction.
pub(super) const ROUNDING: f64 = 1e-9;
impl AxisState {
    /// The state after one step with this acceleration.
    pub fn after(self, acceleration: f64, step_secs: f64) -> Self {
        let velocity = self.velocity + acceleration * step_secs;
        Self { position: self.position + velocity * step_secs, velocity, acceleration }
    }

    /// One step of coming to rest as fast as acceleration and jerk allow.
    pub fn brake(self, limits: &AxisLimits, step_secs: f64) -> Self {
        let ramp = limits.jerk * step_secs;
        let speed = self.velocity.abs();
        // The deceleration from which ramping back to zero uses up just the speed that is left.
        let stopping = (ramp * ramp / 4.0 + 2.0 * limits.jerk * speed).sqrt() - ramp / 2.0;
        let deceleration = stopping.min(speed / step_secs).min(limits.acceleration);
        let wanted = -deceleration.copysign(self.velocity);
        self.after(wanted.clamp(self.acceleration - ramp, self.acceleration + ramp), step_secs)
    }

    /// Whether it is at rest, apart from rounding.
    fn rests(self, limits: &AxisLimits, step_secs: f64) -> bool {
        self.velocity.abs() <= limits.velocity * 1e-12
            && self.acceleration.abs() <= limits.jerk * step_secs * (1.0 + ROUNDING)
    }

    /// Its states while braking, from this one until it rests.
    pub fn braking(self, limits: &AxisLimits, step_secs: f64) -> impl Iterator<Item = Self> {
        let next =
            move |state: &Self| (!state.rests(limits, step_secs)).then(|| state.brake(limits, step_secs));
        std::iter::successors(Some(self), next).take(MAX_BRAKE_STEPS)
    }

    /// Whether position and velocity keep their limits while braking.
    pub fn is_viable(self, limits: &AxisLimits, step_secs: f64) -> bool {
        let [low, high] = limits.position;
        let slack = (high - low) * ROUNDING;
        self.braking(limits, step_secs).all(|state| {
            (low - slack..=high + slack).contains(&state.position)
                && state.velocity.abs() <= limits.velocity * (1.0 + ROUNDING)
        })
    }
}
