//! A keyboard and what carries its bytes, in one: opens it, reads it, and opens it again after it was
//! unplugged.

use std::time::Duration;

use super::{
    driver::{KeyChange, Keyboard},
    transport::{MidiError, MidiSource, open},
};

/// Time between two attempts to open a keyboard that is not there.
const RETRY: Duration = Duration::from_millis(500);

/// A [`Keyboard`] at the end of a cable that may come and go.
pub struct KeyboardPort {
    spec: String,
    keyboard: Keyboard,
    source: Option<Box<dyn MidiSource>>,
    retry_at: Duration,
    bytes: Vec<u8>,
}

impl KeyboardPort {
    /// The keyboard at `spec` (see [`open`]); nothing is opened before the first [`poll`](Self::poll).
    pub fn new(spec: &str, keyboard: Keyboard) -> Self {
        Self { spec: spec.to_owned(), keyboard, source: None, retry_at: Duration::ZERO, bytes: Vec::new() }
    }

    /// One cycle: takes in what has come and appends what changed; tries to open a keyboard that is not
    /// there, twice a second. Call it at least every 0.2 s, or silence of the caller is taken for silence of
    /// the keyboard.
    ///
    /// # Errors
    /// Each failed attempt and each loss, for the log. The port goes on trying; the [state](Keyboard::state)
    /// of the keyboard says what to do.
    pub fn poll(&mut self, now: Duration, changes: &mut Vec<KeyChange>) -> Result<(), MidiError> {
        let result = self.read(now, changes);
        self.keyboard.poll(now, changes);
        result
    }

    /// What is known of the keyboard.
    pub fn keyboard(&self) -> &Keyboard {
        &self.keyboard
    }

    /// The same, to acknowledge its warnings.
    pub fn keyboard_mut(&mut self) -> &mut Keyboard {
        &mut self.keyboard
    }

    fn read(&mut self, now: Duration, changes: &mut Vec<KeyChange>) -> Result<(), MidiError> {
        let Some(source) = &mut self.source else {
            if now < self.retry_at {
                return Ok(());
            }
            self.retry_at = now.saturating_add(RETRY);
            self.source = Some(open(&self.spec)?);
            self.keyboard.connected(now, changes);
            return Ok(());
        };
        self.bytes.clear();
        let result = source.receive(&mut self.bytes);
        self.keyboard.receive(now, &self.bytes, changes);
        if result.is_err() {
            self.source = None;
            self.retry_at = now.saturating_add(RETRY);
            self.keyboard.disconnected(now, changes);
        }
        result
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::keyboard::{KeyboardConfig, KeyboardState, MidiOutlet};

    #[test]
    fn an_unplugged_keyboard_is_opened_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys");
        let mut port = KeyboardPort::new(
            &format!("midi:{}", path.display()),
            Keyboard::new(&KeyboardConfig::default()).unwrap(),
        );
        let mut changes = Vec::new();
        let secs = Duration::from_secs_f64;

        assert!(port.poll(secs(0.0), &mut changes).is_err(), "nobody is there");
        assert!(port.poll(secs(0.1), &mut changes).is_ok(), "and it is not tried at once again");
        assert_eq!(port.keyboard().state(), KeyboardState::Absent);

        let mut outlet = MidiOutlet::bind(&path).unwrap();
        port.poll(secs(0.5), &mut changes).unwrap();
        assert_eq!(port.keyboard().state(), KeyboardState::Present);
        outlet.send(&[0x90, 36, 100]);
        port.poll(secs(0.6), &mut changes).unwrap();
        assert_eq!(port.keyboard().pressed(), 1);

        outlet.disconnect();
        assert!(port.poll(secs(0.7), &mut changes).is_err());
        assert!(matches!(port.keyboard().state(), KeyboardState::Lost { .. }));
        assert_eq!((port.keyboard().pressed(), changes.len()), (0, 2), "the key was released");

        port.poll(secs(1.2), &mut changes).unwrap();
        assert_eq!(port.keyboard().state(), KeyboardState::Present);
        assert_eq!(port.keyboard().counts().losses, 1);
    }
}
