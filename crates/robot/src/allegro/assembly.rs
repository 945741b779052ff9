//! Four position frames become one period: the clock of the joint loop.
//!
//! The hand sends its four frames back to back; any of them may be lost, duplicated, swapped or
//! late. A period ends when all four have arrived, or half a period after the first, or when a
//! finger sends other angles. A finger whose frame is missing keeps its last angles. An adapter may
//! deliver two periods at once: ends closer together than half a period count as one.

use std::time::Duration;

/// The effect of a position frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Taken {
    /// The frame is a duplicate.
    pub duplicate: bool,
    /// A period is over: the joint loop may compute. The time of its last frame.
    pub tick: Option<Duration>,
}

/// Collects the frames of a period.
#[derive(Clone, Debug, Default)]
pub(super) struct Assembly {
    half_period: Duration,
    opened: Duration,
    newest: Duration,
    window: [Option<[i16; 4]>; 4],
    /// The window that was closed last: its last frame may come again.
    closed: [Option<[i16; 4]>; 4],
    ticked: Option<Duration>,
}

impl Assembly {
    pub fn new(period: Duration) -> Self {
        Self { half_period: period / 2, ..Self::default() }
    }

    /// Takes the frame of one finger (0 to 3; others are ignored).
    pub fn take(&mut self, now: Duration, finger: usize, counts: [i16; 4]) -> Taken {
        let mut taken = self.expire(now);
        let Some(&slot) = self.window.get(finger) else { return taken };
        let just_closed = self.missing() == 4 && now.saturating_sub(self.newest) <= self.half_period;
        let again = just_closed && self.closed.get(finger) == Some(&Some(counts));
        if slot == Some(counts) || again {
            return Taken { duplicate: true, ..taken };
        }
        if slot.is_some() {
            taken = self.close();
        }
        if self.missing() == 4 {
            self.opened = now;
        }
        self.newest = now;
        if let Some(slot) = self.window.get_mut(finger) {
            *slot = Some(counts);
        }
        if self.missing() == 0 {
            let whole = self.close();
            taken.tick = taken.tick.or(whole.tick);
        }
        taken
    }

    /// Ends a period whose missing frames are overdue.
    pub fn expire(&mut self, now: Duration) -> Taken {
        let late = self.missing() < 4 && now.saturating_sub(self.opened) > self.half_period;
        if late { self.close() } else { Taken::default() }
    }

    fn close(&mut self) -> Taken {
        self.closed = std::mem::take(&mut self.window);
        let tick = self.ticked.is_none_or(|at| self.newest.saturating_sub(at) >= self.half_period);
        if tick {
            self.ticked = Some(self.newest);
        }
        Taken { duplicate: false, tick: tick.then_some(self.newest) }
    }

    fn missing(&self) -> usize {
        self.window.iter().filter(|slot| slot.is_none()).count()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const PERIOD: Duration = Duration::from_millis(3);

    /// Frames as (microseconds, finger, angle); gives when it ticked and how many were doubled.
    /// With `polled`, a look at the clock each 0.1 ms, as a driver that is polled has it.
    fn play(frames: &[(u64, usize, i16)], polled: bool) -> (Vec<u64>, u32) {
        let mut assembly = Assembly::new(PERIOD);
        let (mut ticks, mut duplicates) = (vec![], 0);
        let mut count = |micros: u64, taken: Taken| {
            duplicates += u32::from(taken.duplicate);
            ticks.extend(taken.tick.map(|_| micros));
        };
        let mut clock = 0;
        for &(micros, finger, angle) in frames {
            while polled && clock < micros {
                count(clock, assembly.expire(Duration::from_micros(clock)));
                clock += 100;
            }
            count(micros, assembly.take(Duration::from_micros(micros), finger, [angle; 4]));
        }
        (ticks, duplicates)
    }

    fn period(n: u64, fingers: &[usize]) -> Vec<(u64, usize, i16)> {
        fingers.iter().enumerate().map(|(i, &f)| (3000 * n + 130 * i as u64, f, n as i16)).collect()
    }

    fn periods(fingers: &[&[usize]]) -> Vec<(u64, usize, i16)> {
        (0u64..).zip(fingers).flat_map(|(n, fingers)| period(n, fingers)).collect()
    }

    #[test]
    fn whole_lost_doubled_and_swapped() {
        const ALL: &[usize] = &[0, 1, 2, 3];
        assert_eq!(play(&periods(&[ALL; 3]), false), (vec![390, 3390, 6390], 0));
        // One lost: half a period after its first the period is over.
        for fingers in [&[0, 1, 3], &[1, 2, 3]] {
            let played = play(&periods(&[ALL, fingers, ALL, ALL]), true);
            assert_eq!(played, (vec![390, 4600, 6390, 9390], 0));
            // Without a look at the clock, when the next frame comes.
            assert_eq!(play(&periods(&[ALL, fingers, ALL, ALL]), false), (vec![390, 6000, 6390, 9390], 0));
        }
        assert_eq!(play(&periods(&[&[3, 0, 2, 1][..]; 2]), true), (vec![390, 3390], 0));
        assert_eq!(play(&periods(&[&[0, 0, 1, 2, 2, 3, 3][..]; 2]), true), (vec![650, 3650], 6));
        // A finger that is gone for good does not stop the clock (its age will stop the hand).
        assert_eq!(play(&periods(&[&[0, 1, 2][..]; 100]), true).0.len(), 99);
        // Two periods at one moment.
        let burst: Vec<_> = periods(&[ALL, ALL]).iter().map(|&(_, f, n)| (0, f, n)).collect();
        assert_eq!(play(&burst, true).0, [0]);
        // A frame that arrives after the next period has begun puts nothing out of step for long.
        let mut frames = periods(&[ALL; 10]);
        let late = frames.remove(7);
        frames.insert(8, (6010, late.1, late.2));
        let (ticks, _) = play(&frames, true);
        assert_eq!(ticks[ticks.len() - 6..], [12390, 15390, 18390, 21390, 24390, 27390]);
    }

    proptest! {
        /// Whatever is lost, the clock neither stalls nor runs away.
        #[test]
        fn the_clock_goes_on(
            lost in prop::collection::vec(0u8..16, 200),
            jitter in prop::collection::vec(0u64..400, 200),
            polled: bool,
        ) {
            let frames: Vec<_> = (0u64..).zip(lost.iter().zip(&jitter)).flat_map(|(n, (&mask, &late))| {
                let mask = if mask == 15 { 0 } else { mask };
                let fingers: Vec<usize> = (0..4).filter(|f| mask & (1 << f) == 0).collect();
                period(n, &fingers).into_iter().map(move |(at, f, c)| (at + late, f, c)).collect::<Vec<_>>()
            }).collect();
            let (ticks, _) = play(&frames, polled);
            prop_assert!((199..=200).contains(&ticks.len()), "{}", ticks.len());
            // Two periods and the jitter, where only the next frame tells that one was lost;
            // polled, well below.
            let longest = if polled { 5200 } else { 6800 };
            prop_assert!(ticks.windows(2).all(|pair| pair[1] - pair[0] <= longest), "{ticks:?}");
        }
    }
}
