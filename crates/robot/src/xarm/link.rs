//! How long the arm takes to reply, and how often targets can be sent to it: the next one waits for
//! the reply to the one before.
//!
//! A target that comes much later than the period finds the arm at rest, and the motion begins anew
//! from there. On a slow link it is better to send fewer targets in even steps.

use std::time::Duration;

/// Replies after which the period is chosen.
const MEASURED: usize = 50;
/// Replies that count: those of the last second or so.
const REMEMBERED: usize = 100;
/// A period is long enough if this share of the replies comes before the arm is at rest, and if
/// waiting for late ones makes a motion this many times as long.
const ON_TIME: f64 = 0.95;
const MAX_STRETCH: f64 = 1.1;
/// Longest period: half as fast as the arm's manual recommends, and 20 mm from target to target at
/// most.
const MAX_PERIOD: Duration = Duration::from_millis(20);
/// Two pauses within this time lengthen the period: a single one may have any cause.
const RECURS: Duration = Duration::from_secs(1);
/// Share of late replies from which on they are the likeliest cause when the arm is not where it
/// was sent.
pub(super) const MANY_LATE: f64 = 0.02;

/// The link to the arm, by the times of its replies.
#[derive(Clone, Debug)]
pub(super) struct Link {
    /// The configured period.
    shortest: Duration,
    /// The period in use is so many of these: the targets stay on the grid of the set-points.
    periods: u32,
    /// The last reply times, and how many there were in all.
    replies: [Duration; REMEMBERED],
    count: usize,
    is_chosen: bool,
    paused_at: Option<Duration>,
}

/// What a link carries.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkSpeed {
    /// Time within which 95 % of the replies came; `None` before a target was sent.
    pub reply: Option<Duration>,
    /// Targets a second that are sent.
    pub hz: f64,
    /// Those that are configured.
    pub configured_hz: f64,
}

impl Link {
    pub fn new(shortest: Duration) -> Self {
        Self {
            shortest,
            periods: 1,
            replies: [Duration::ZERO; REMEMBERED],
            count: 0,
            is_chosen: false,
            paused_at: None,
        }
    }

    /// Time between two targets.
    pub fn period(&self) -> Duration {
        self.shortest * self.periods
    }

    /// The longest time between two targets that is no pause.
    pub fn max_gap(&self) -> Duration {
        max_gap(self.period())
    }

    /// Takes the time of a reply.
    pub fn take(&mut self, reply: Duration) {
        if let Some(slot) = self.replies.get_mut(self.count % REMEMBERED) {
            *slot = reply;
        }
        self.count += 1;
    }

    /// Whether enough replies were measured to choose the period.
    pub fn is_measured(&self) -> bool {
        self.count >= MEASURED
    }

    /// The arm stands still: the period becomes the shortest that the link carries, once enough
    /// replies were measured.
    pub fn choose(&mut self) {
        if self.is_measured() && !self.is_chosen {
            self.is_chosen = true;
            let most = self.most();
            self.periods = (1..most).find(|periods| self.carries(self.shortest * *periods)).unwrap_or(most);
        }
    }

    fn carries(&self, period: Duration) -> bool {
        // A pause is judged by how often it comes, however long it is.
        let most = max_gap(period);
        let waited: Duration = self.remembered().iter().map(|reply| (*reply).clamp(period, most)).sum();
        let stretch = waited.as_secs_f64() / (period.as_secs_f64() * self.remembered().len() as f64);
        self.late(period) <= 1.0 - ON_TIME && stretch <= MAX_STRETCH
    }

    /// Whether a pause that ends now makes the period longer, which begins at rest.
    pub fn lengthens(&self, now: Duration) -> bool {
        let recurs = self.paused_at.is_some_and(|before| now.saturating_sub(before) < RECURS);
        recurs && self.periods < self.most()
    }

    /// A target was sent after a pause. If pauses recur, the period gets longer.
    pub fn pause(&mut self, now: Duration) {
        self.periods += u32::from(self.lengthens(now));
        self.paused_at = Some(now);
    }

    fn most(&self) -> u32 {
        ((MAX_PERIOD.as_nanos() / self.shortest.as_nanos().max(1)) as u32).max(1)
    }

