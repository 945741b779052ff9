//! How much later messages come than before. The arm's reports on port 30000 carry the time at
//! which they were sent. Those on port 30003 do not; they are sent at a steady rate over TCP, which
//! loses none, so their number tells it.
//!
//! A delay that was there from the first message on is not seen, nor one that grows by less than a
//! twentieth of the time.

use std::time::Duration;

/// Time after which what came sooner is forgotten: the sender's clock is not ours.
const REMEMBERED: Duration = Duration::from_secs(2);
/// Parts in which that time is forgotten.
const PARTS: usize = 4;

/// Watches a stream of messages.
#[derive(Clone, Debug)]
pub(super) struct DelayMonitor {
    period_secs: f64,
    /// When the newest message was sent, s from any moment.
    sent_secs: Option<f64>,
    /// The earliest that a message came, s from when it would have come after the first, in each
    /// part of the remembered time; the newest first.
    earliest_secs: [f64; PARTS],
    /// When the newest part began.
    began: Option<Duration>,
}

impl DelayMonitor {
    /// Of a stream whose messages, if they carry no time, come once in each period.
    pub fn new(period: Duration) -> Self {
        Self {
            period_secs: period.as_secs_f64(),
            sent_secs: None,
            earliest_secs: [f64::INFINITY; PARTS],
            began: None,
        }
    }

    /// One message has come, which was sent at this time, if it says so.
    pub fn count(&mut self, sent_at: Option<Duration>) {
        let next_secs = self.sent_secs.unwrap_or(0.0) + self.period_secs;
        self.sent_secs = Some(sent_at.map_or(next_secs, |at| at.as_secs_f64()));
    }

    /// How much later than before the newest message came, if that is `now`. Messages that came
    /// together are counted before this is called.
    pub fn delay(&mut self, now: Duration) -> Duration {
        let Some(sent_secs) = self.sent_secs else { return Duration::ZERO };
        let secs = now.as_secs_f64() - sent_secs;
        let began = *self.began.get_or_insert(now);
        if now.saturating_sub(began) > REMEMBERED / PARTS as u32 {
            self.began = Some(now);
            self.earliest_secs.rotate_right(1);
            self.earliest_secs[0] = f64::INFINITY;
        }
        self.earliest_secs[0] = self.earliest_secs[0].min(secs);
        let earliest = self.earliest_secs.iter().copied().fold(f64::INFINITY, f64::min);
        Duration::try_from_secs_f64(secs - earliest).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const PERIOD: Duration = Duration::from_millis(10);

    /// The greatest lateness that is seen of messages that come at these times, s.
    fn greatest(times: impl IntoIterator<Item = f64>) -> f64 {
        let mut monitor = DelayMonitor::new(PERIOD);
        let mut times: Vec<f64> = times.into_iter().collect();
        times.sort_by(f64::total_cmp);
        let late = times.chunk_by(|one, other| one == other).map(|together| {
            together.iter().for_each(|_| monitor.count(None));
            monitor.delay(Duration::from_secs_f64(together[0])).as_secs_f64()
        });
        late.fold(0.0, f64::max)
    }

    #[test]
    fn a_delay_that_grows_is_seen_and_one_that_stays_is_forgotten() {
        // From the third second on each message comes a millisecond later than the one before.
        let grows = |n: u32| f64::from(n) * 0.01 + f64::from(n.saturating_sub(300).min(120)) * 0.001;
        assert!((greatest((0..1000).map(grows)) - 0.12).abs() < 0.002);
        let mut monitor = DelayMonitor::new(PERIOD);
        let last = (0..1000).map(|n| {
            monitor.count(None);
            monitor.delay(Duration::from_secs_f64(grows(n)))
        });
        assert!(last.last().unwrap() < Duration::from_millis(1));
    }

    /// With the time in each message, at any rate: only what comes later than it was sent is late.
    #[test]
    fn the_time_of_a_message_counts_more_than_its_number() {
        let late = |delay_ms: fn(u64) -> u64| {
            let mut monitor = DelayMonitor::new(PERIOD);
            let sent_ms = (0..1000).map(|n| 4 * n + n % 3);
            sent_ms.fold(Duration::ZERO, |most, ms| {
                monitor.count(Some(Duration::from_millis(1_000_000 + ms)));
                monitor.delay(Duration::from_millis(ms + delay_ms(ms))).max(most)
            })
        };
        assert_eq!(late(|_| 30), Duration::ZERO);
        assert!(late(|ms| ms.saturating_sub(1500).min(120)) > Duration::from_millis(115));
    }

    #[test]
    fn messages_that_wait_for_us_are_not_late() {
        // Nobody looks for 80 ms each second: those that have waited are counted together.
        let seen = |n: u32| {
            let ms = 10 * n;
            f64::from(if ms % 1000 < 80 { ms / 1000 * 1000 + 80 } else { ms }) / 1000.0
        };
        assert!(greatest((0..1000).map(seen)) < 0.011);
    }

    proptest! {
        /// Another clock, to three parts in a thousand, and jitter: never more than the two
        /// together.
        #[test]
        fn jitter_and_drift_stay_small(
            jitter in prop::collection::vec(0.0..0.02_f64, 1500),
            drift in -0.003..0.003_f64,
        ) {
            let times = jitter.iter().enumerate().map(|(n, jitter)| n as f64 * 0.01 * (1.0 + drift) + jitter);
            // Messages do not overtake each other.
            let mut last = 0.0;
            let times: Vec<f64> = times.map(|at| { last = f64::max(last, at); last }).collect();
            prop_assert!(greatest(times) < 0.02 + 2.0 * 0.003 + 0.011);
        }
    }
}
