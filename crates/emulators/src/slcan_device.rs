//! An emulated serial CAN adapter on a pseudo terminal, for an emulated device behind it.

use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::path::PathBuf;
use std::time::Duration;

use etude_robot::can::{CanError, CanFrame, CanTransport};
use etude_robot::stream::{Outbox, read_once};
use serialport::{SerialPort, TTYPort};

use crate::slcan::SlcanAdapter;

/// Bytes that wait for a host that does not read: half a second of a hand at 333 Hz.
const WAITING_FOR_HOST: usize = 16 * 1024;

/// The adapter's end: for an emulated device behind an emulated adapter. It receives what the host sends to
/// the bus.
#[derive(Debug)]
pub struct SlcanDevice {
    name: String,
    stream: Pty,
    adapter: SlcanAdapter,
    outbox: Outbox,
    arrived: VecDeque<CanFrame>,
}

impl SlcanDevice {
    /// An adapter on a new pseudo terminal, and the path that a host opens.
    ///
    /// # Errors
    /// If the system gives no pseudo terminal.
    pub fn on_pty() -> Result<(Self, PathBuf), CanError> {
        let (stream, path) = Pty::open()?;
        let device = Self {
            name: path.display().to_string(),
            stream,
            adapter: SlcanAdapter::default(),
            outbox: Outbox::new(WAITING_FOR_HOST),
            arrived: VecDeque::new(),
        };
        Ok((device, path))
    }

    fn gone(&self) -> CanError {
        let message = "its host is gone: open the adapter again".to_owned();
        CanError::Broken { bus: self.name.clone(), message }
    }
}

impl CanTransport for SlcanDevice {
    /// A host that does not read loses frames, as with a real adapter.
    fn send(&mut self, frame: CanFrame) -> Result<(), CanError> {
        let mut bytes = Vec::with_capacity(32);
        self.adapter.send_frame(&frame, &mut bytes);
        self.outbox.push(&bytes);
        self.outbox.flush(&mut self.stream).map_err(|_| self.gone())
    }

    fn receive(&mut self) -> Result<Option<CanFrame>, CanError> {
        if let Some(frame) = self.arrived.pop_front() {
            return Ok(Some(frame));
        }
        let mut bytes = [0; 1024];
        let len = read_once(&mut self.stream, &mut bytes).map_err(|_| self.gone())?;
        let (mut frames, mut answers) = (Vec::new(), Vec::new());
        self.adapter.take_bytes(bytes.get(..len).unwrap_or(&bytes), &mut frames, &mut answers);
        self.arrived.extend(frames);
        self.outbox.push(&answers);
        self.outbox.flush(&mut self.stream).map_err(|_| self.gone())?;
        Ok(self.arrived.pop_front())
    }
}

/// The device's end of a pseudo terminal, without blocking.
#[derive(Debug)]
struct Pty {
    master: TTYPort,
    /// Kept open so that hosts may come and go.
    _slave: TTYPort,
}

impl Pty {
    fn open() -> Result<(Self, PathBuf), CanError> {
        let refuse = |message: String| CanError::Open { bus: "pty".to_owned(), message };
        let hint = "is /dev/pts mounted?";
        let (mut master, slave) = TTYPort::pair().map_err(|error| refuse(format!("{error}: {hint}")))?;
        master.set_timeout(Duration::ZERO).map_err(|error| refuse(error.to_string()))?;
        let path = slave.name().ok_or_else(|| refuse(format!("it has no name: {hint}")))?;
        Ok((Self { master, _slave: slave }, PathBuf::from(path)))
    }
}

impl Read for Pty {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.master.read(buffer)
    }
}

impl Write for Pty {
    /// Byte by byte: a pseudo terminal that is ready has room for one, and more than there is room for would block.
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        for (written, byte) in bytes.iter().enumerate() {
            match self.master.write(std::slice::from_ref(byte)) {
                Ok(1) => {}
                Err(error) if written == 0 => return Err(error),
                _ => return Ok(written),
            }
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
