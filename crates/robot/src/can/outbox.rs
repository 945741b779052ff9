//! Bytes that wait for a stream that does not block: whole records in, any number of bytes out, never more
//! than a bound.

use std::io::{ErrorKind, Read, Write};

/// Whether an error only says that a stream is not ready now.
pub(super) fn not_now(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}

/// What a stream has to say.
pub(super) enum Heard {
    Nothing,
    Bytes(usize),
    Gone,
}

/// Reads what is there.
pub(super) fn hear(stream: &mut impl Read, buffer: &mut [u8]) -> Heard {
    match stream.read(buffer) {
        Ok(0) => Heard::Gone,
        Ok(len) => Heard::Bytes(len),
        Err(error) if not_now(error.kind()) => Heard::Nothing,
        Err(_) => Heard::Gone,
    }
}

/// Bytes on their way out.
#[derive(Debug)]
pub(super) struct Outbox {
    bytes: Vec<u8>,
    most: usize,
}

impl Outbox {
    pub fn new(most: usize) -> Self {
        Self { bytes: Vec::new(), most }
    }

    /// Appends a record whole; says whether there was room.
    pub fn push(&mut self, record: &[u8]) -> bool {
        let room = self.bytes.len() + record.len() <= self.most;
        if room {
            self.bytes.extend_from_slice(record);
        }
        room
    }

    /// Writes as much as the stream takes now.
    ///
    /// # Errors
    /// If the stream is gone.
    pub fn flush(&mut self, stream: &mut impl Write) -> std::io::Result<()> {
        while !self.bytes.is_empty() {
            match stream.write(&self.bytes) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(len) => drop(self.bytes.drain(..len.min(self.bytes.len()))),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if not_now(error.kind()) => return Ok(()),
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}
