//! Slow moves of the set-points, and the easing of joints that start outside their ranges.

use std::time::Duration;

use super::axes::{AXES, RAIL_AXIS};
use crate::limiter::AxisLimits;

/// Largest speed of a slow move of a finger joint, rad/s.
const SLOW_FINGER: f64 = 0.7;
/// Largest speed of a slow move along the rail, m/s.
const SLOW_RAIL: f64 = 0.1;
/// Largest share of the limits of an axis that a slow move takes: its set-points arrive when it
/// does, however low they are.
const MAX_SHARE_OF_LIMITS: f64 = 0.5;
/// Shortest slow move, s.
const MIN_SECS: f64 = 0.3;
/// Time in which a reference moves from the joint's first position into its range, s.
const EASING_SECS: f64 = 0.5;

/// From 0 to 1 in `secs`, from rest to rest with least jerk.
fn smooth(since: Duration, secs: f64) -> f64 {
    let share = (since.as_secs_f64() / secs).clamp(0.0, 1.0);
    share * share * share * (10.0 + share * (6.0 * share - 15.0))
}

/// A slow move from rest to rest, of least jerk: every joint arrives at the same time.
#[derive(Clone, Debug)]
pub(super) struct SlowMove {
    begun: Duration,
    secs: f64,
    from: [f64; AXES],
    to: [f64; AXES],
}

impl SlowMove {
    pub fn new(begun: Duration, from: [f64; AXES], to: [f64; AXES], limits: &[AxisLimits; AXES]) -> Self {
        let needed = |axis: usize| {
            let (distance, limits) = ((to[axis] - from[axis]).abs(), limits[axis]);
            let slow = if axis < RAIL_AXIS { SLOW_FINGER } else { SLOW_RAIL };
            // The profile's top speed is 15/8 of its mean; its acceleration and jerk are at most
            // these multiples of distance over time.
            let speed = distance * 15.0 / 8.0 / slow.min(MAX_SHARE_OF_LIMITS * limits.velocity);
            let acceleration =
                (distance * 10.0 / 3.0f64.sqrt() / (MAX_SHARE_OF_LIMITS * limits.acceleration)).sqrt();
            let jerk = (distance * 60.0 / (MAX_SHARE_OF_LIMITS * limits.jerk)).cbrt();
            speed.max(acceleration).max(jerk)
        };
        let secs = (0..AXES).map(needed).fold(MIN_SECS, f64::max);
        Self { begun, secs, from, to }
    }

    /// Where to be at `now`.
    pub fn at(&self, now: Duration) -> [f64; AXES] {
        let smooth = smooth(now.saturating_sub(self.begun), self.secs);
        std::array::from_fn(|axis| self.from[axis] + (self.to[axis] - self.from[axis]) * smooth)
    }

    pub fn is_over(&self, now: Duration) -> bool {
        now.saturating_sub(self.begun).as_secs_f64() >= self.secs
    }

    /// When it is over.
    pub fn end(&self) -> Duration {
        self.begun.saturating_add(Duration::try_from_secs_f64(self.secs).unwrap_or_default())
    }
}

/// How far references are still outside the set-points that they ease into.
#[derive(Clone, Copy, Debug)]
pub(super) struct Easing {
    begun: Duration,
    from: [f64; AXES],
}

impl Easing {
    /// From `from` off the set-points at `begun`.
    pub fn new(begun: Duration, from: [f64; AXES]) -> Self {
        Self { begun, from }
    }

    /// The offsets that are left at `now`.
    pub fn left(&self, now: Duration) -> [f64; AXES] {
        self.from.map(|from| from * self.share(now))
    }

    /// The share of them that is left at `now`, 1 to 0.
    pub fn share(&self, now: Duration) -> f64 {
        1.0 - smooth(now.saturating_sub(self.begun), EASING_SECS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limiter::Axis;
    use crate::rig_file::{RigConfig, SETPOINT_HZ};

    #[test]
    fn a_slow_move_keeps_its_speeds_and_ends_at_rest() {
        let mut to = [0.0; AXES];
        (to[3], to[AXES - 1]) = (1.4, -0.3);
        let slow = SlowMove::new(Duration::from_secs(5), [0.0; AXES], to, &RigConfig::default().axes());
        let at = |millis: u64| slow.at(Duration::from_millis(millis));
        let mut fastest = [0.0f64; AXES];
        for millis in 5000..20_000 {
            let (before, after) = (at(millis), at(millis + 1));
            for axis in 0..AXES {
                fastest[axis] = fastest[axis].max((after[axis] - before[axis]).abs() * 1e3);
            }
        }
        assert!(
            fastest[3] <= SLOW_FINGER * 1.001 && (fastest[AXES - 1] - SLOW_RAIL).abs() < 1e-3,
            "{fastest:?}"
        );
        assert_eq!(at(5000), [0.0; AXES]);
        assert!(!slow.is_over(Duration::from_secs(10)) && slow.is_over(Duration::from_millis(10_626)));
        assert_eq!(at(20_000), to);
    }

    /// As a first start on a robot asks for it.
    #[test]
    fn with_low_limits_a_slow_move_is_slower_and_its_set_points_arrive_with_it() {
        let mut config = RigConfig::default();
        let limits = &mut config.limits;
        (limits.finger_velocity, limits.finger_acceleration, limits.finger_jerk) = (0.3, 1.0, 20.0);
        (limits.rail_velocity, limits.rail_acceleration, limits.rail_jerk) = (0.05, 0.1, 1.0);
        let limits = config.axes();
        let mut to = [0.0; AXES];
        (to[3], to[AXES - 1]) = (1.4, -0.2);
        let slow = SlowMove::new(Duration::ZERO, [0.0; AXES], to, &limits);
        for index in [3, AXES - 1] {
            let mut axis = Axis::at_rest(limits[index], 1.0 / SETPOINT_HZ, 0.0);
            let mut now = Duration::ZERO;
            while !slow.is_over(now) {
                now += Duration::from_secs_f64(1.0 / SETPOINT_HZ);
                axis.step(slow.at(now)[index]);
                let behind = (slow.at(now)[index] - axis.position()).abs();
                assert!(behind < 0.02 * to[index].abs(), "axis {index}, {now:?}: {behind}");
            }
            assert!((axis.position() - to[index]).abs() < 2e-3, "axis {index} at {}", axis.position());
        }
    }
}
