//! The timing of a performance: deadlines of the policy, periods of the hand's loop.

use std::time::Duration;

use etude_music::CONTROL_HZ;
use etude_robot::rig_file::SETPOINT_HZ;
use serde::Serialize;

use crate::stats::{nearest_rank, sorted};

/// Times of a performance, s.
#[derive(Clone, Debug, Default)]
pub struct Timing {
    late: Vec<Duration>,
    periods: Vec<f64>,
    last_period: Option<Duration>,
}

/// Statistics of the times, in ms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct TimingReport {
    /// Control steps that were commanded.
    pub commands: usize,
    /// Commands that came after the next control step had begun, which is their deadline.
    pub missed: usize,
    /// Commands more than one set-point after the beginning of their control step: the previous
    /// set-point was held for too long.
    pub late: usize,
    /// Longest time from the beginning of a control step to its command.
    pub late_worst_ms: f64,
    /// Periods of the hand's loop.
    pub hand_periods: usize,
    /// 99.9th percentile of the periods, less the median.
    pub hand_late_p999_ms: f64,
    /// Longest period, less the median.
    pub hand_late_worst_ms: f64,
}

/// Length of a control step.
pub(crate) const CONTROL_PERIOD: Duration = Duration::from_nanos((1e9 / CONTROL_HZ) as u64);
/// Time between two set-points.
const SETPOINT: Duration = Duration::from_nanos((1e9 / SETPOINT_HZ) as u64);

impl Timing {
    /// Adds a command that came `late` after the beginning of its control step.
    pub(crate) fn command(&mut self, late: Duration) {
        self.late.push(late);
    }

    /// Adds a period of the hand's loop that ended at `at`.
    pub(crate) fn hand(&mut self, at: Duration) {
        if let Some(last) = self.last_period.replace(at) {
            self.periods.push(at.saturating_sub(last).as_secs_f64());
        }
    }

    /// Extremes and counts.
    pub fn report(&self) -> TimingReport {
        let later = |limit: Duration| self.late.iter().filter(|late| **late > limit).count();
        let late_worst = self.late.iter().max().copied().unwrap_or_default();
        let periods = sorted(self.periods.iter().copied());
        let median = nearest_rank(&periods, 0.5);
        TimingReport {
            commands: self.late.len(),
            missed: later(CONTROL_PERIOD),
            late: later(SETPOINT),
            late_worst_ms: late_worst.as_secs_f64() * 1e3,
            hand_periods: periods.len(),
            hand_late_p999_ms: (nearest_rank(&periods, 0.999) - median) * 1e3,
            hand_late_worst_ms: (nearest_rank(&periods, 1.0) - median) * 1e3,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_and_counts() {
        let mut timing = Timing::default();
        for late in 1..=1000u64 {
            timing.command(Duration::from_micros(60 * late));
        }
        for period in [0, 3, 6, 9, 16] {
            timing.hand(Duration::from_millis(period));
        }
        let report = timing.report();
        // Beyond 50 ms, and beyond 5 ms.
        assert_eq!((report.commands, report.missed, report.late, report.hand_periods), (1000, 167, 917, 4));
        let close = |a: f64, b: f64| (a - b).abs() < 1e-9;
        assert!(close(report.late_worst_ms, 60.0) && close(report.hand_late_worst_ms, 4.0));
        assert_eq!(Timing::default().report(), TimingReport::default());
    }
}