    pub fn speed(&self) -> LinkSpeed {
        let mut replies: Vec<_> = self.remembered().to_vec();
        replies.sort_unstable();
        let at = (replies.len() as f64 * ON_TIME).ceil() as usize;
        let reply = replies.get(at.saturating_sub(1)).copied();
        let hz = |period: Duration| 1.0 / period.as_secs_f64();
        LinkSpeed { reply, hz: hz(self.period()), configured_hz: hz(self.shortest) }
    }

    /// The share of the last replies that came too late.
    pub fn late_share(&self) -> f64 {
        self.late(self.period())
    }

    fn late(&self, period: Duration) -> f64 {
        let late = self.remembered().iter().filter(|reply| **reply > max_gap(period)).count();
        late as f64 / self.remembered().len().max(1) as f64
    }

    fn remembered(&self) -> &[Duration] {
        self.replies.get(..self.count.min(REMEMBERED)).unwrap_or_default()
    }
}

fn max_gap(period: Duration) -> Duration {
    period * 7 / 4
}

impl std::fmt::Display for LinkSpeed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Some(reply) = self.reply else {
            return write!(f, "not measured");
        };
        let ms = reply.as_secs_f64() * 1e3;
        write!(f, "95 % of the arm's replies within {ms:.1} ms: {:.0} targets a second", self.hz)?;
        if self.hz < self.configured_hz {
            write!(
                f,
                " instead of {:.0}; connect its control box by cable, close other programs",
                self.configured_hz
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SHORTEST: Duration = Duration::from_millis(5);

    fn measured(replies_ms: impl IntoIterator<Item = f64>) -> Link {
        let mut link = Link::new(SHORTEST);
        replies_ms.into_iter().for_each(|ms| link.take(Duration::from_secs_f64(ms / 1e3)));
        link.choose();
        link
    }

    #[test]
    fn the_period_is_the_shortest_that_the_link_carries() {
        for (reply_ms, hz) in
            [(0.3, 200.0), (5.4, 200.0), (5.6, 100.0), (10.9, 100.0), (16.0, 200.0 / 3.0), (300.0, 50.0)]
        {
            let speed = measured([reply_ms; MEASURED]).speed();
            assert!((speed.hz - hz).abs() < 1e-9, "{reply_ms} ms: {speed:?}");
        }
        // Waiting for one in eight does not make a motion much longer, but the arm would rest.
        for (late_ms, hz) in [(8.5, 200.0), (9.0, 100.0)] {
            let replies = (0..MEASURED).map(|n| if n % 8 == 0 { late_ms } else { 1.0 });
            assert!((measured(replies).speed().hz - hz).abs() < 1e-9, "{late_ms} ms");
        }
        // One odd reply in fifty is none of the link's.
        let odd = (0..MEASURED).map(|n| if n == 7 { 80.0 } else { 1.0 });
        assert!((measured(odd).speed().hz - 200.0).abs() < 1e-9);
    }

    #[test]
    fn pauses_that_recur_lengthen_the_period_and_single_ones_do_not() {
        let mut link = measured([1.0; MEASURED]);
        for secs in 1..10 {
            link.pause(Duration::from_secs(2 * secs));
            assert_eq!(link.period(), SHORTEST);
        }
        for n in 0..10 {
            link.pause(Duration::from_millis(30_000 + 300 * n));
        }
        assert_eq!(link.period(), Duration::from_millis(20));
    }

    #[test]
    fn late_replies_are_counted_by_the_period_in_use() {
        let mut link = measured([1.0; MEASURED]);
        assert_eq!(link.late_share(), 0.0);
        (0..REMEMBERED).for_each(|n| link.take(Duration::from_millis(if n % 4 == 0 { 12 } else { 1 })));
        assert!((link.late_share() - 0.25).abs() < 1e-9 && link.max_gap() == Duration::from_micros(8750));
        link.periods = 2;
        assert_eq!(link.late_share(), 0.0);
    }

    proptest! {
        #[test]
        fn whatever_is_measured_the_period_stays_in_its_bounds(
            shortest_us in 4000_u64..=10_000,
            replies_us in prop::collection::vec(0_u64..2_000_000, 0..300),
            pauses_ms in prop::collection::vec(0_u64..60_000, 0..50),
        ) {
            let mut link = Link::new(Duration::from_micros(shortest_us));
            for us in replies_us {
                link.take(Duration::from_micros(us));
                link.choose();
            }
            pauses_ms.into_iter().for_each(|ms| link.pause(Duration::from_millis(ms)));
            prop_assert!(link.period() >= link.shortest && link.period() <= MAX_PERIOD.max(link.shortest));
        }
    }
}
