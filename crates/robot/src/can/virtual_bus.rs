//! The client of a virtual bus (`bus:PATH`), a CAN bus between processes over a Unix socket for
//! emulators and for machines without CAN; the bus itself is in `etude-emulators`.
//!
//! Each frame is a record of 16 bytes with the layout of Linux's `struct can_frame` and a
//! little-endian identifier: identifier and flags (4 bytes), length (1), padding (3), data (8). The
//! bus reports bus-off by error frames, as the kernel does.

use std::collections::VecDeque;
use std::io;
use std::os::unix::net::UnixStream;
use std::path::Path;

use super::{CanError, CanFrame, CanTransport};
use crate::stream::{Outbox, read_once};

const REMOTE_FLAG: u32 = 0x4000_0000;
/// Marks an error frame, whose identifier holds the class of the error (Linux's `can/error.h`).
const ERROR_FLAG: u32 = 0x2000_0000;
const BUS_OFF: u32 = 0x40;
const RESTARTED: u32 = 0x100;
/// Largest number of records that wait for an end that does not read; later ones are lost.
const QUEUE: usize = 4096;
/// Records read of one link in one call, so that one client cannot block the others.
const READ: usize = 64;

/// What a record of the socket of a virtual bus holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusRecord {
    /// A frame of the bus.
    Frame(CanFrame),
    /// The bus goes into bus-off (`true`) or comes out of it.
    BusOff(bool),
}

impl BusRecord {
    /// Bytes of a record.
    pub const SIZE: usize = 16;

    /// Its bytes.
    pub fn encode(&self) -> [u8; Self::SIZE] {
        let mut record = [0; Self::SIZE];
        let word = match self {
            Self::Frame(frame) => {
                record[4] = frame.payload().len() as u8;
                record[8..].copy_from_slice(&frame.data());
                u32::from(frame.id()) | if frame.is_remote() { REMOTE_FLAG } else { 0 }
            }
            Self::BusOff(off) => {
                record[4] = 8;
                ERROR_FLAG | if *off { BUS_OFF } else { RESTARTED }
            }
        };
        record[..4].copy_from_slice(&word.to_le_bytes());
        record
    }

    /// Reads a record; `None` if it holds neither.
    pub fn decode(record: &[u8; Self::SIZE]) -> Option<Self> {
        let [a, b, c, d, len, _, _, _, data @ ..] = record;
        let word = u32::from_le_bytes([*a, *b, *c, *d]);
        match word.checked_sub(ERROR_FLAG) {
            Some(BUS_OFF) => return Some(Self::BusOff(true)),
            Some(RESTARTED) => return Some(Self::BusOff(false)),
            _ => {}
        }
        let id = u16::try_from(word & !REMOTE_FLAG).ok()?;
        let payload = data.get(..usize::from(*len))?;
        let frame = if word & REMOTE_FLAG != 0 { CanFrame::remote(id) } else { CanFrame::new(id, payload) };
        frame.map(Self::Frame)
    }
}

/// One end of a connection between a virtual bus and a client.
#[derive(Debug)]
pub struct VirtualBusLink {
    stream: UnixStream,
    /// The beginning of a record whose rest has not come yet.
    partial: Vec<u8>,
    outbox: Outbox,
}

impl VirtualBusLink {
    /// An end of this stream.
    ///
    /// # Errors
    /// If the stream cannot be set not to block.
    pub fn new(stream: UnixStream) -> io::Result<Self> {
        stream.set_nonblocking(true)?;
        let partial = Vec::with_capacity(BusRecord::SIZE);
        Ok(Self { stream, partial, outbox: Outbox::new(QUEUE * BusRecord::SIZE) })
    }

    /// Appends the records that have come. Returns `false` if the other end is gone or has sent
    /// something else than records.
    pub fn read(&mut self, records: &mut Vec<BusRecord>) -> bool {
        let mut bytes = [0; READ * BusRecord::SIZE];
        let Ok(len) = read_once(&mut self.stream, &mut bytes) else { return false };
        self.partial.extend_from_slice(bytes.get(..len).unwrap_or_default());
        let (complete, rest) = self.partial.as_chunks();
        for record in complete {
            let Some(record) = BusRecord::decode(record) else { return false };
            records.push(record);
        }
        self.partial = rest.to_vec();
        true
    }

