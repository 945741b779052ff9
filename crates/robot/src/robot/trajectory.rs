//! The trajectory that a stream of commands gives, piece by piece.

use std::time::Duration;

use crate::joints::DRIVEN;

/// Waypoints to follow: one a set-point, the first due one set-point after its beginning.
#[derive(Clone, Debug)]
pub(super) struct Trajectory {
    pub begun: Duration,
    pub waypoints: Vec<[f64; DRIVEN]>,
}

impl Trajectory {
    /// The waypoint that is due next at `now`, so that a grid of any phase meets each of them once;
    /// the last one when they have run out.
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

    #[test]
    fn waypoints_are_due_one_after_the_other() {
        let period = Duration::from_millis(5);
        let waypoints: Vec<_> = (0..10).map(|n| [f64::from(n); DRIVEN]).collect();
        let trajectory = Trajectory { begun: Duration::from_secs(1), waypoints };
        let at = |micros: u64| trajectory.at(Duration::from_micros(1_000_000 + micros), period).unwrap()[0];
        for phase in [1, 1000, 2500, 4999, 5000] {
            let met: Vec<f64> = (0..10).map(|n| at(5000 * n + phase)).collect();
            assert_eq!(met, (0..10).map(f64::from).collect::<Vec<_>>(), "phase {phase}");
        }
        assert_eq!([0, 90_000].map(at), [0.0, 9.0]);
        assert_eq!(trajectory.end(period), Duration::from_millis(1050));
        assert!(Trajectory { begun: Duration::ZERO, waypoints: vec![] }.at(Duration::ZERO, period).is_none());
    }
}
