//! Stops an arm over its command port alone, in any state, and reads back whether it stands still.
//!
//! The stop is the first request; nothing is read before. A reply does not prove that a command was
//! carried out, so the state is read back.

use std::time::Duration;

use super::codec::{Frame, FrameParser, PROTOCOL_PRIVATE, Register, STOPPED};

/// Time between two stop commands until the arm has confirmed.
const STOP_AGAIN: Duration = Duration::from_millis(100);
/// Time between two requests for the state.
const ASK_AGAIN: Duration = Duration::from_millis(20);
/// The arm must report the stop for this long: another command may have been on its way and undone
/// it.
const STANDS: Duration = Duration::from_millis(60);

/// Stops an arm and waits for its confirmation.
#[derive(Debug, Default)]
pub struct Stopper {
    replies: FrameParser,
    transaction: u16,
    /// When to repeat the stop, and when to request the state.
    say: Duration,
    ask: Option<Duration>,
    /// Since when it has reported the stop.
    since: Option<Duration>,
    stopped: bool,
}

impl Stopper {
    /// Appends what to send to the command port now.
    pub fn poll(&mut self, now: Duration, out: &mut Vec<u8>) {
        if self.stopped {
            return;
        }
        if now >= self.say {
            self.say = now.saturating_add(STOP_AGAIN);
            self.request(&[Register::SetState as u8, STOPPED], out);
        }
        if self.ask.is_some_and(|at| now >= at) {
            self.ask = None;
            self.request(&[Register::GetState as u8], out);
        }
    }

    /// Bytes from the command port.
    pub fn receive(&mut self, now: Duration, mut bytes: &[u8]) {
        while let Some(frame) = self.replies.next(&mut bytes) {
            let Some((_, params)) = frame.reply() else { continue };
            match Register::from_number(frame.register()) {
                // Requested after the stop was accepted, so that the answer is from after it.
                Some(Register::SetState) => self.ask = Some(now),
                Some(Register::GetState) => self.take_state(now, params.first().copied()),
                _ => {}
            }
        }
    }

    fn take_state(&mut self, now: Duration, state: Option<u8>) {
        self.ask = Some(now.saturating_add(ASK_AGAIN));
        if state == Some(STOPPED) {
            let since = *self.since.get_or_insert(now);
            self.stopped = now.saturating_sub(since) >= STANDS;
        } else if self.since.take().is_some() {
            // It had stopped, and another client started it.
            self.say = now;
        }
    }

    /// Whether the arm has confirmed that it stands still.
    pub fn is_stopped(&self) -> bool {
        self.stopped
    }

    fn request(&mut self, body: &[u8], out: &mut Vec<u8>) {
        self.transaction = self.transaction % u16::MAX + 1;
        if let Some(frame) = Frame::new(self.transaction, PROTOCOL_PRIVATE, &[body]) {
            frame.write(out);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_stops_first_and_believes_only_the_state() {
        let (mut stopper, mut out) = (Stopper::default(), Vec::new());
        stopper.poll(Duration::ZERO, &mut out);
        assert_eq!(out, [0, 1, 0, 2, 0, 2, 12, 4]);
        // The reply to the stop is none to the question.
        let at = Duration::from_millis;
        stopper.receive(at(1), &[0, 1, 0, 2, 0, 2, 12, 0]);
        assert!(!stopper.is_stopped());
        out.clear();
        stopper.poll(at(1), &mut out);
        assert_eq!(out, [0, 2, 0, 2, 0, 1, 13]);
        stopper.receive(at(2), &[0, 2, 0, 2, 0, 3, 13, 0, 1]);
        assert!(!stopper.is_stopped(), "state 1: it moves");
        out.clear();
        stopper.poll(at(15), &mut out);
        assert!(out.is_empty());
        stopper.poll(at(100), &mut out);
        assert_eq!(out, [0, 3, 0, 2, 0, 2, 12, 4, 0, 4, 0, 2, 0, 1, 13]);
        let stands = b"\x00\x04\x00\x02\x00\x03\x0d\x00\x04";
        stopper.receive(at(101), stands);
        stopper.receive(at(122), stands);
        assert!(!stopper.is_stopped(), "perhaps not for long");
        // Set going again, it is stopped again at once.
        stopper.receive(at(143), b"\x00\x04\x00\x02\x00\x03\x0d\x00\x02");
        out.clear();
        stopper.poll(at(143), &mut out);
        assert_eq!(out, [0, 5, 0, 2, 0, 2, 12, 4]);
        stopper.receive(at(145), stands);
        stopper.receive(at(205), stands);
        assert!(stopper.is_stopped());
        out.clear();
        stopper.poll(at(500), &mut out);
        assert!(out.is_empty());
    }
}
