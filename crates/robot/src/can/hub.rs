//! A bus between processes over a Unix socket, for the emulators and for machines without CAN.
//!
//! Each frame is a record of 16 bytes, laid out like Linux's `struct can_frame` with a little-endian
//! identifier: identifier and flags (4), length (1), padding (3), data (8). A client whose records make no
//! sense has lost its place in the stream and is dropped: a torque must never be read out of the middle of
//! something else.

use std::collections::VecDeque;
use std::io;
use std::os::unix::fs::FileTypeExt as _;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::outbox::{Heard, Outbox, hear};
use super::{CanError, CanFrame, CanTransport};

const RECORD: usize = 16;
const REMOTE_FLAG: u32 = 0x4000_0000;
const MAX_CLIENTS: usize = 32;
/// Frames that wait for a client that does not read; later ones are lost to it.
const QUEUE: usize = 4096;
/// Bytes read of one client in one turn: nobody can keep the hub from the others.
const READ: usize = 64 * RECORD;
/// Between two turns without a frame.
const IDLE: Duration = Duration::from_micros(200);

fn record_of(frame: &CanFrame) -> [u8; RECORD] {
    let flag = if frame.is_remote() { REMOTE_FLAG } else { 0 };
    let [a, b, c, d] = (u32::from(frame.id()) | flag).to_le_bytes();
    let [d0, d1, d2, d3, d4, d5, d6, d7] = frame.data();
    [a, b, c, d, frame.payload().len() as u8, 0, 0, 0, d0, d1, d2, d3, d4, d5, d6, d7]
}

fn frame_of(record: &[u8; RECORD]) -> Option<CanFrame> {
    let [a, b, c, d, len, _, _, _, data @ ..] = record;
    let word = u32::from_le_bytes([*a, *b, *c, *d]);
    let id = u16::try_from(word & !REMOTE_FLAG).ok()?;
    let payload = data.get(..usize::from(*len))?;
    if word & REMOTE_FLAG != 0 { CanFrame::remote(id) } else { CanFrame::new(id, payload) }
}

/// One end of a stream of records.
#[derive(Debug)]
struct Link {
    stream: UnixStream,
    /// The beginning of a record whose rest has not come yet.
    partial: Vec<u8>,
    outbox: Outbox,
}

impl Link {
    fn new(stream: UnixStream) -> io::Result<Self> {
        stream.set_nonblocking(true)?;
        Ok(Self { stream, partial: Vec::with_capacity(RECORD), outbox: Outbox::new(QUEUE * RECORD) })
    }

    /// Appends the frames that have arrived; `false` if the other end is gone or talks nonsense.
    fn read(&mut self, frames: &mut impl Extend<CanFrame>) -> bool {
        let mut bytes = [0; READ];
        let heard = match hear(&mut self.stream, &mut bytes) {
            Heard::Nothing => return true,
            Heard::Gone => return false,
            Heard::Bytes(len) => bytes.get(..len).unwrap_or(&bytes),
        };
        self.partial.extend_from_slice(heard);
        let (records, rest) = self.partial.as_chunks();
        for record in records {
            let Some(frame) = frame_of(record) else { return false };
            frames.extend([frame]);
        }
        self.partial = rest.to_vec();
        true
    }

    /// Queues a frame; says whether there was room.
    fn push(&mut self, frame: &CanFrame) -> bool {
        self.outbox.push(&record_of(frame))
    }

    /// Writes what can be written; `false` if the other end is gone.
    fn flush(&mut self) -> bool {
        self.outbox.flush(&mut self.stream).is_ok()
    }
}

/// Serves the bus: each frame of a client reaches all other clients.
#[derive(Debug)]
pub struct Hub {
    path: PathBuf,
    listener: UnixListener,
    clients: Vec<Link>,
}

impl Hub {
    /// Opens the bus at `path`. A socket file left there by a hub that died is replaced.
    ///
    /// # Errors
    /// If a hub serves there already, or the file cannot be made.
    pub fn bind(path: impl AsRef<Path>) -> Result<Self, CanError> {
        let path = path.as_ref().to_path_buf();
        let open = |message: String| CanError::Open { bus: path.display().to_string(), message };
        // Another kind of file is never removed.
        if std::fs::symlink_metadata(&path).is_ok_and(|file| file.file_type().is_socket()) {
            if UnixStream::connect(&path).is_ok() {
                return Err(open("another hub serves there: stop it, or choose another path".to_owned()));
            }
            std::fs::remove_file(&path).map_err(|error| open(format!("{error}: remove this old socket")))?;
        }
        let hint = "choose a path that does not exist in a folder that you may write";
        let listener = UnixListener::bind(&path)
            .and_then(|listener| listener.set_nonblocking(true).map(|()| listener))
            .map_err(|error| open(format!("{error}: {hint}")))?;
        Ok(Self { listener, clients: Vec::new(), path })
    }

