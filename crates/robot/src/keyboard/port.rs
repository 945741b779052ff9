//! The bytes of a keyboard whose cable may come and go: opened again after it was unplugged.

use std::time::Duration;

use super::source::{MidiError, MidiSource};
use super::transport::open;

/// Time between two attempts to open a keyboard that is not connected.
const TRY_AGAIN: Duration = Duration::from_secs(1);

/// A keyboard at the end of a cable that may come and go.
pub struct MidiPort {
    spec: String,
    source: Option<Box<dyn MidiSource>>,
    /// Not before this is it looked for again.
    again: Duration,
}

impl MidiPort {
    /// The keyboard at `spec` (see [`open`]), which need not be there yet.
    pub fn new(spec: &str) -> Self {
        Self { spec: spec.to_owned(), source: None, again: Duration::ZERO }
    }

    /// The same, but it must be there.
    ///
    /// # Errors
    /// If the specification is wrong or nothing is there.
    pub fn open(spec: &str) -> Result<Self, MidiError> {
        Ok(Self { source: Some(open(spec)?), ..Self::new(spec) })
    }

    /// Appends the bytes that have come. A keyboard that is gone is looked for once a second. Never
    /// blocks.
    ///
    /// # Errors
    /// As long as it is not connected; bytes that came before are still appended.
    pub fn receive(&mut self, now: Duration, out: &mut Vec<u8>) -> Result<(), MidiError> {
        if self.source.is_none() {
            if now < self.again {
                let message = "not found again yet".into();
                return Err(MidiError::Lost { spec: self.spec.clone(), message });
            }
            self.again = now.saturating_add(TRY_AGAIN);
            self.source = Some(open(&self.spec)?);
        }
        let Some(source) = &mut self.source else { return Ok(()) };
        source.receive(out).inspect_err(|_| {
            self.source = None;
            self.again = now.saturating_add(TRY_AGAIN);
        })
    }
}