    /// Queues a record. Returns `false` if there is no room.
    pub fn push(&mut self, record: &BusRecord) -> bool {
        self.outbox.push(&record.encode())
    }

    /// Writes what the stream takes now. Returns `false` if the other end is gone.
    pub fn flush(&mut self) -> bool {
        self.outbox.flush(&mut self.stream).is_ok()
    }
}

/// A client of a virtual bus.
#[derive(Debug)]
pub struct VirtualBusTransport {
    bus: String,
    link: VirtualBusLink,
    arrived: VecDeque<CanFrame>,
    off: bool,
}

impl VirtualBusTransport {
    /// Joins the bus at `path`.
    ///
    /// # Errors
    /// If no virtual bus is served there.
    pub fn connect(path: impl AsRef<Path>) -> Result<Self, CanError> {
        let bus = path.as_ref().display().to_string();
        let hint = "start the emulator that serves this bus first, and give both the same path";
        match UnixStream::connect(path.as_ref()).and_then(VirtualBusLink::new) {
            Ok(link) => Ok(Self { bus, link, arrived: VecDeque::new(), off: false }),
            Err(error) => Err(CanError::Open { bus, message: format!("{error}: {hint}") }),
        }
    }

    fn broken(&self, message: &str) -> CanError {
        CanError::Broken { bus: self.bus.clone(), message: message.to_owned() }
    }

    fn closed(&self) -> CanError {
        self.broken("its virtual bus has ended: start it again, then this program")
    }

    /// Bus-off, with the commands that reset the interface of a real bus.
    fn bus_off(&self) -> CanError {
        CanError::off(&self.bus, "can0")
    }
}

impl CanTransport for VirtualBusTransport {
    fn send(&mut self, frame: CanFrame) -> Result<(), CanError> {
        if self.off {
            return Err(self.bus_off());
        }
        if !self.link.push(&BusRecord::Frame(frame)) {
            return Err(self.broken("its virtual bus takes no more frames: it hangs; start it again"));
        }
        if self.link.flush() { Ok(()) } else { Err(self.closed()) }
    }

    fn receive(&mut self) -> Result<Option<CanFrame>, CanError> {
        if let Some(frame) = self.arrived.pop_front() {
            return Ok(Some(frame));
        }
        let mut records = Vec::new();
        let alive = self.link.flush() && self.link.read(&mut records);
        for record in records {
            match record {
                BusRecord::Frame(frame) => self.arrived.push_back(frame),
                BusRecord::BusOff(off) => self.off = off,
            }
        }
        match self.arrived.pop_front() {
            Some(frame) => Ok(Some(frame)),
            None if !alive => Err(self.closed()),
            None if self.off => Err(self.bus_off()),
            None => Ok(None),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn records_have_the_layout_of_the_kernel() {
        let torque = BusRecord::Frame(CanFrame::new(0x180, &[0x77, 0x01, 0xa3]).unwrap());
        let record = [0x80, 1, 0, 0, 3, 0, 0, 0, 0x77, 0x01, 0xa3, 0, 0, 0, 0, 0];
        assert_eq!((torque.encode(), BusRecord::decode(&record)), (record, Some(torque)));
        let request = BusRecord::Frame(CanFrame::remote(0x200).unwrap());
        let record = [0, 2, 0, 0x40, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        assert_eq!((request.encode(), BusRecord::decode(&record)), (record, Some(request)));
        let mut extended = record;
        extended[3] = 0x80;
        assert_eq!(BusRecord::decode(&extended), None);
    }

    proptest! {
        #[test]
        fn any_record_is_read_or_refused(record: [u8; BusRecord::SIZE]) {
            if let Some(read) = BusRecord::decode(&record) {
                prop_assert_eq!(BusRecord::decode(&read.encode()), Some(read));
            }
        }
    }
}