    /// Accepts who waits, passes on what has arrived, drops who is gone. Never blocks. Returns the frames
    /// passed on.
    pub fn turn(&mut self) -> usize {
        while self.clients.len() < MAX_CLIENTS {
            let Ok((stream, _)) = self.listener.accept() else { break };
            self.clients.extend(Link::new(stream).ok());
        }
        let mut passed = 0;
        let mut from = 0;
        let mut frames = Vec::new();
        while from < self.clients.len() {
            frames.clear();
            let alive = self.clients.get_mut(from).is_some_and(|client| client.read(&mut frames));
            passed += frames.len();
            for (_, client) in self.clients.iter_mut().enumerate().filter(|(to, _)| *to != from) {
                // One that does not read loses frames, whole ones.
                frames.iter().for_each(|frame| _ = client.push(frame));
            }
            if alive {
                from += 1;
            } else {
                self.clients.remove(from);
            }
        }
        self.clients.retain_mut(Link::flush);
        passed
    }

    /// Serves as long as `go_on` says so.
    pub fn serve(&mut self, mut go_on: impl FnMut() -> bool) {
        while go_on() {
            if self.turn() == 0 {
                std::thread::sleep(IDLE);
            }
        }
    }

    /// How many clients there are.
    pub fn clients(&self) -> usize {
        self.clients.len()
    }
}

impl Drop for Hub {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

/// A client of a [`Hub`].
#[derive(Debug)]
pub struct HubTransport {
    bus: String,
    link: Link,
    arrived: VecDeque<CanFrame>,
}

impl HubTransport {
    /// Joins the bus at `path`.
    ///
    /// # Errors
    /// If no hub serves there.
    pub fn connect(path: impl AsRef<Path>) -> Result<Self, CanError> {
        let bus = path.as_ref().display().to_string();
        let hint = "start the emulator that serves this bus first, and give both the same path";
        match UnixStream::connect(path.as_ref()).and_then(Link::new) {
            Ok(link) => Ok(Self { bus, link, arrived: VecDeque::new() }),
            Err(error) => Err(CanError::Open { bus, message: format!("{error}: {hint}") }),
        }
    }

    fn gone(&self) -> CanError {
        let message = "its hub is gone: start it again, then this program".to_owned();
        CanError::Broken { bus: self.bus.clone(), message }
    }
}

impl CanTransport for HubTransport {
    fn send(&mut self, frame: CanFrame) -> Result<(), CanError> {
        if !self.link.push(&frame) {
            let message = "its hub takes no more frames: it hangs; start it again".to_owned();
            return Err(CanError::Broken { bus: self.bus.clone(), message });
        }
        if self.link.flush() { Ok(()) } else { Err(self.gone()) }
    }

    fn receive(&mut self) -> Result<Option<CanFrame>, CanError> {
        if let Some(frame) = self.arrived.pop_front() {
            return Ok(Some(frame));
        }
        let alive = self.link.flush() && self.link.read(&mut self.arrived);
        match self.arrived.pop_front() {
            Some(frame) => Ok(Some(frame)),
            None if alive => Ok(None),
            None => Err(self.gone()),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_kernels_layout() {
        let torque = CanFrame::new(0x180, &[0x77, 0x01, 0xa3]).unwrap();
        let record = [0x80, 1, 0, 0, 3, 0, 0, 0, 0x77, 0x01, 0xa3, 0, 0, 0, 0, 0];
        assert_eq!((record_of(&torque), frame_of(&record)), (record, Some(torque)));
        let request = CanFrame::remote(0x200).unwrap();
        let record = [0, 2, 0, 0x40, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        assert_eq!((record_of(&request), frame_of(&record)), (record, Some(request)));
        let mut extended = record;
        extended[3] = 0x80;
        assert_eq!(frame_of(&extended), None);
    }

    proptest! {
        #[test]
        fn any_record_is_a_frame_or_refused(record: [u8; RECORD]) {
            if let Some(frame) = frame_of(&record) {
                prop_assert_eq!(frame_of(&record_of(&frame)), Some(frame));
            }
        }
    }
}
