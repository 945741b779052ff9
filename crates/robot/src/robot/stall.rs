//! Whether this program stood still, and the faults that may come of it.
//!
//! If it pauses, everything that it reads afterwards is late. So the gap between two polls is
//! judged before what arrived meanwhile: above [`MAX_GAP`] it is the fault. A fault that comes soon
//! after a shorter one, and that it can cause, names it.

use std::time::Duration;

use super::fault::Fault;

/// Longest time between two polls while torques are on. The hand holds the last torque meanwhile.
const MAX_GAP: Duration = Duration::from_millis(100);
/// A gap from which on it counts: positions are old after 15 ms.
const STALL: Duration = Duration::from_millis(20);
/// Time after a stall in which it is the likely cause of a fault: two replies of the arm that do
/// not come in time.
const AFTERMATH: Duration = Duration::from_millis(500);

/// Watches the time between polls.
#[derive(Debug, Default)]
pub(super) struct StallMonitor {
    polled: Option<Duration>,
    /// When the last stall ended, and the longest of those in a row.
    last: Option<(Duration, Duration)>,
}

impl StallMonitor {
    /// Takes a poll; the fault of a gap that was too long for a robot with torques on.
    pub fn poll(&mut self, now: Duration) -> Option<Fault> {
        let gap = now.saturating_sub(self.polled.replace(now).unwrap_or(now));
        if gap >= STALL {
            let before = self.recent(now.saturating_sub(gap)).unwrap_or_default();
            self.last = Some((now, gap.max(before)));
        }
        (gap > MAX_GAP).then_some(Fault::Stalled { gap })
    }

    /// When the last poll was.
    pub fn polled(&self) -> Option<Duration> {
        self.polled
    }

    /// The fault, with the stall before it if that can be its cause.
    pub fn explain(&self, now: Duration, fault: Fault) -> Fault {
        match self.recent(now) {
            Some(gap) if fault.may_come_of_a_stall() => Fault::AfterStall { gap, fault: Box::new(fault) },
            _ => fault,
        }
    }

    /// The length of a stall that has ended a short time ago.
    fn recent(&self, now: Duration) -> Option<Duration> {
        self.last.filter(|(at, _)| now.saturating_sub(*at) <= AFTERMATH).map(|(_, gap)| gap)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::allegro::HandFault;

    const MS: Duration = Duration::from_millis(1);

    fn servo_off() -> Fault {
        HandFault::ServoOff.into()
    }

    #[test]
    fn a_stall_is_named_for_half_a_second_if_it_can_be_the_cause() {
        let mut stalls = StallMonitor::default();
        assert!((0..100).all(|ms| stalls.poll(ms * MS).is_none()));
        let named = |stalls: &StallMonitor, ms: u32, fault| match stalls.explain(ms * MS, fault) {
            Fault::AfterStall { gap, .. } => Some(gap),
            _ => None,
        };
        assert_eq!(named(&stalls, 100, servo_off()), None);
        assert!(stalls.poll(163 * MS).is_none());
        assert_eq!(named(&stalls, 163, servo_off()), Some(64 * MS));
        assert_eq!(named(&stalls, 663, servo_off()), Some(64 * MS));
        assert_eq!(named(&stalls, 664, servo_off()), None, "a servo that is off long after it");
        let hot = Fault::from(HandFault::BoardHot { celsius: 80, limit: 70 });
        assert_eq!(named(&stalls, 163, hot), None, "it heats nothing");
        // The longest of several.
        assert!(stalls.poll(193 * MS).is_none());
        assert_eq!(named(&stalls, 690, servo_off()), Some(64 * MS));
        assert!(matches!(stalls.poll(294 * MS), Some(Fault::Stalled { gap }) if gap == 101 * MS));
    }

    /// Who reads it is not sent to look for a cable.
    #[test]
    fn what_is_read_is_the_stall_what_came_of_it_and_what_to_do() {
        let fault = Fault::AfterStall { gap: 63 * MS, fault: Box::new(servo_off()) };
        let text = fault.to_string();
        assert!(text.starts_with("this program stood still for 63 ms, then: hand: the hand's servo is off"));
        assert!(text.contains("close other programs") && !text.contains("12 V"), "{text}");
    }
}
