//! Motions of the set-points: hold, move slowly to a pose, or follow a stream.

use std::time::Duration;

use super::axes::{AXES, RAIL_AXIS};
use crate::joints::DRIVEN;
use crate::limiter::AxisLimits;

/// Largest speed of a slow move of a finger joint, rad/s.
const SLOW_FINGER: f64 = 0.7;
/// Largest speed of a slow move along the rail, m/s.
const SLOW_RAIL: f64 = 0.1;
/// Largest share of the limits of an axis that a slow move takes: its set-points arrive when it does, however low they are.
const SHARE_OF_LIMITS: f64 = 0.5;
/// Shortest slow move, s.
const SHORTEST_SECS: f64 = 0.3;
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
            let (way, limits) = ((to[axis] - from[axis]).abs(), limits[axis]);
            let slow = if axis < RAIL_AXIS { SLOW_FINGER } else { SLOW_RAIL };
            // The profile's top speed is 15/8 of its mean; its acceleration and jerk are at most these multiples of way over time.
            let speed = way * 15.0 / 8.0 / slow.min(SHARE_OF_LIMITS * limits.velocity);
            let acceleration = (way * 10.0 / 3.0f64.sqrt() / (SHARE_OF_LIMITS * limits.acceleration)).sqrt();
            let jerk = (way * 60.0 / (SHARE_OF_LIMITS * limits.jerk)).cbrt();
            speed.max(acceleration).max(jerk)
        };
        let secs = (0..AXES).map(needed).fold(SHORTEST_SECS, f64::max);
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

/// A stretch of a stream: one waypoint a set-point, the first due one set-point after its beginning.
#[derive(Clone, Debug)]
pub(super) struct Stretch {
    pub begun: Duration,
    pub waypoints: Vec<[f64; DRIVEN]>,
}

impl Stretch {
    /// The waypoint that is due next at `now`, so that a grid of any phase meets each of them once; the last one when they
    /// have run out.
    pub fn at(&self, now: Duration, period: Duration) -> Option<&[f64; DRIVEN]> {
        let periods = now.saturating_sub(self.begun).as_nanos().div_ceil(period.as_nanos());
        let last = self.waypoints.len().checked_sub(1)?;
        let index = usize::try_from(periods).unwrap_or(usize::MAX).saturating_sub(1);
        self.waypoints.get(index.min(last))
    }

    /// When the last waypoint is due.
    pub fn end(&self, period: Duration) -> Duration {
        self.begun + period * u32::try_from(self.waypoints.len()).unwrap_or(u32::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limiter::Axis;
    use crate::rig::{RigConfig, SETPOINT_HZ};

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

    #[test]
    fn waypoints_are_due_one_after_the_other() {
        let period = Duration::from_millis(5);
        let waypoints: Vec<_> = (0..10).map(|n| [f64::from(n); DRIVEN]).collect();
        let stretch = Stretch { begun: Duration::from_secs(1), waypoints };
        let at = |micros: u64| stretch.at(Duration::from_micros(1_000_000 + micros), period).unwrap()[0];
        for phase in [1, 1000, 2500, 4999, 5000] {
            let met: Vec<f64> = (0..10).map(|n| at(5000 * n + phase)).collect();
            assert_eq!(met, (0..10).map(f64::from).collect::<Vec<_>>(), "phase {phase}");
        }
        assert_eq!([0, 90_000].map(at), [0.0, 9.0]);
        assert_eq!(stretch.end(period), Duration::from_millis(1050));
        assert!(Stretch { begun: Duration::ZERO, waypoints: vec![] }.at(Duration::ZERO, period).is_none());
    }
}
