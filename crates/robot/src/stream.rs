//! Streams that do not block, for drivers and emulators: reads what has come, and keeps what does
//! not fit for later.

use std::io::{self, ErrorKind, Read, Write};

/// Largest number of pieces that [`read_available`] reads in one call: a device that sends without
/// end must not hold up the control loop.
const MAX_PIECES: usize = 16;
/// Largest piece, bytes.
const PIECE: usize = 2048;

/// Whether an error only says that a stream is not ready now.
pub(crate) fn is_not_ready(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}

/// Reads once into `buffer`. Returns the number of bytes, 0 if none are there now.
///
/// # Errors
/// If the other end has closed the stream, or the stream is broken.
pub fn read_once(stream: &mut impl Read, buffer: &mut [u8]) -> io::Result<usize> {
    match stream.read(buffer) {
        Ok(0) => Err(io::Error::new(ErrorKind::UnexpectedEof, "its other end was closed")),
        Err(error) if is_not_ready(error.kind()) => Ok(0),
        outcome => outcome,
    }
}

/// Passes what is there to `take`, piece by piece.
///
/// # Errors
/// As [`read_once`]; `take` has received what came before the end.
pub fn read_available(stream: &mut impl Read, mut take: impl FnMut(&[u8])) -> io::Result<()> {
    let mut piece = [0; PIECE];
    for _ in 0..MAX_PIECES {
        match read_once(stream, &mut piece)? {
            0 => break,
            count => take(piece.get(..count).unwrap_or_default()),
        }
    }
    Ok(())
}

/// Bytes that wait for a stream: whole records go in, as many bytes as the stream takes go out.
#[derive(Debug)]
pub struct Outbox {
    bytes: Vec<u8>,
    capacity: usize,
}

impl Outbox {
    /// An empty outbox for at most `capacity` bytes.
    pub fn new(capacity: usize) -> Self {
        Self { bytes: Vec::new(), capacity }
    }

    /// Appends a whole record. Returns `false`, and appends nothing, if there is no room.
    pub fn push(&mut self, record: &[u8]) -> bool {
        let room = self.bytes.len() + record.len() <= self.capacity;
        if room {
            self.bytes.extend_from_slice(record);
        }
        room
    }

    /// Writes as much as the stream takes now.
    ///
    /// # Errors
    /// If the stream is gone.
    pub fn flush(&mut self, stream: &mut impl Write) -> io::Result<()> {
        while !self.bytes.is_empty() {
            match stream.write(&self.bytes) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(count) => drop(self.bytes.drain(..count.min(self.bytes.len()))),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if is_not_ready(error.kind()) => return Ok(()),
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}
