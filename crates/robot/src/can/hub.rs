//! A bus between processes over a Unix socket, for the emulators and for machines without CAN.
//!
//! Each frame is a record of 16 bytes, laid out like Linux's `struct can_frame` with a little-endian
//! identifier: identifier and flags (4), length (1), padding (3), data (8). As a kernel, a [`Hub`] tells of bus-off by
//! error frames. A client whose records make no sense has lost its place in the stream and is dropped: a torque must
//! never be read out of the middle of something else.

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
/// Of error frames, in whose identifier stands what has happened (Linux's `can/error.h`).
const ERROR_FLAG: u32 = 0x2000_0000;
const BUS_OFF: u32 = 0x40;
const RESTARTED: u32 = 0x100;
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

/// An error frame: eight bytes, of which nothing is used.
fn error_of(what: u32) -> [u8; RECORD] {
    let mut record = [0; RECORD];
    record[..4].copy_from_slice(&(ERROR_FLAG | what).to_le_bytes());
    record[4] = 8;
    record
}

/// What a record says.
enum Said {
    Frame(CanFrame),
    /// Whether the bus is in bus-off from now on.
    Off(bool),
}

fn read_record(record: &[u8; RECORD]) -> Option<Said> {
    let [a, b, c, d, ..] = record;
    match u32::from_le_bytes([*a, *b, *c, *d]).checked_sub(ERROR_FLAG) {
        Some(BUS_OFF) => Some(Said::Off(true)),
        Some(RESTARTED) => Some(Said::Off(false)),
        _ => frame_of(record).map(Said::Frame),
    }
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

    /// Appends what has arrived; `false` if the other end is gone or talks nonsense.
    fn read(&mut self, said: &mut Vec<Said>) -> bool {
        let mut bytes = [0; READ];
        let heard = match hear(&mut self.stream, &mut bytes) {
            Heard::Nothing => return true,
            Heard::Gone => return false,
            Heard::Bytes(len) => bytes.get(..len).unwrap_or(&bytes),
        };
        self.partial.extend_from_slice(heard);
        let (records, rest) = self.partial.as_chunks();
        for record in records {
            let Some(record) = read_record(record) else { return false };
            said.push(record);
        }
        self.partial = rest.to_vec();
        true
    }

    /// Queues a record; says whether there was room.
    fn push(&mut self, record: &[u8; RECORD]) -> bool {
        self.outbox.push(record)
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
    off: bool,
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
        Ok(Self { listener, clients: Vec::new(), path, off: false })
    }

    /// Accepts who waits, passes on what has arrived, drops who is gone. Never blocks. Returns the frames
    /// passed on.
    pub fn turn(&mut self) -> usize {
        while self.clients.len() < MAX_CLIENTS {
            let Ok((stream, _)) = self.listener.accept() else { break };
            self.clients.extend(Link::new(stream).ok());
            if let (true, Some(client)) = (self.off, self.clients.last_mut()) {
                client.push(&error_of(BUS_OFF));
            }
        }
        let mut passed = 0;
        let mut from = 0;
        let mut said = Vec::new();
        while from < self.clients.len() {
            said.clear();
            let alive = self.clients.get_mut(from).is_some_and(|client| client.read(&mut said));
            // What is off is the hub's word alone.
            let alive = alive && said.iter().all(|said| matches!(said, Said::Frame(_)));
            let frames: Vec<_> = said
                .iter()
                .filter_map(|said| match said {
                    Said::Frame(frame) if !self.off => Some(record_of(frame)),
                    _ => None,
                })
                .collect();
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

    /// Puts the bus into bus-off, or ends it: every client is told, and meanwhile no frame reaches anybody.
    pub fn set_off(&mut self, off: bool) {
        if self.off != off {
            self.off = off;
            let told = error_of(if off { BUS_OFF } else { RESTARTED });
            self.clients.iter_mut().for_each(|client| _ = client.push(&told));
        }
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
    off: bool,
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
            Ok(link) => Ok(Self { bus, link, arrived: VecDeque::new(), off: false }),
            Err(error) => Err(CanError::Open { bus, message: format!("{error}: {hint}") }),
        }
    }

    fn gone(&self) -> CanError {
        let message = "its hub is gone: start it again, then this program".to_owned();
        CanError::Broken { bus: self.bus.clone(), message }
    }

    /// Takes in what has come; `false` if the hub is gone.
    fn take_in(&mut self) -> bool {
        let mut said = Vec::new();
        let alive = self.link.flush() && self.link.read(&mut said);
        for said in said {
            match said {
                Said::Frame(frame) => self.arrived.push_back(frame),
                Said::Off(off) => self.off = off,
            }
        }
        alive
    }

    /// What an operator would do about it with the interface of a real bus.
    fn is_off(&self) -> CanError {
        CanError::off(&self.bus, "can0")
    }
}

impl CanTransport for HubTransport {
    fn send(&mut self, frame: CanFrame) -> Result<(), CanError> {
        if self.off {
            return Err(self.is_off());
        }
        if !self.link.push(&record_of(&frame)) {
            let message = "its hub takes no more frames: it hangs; start it again".to_owned();
            return Err(CanError::Broken { bus: self.bus.clone(), message });
        }
        if self.link.flush() { Ok(()) } else { Err(self.gone()) }
    }

    fn receive(&mut self) -> Result<Option<CanFrame>, CanError> {
        if let Some(frame) = self.arrived.pop_front() {
            return Ok(Some(frame));
        }
        let alive = self.take_in();
        match self.arrived.pop_front() {
            Some(frame) => Ok(Some(frame)),
            None if !alive => Err(self.gone()),
            None if self.off => Err(self.is_off()),
            None => Ok(None),
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
