//! How many position frames come: a second hand of the same number doubles them, and its angles
//! are mixed with those of the first.

use std::time::Duration;

/// How long they are counted. Those of a tenth of a second may come at once.
const COUNTED: Duration = Duration::from_millis(500);
/// More than this share of what one hand sends is not from one hand.
const MAX_SHARE: f64 = 1.5;
const FINGERS: f64 = 4.0;
/// Frames that come at once after a longer time have waited for us, any number of them.
const WAITED: Duration = Duration::from_millis(100);

/// Counts the frames of all fingers. Repeated ones do not count.
#[derive(Clone, Debug, Default)]
pub(super) struct FrameRate {
    began: Option<Duration>,
    count: u32,
    last: Duration,
    /// When those came that are not counted.
    waited: Option<Duration>,
}

impl FrameRate {
    /// Takes a frame of a stream with this period; whether more come than one hand sends.
    pub fn take(&mut self, now: Duration, period: Duration) -> bool {
        if now.saturating_sub(self.last) > WAITED {
            self.waited = Some(now);
        }
        self.last = now;
        if self.waited == Some(now) {
            (self.began, self.count) = (None, 0);
            return false;
        }
        let began = *self.began.get_or_insert(now);
        if now.saturating_sub(began) > COUNTED {
            (self.began, self.count) = (Some(now), 0);
        }
        self.count += 1;
        f64::from(self.count) > MAX_SHARE * FINGERS * COUNTED.as_secs_f64() / period.as_secs_f64()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_hand_is_one_hand_also_after_a_stall() {
        let period = Duration::from_millis(3);
        // Frames a period, and periods whose frames come late and at once.
        let counted = |frames: u32, held: u32| {
            let mut rate = FrameRate::default();
            (0..1000u32).any(|n| {
                let seen = if n % 330 < held { n / 330 * 330 + held } else { n };
                (0..frames).any(|_| rate.take(period * seen, period))
            })
        };
        assert!(!counted(4, 0) && !counted(4, 33) && !counted(5, 33) && !counted(4, 300));
        assert!(counted(8, 0) && counted(7, 33));
    }
}
