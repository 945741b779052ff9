//! Serial adapters on real streams: the host's end on a serial port, and the adapter's end on a pseudo
//! terminal.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;
use std::time::Duration;

use serialport::{ClearBuffer, SerialPort, TTYPort};

use super::outbox::{Heard, Outbox, hear};
use super::slcan::{SlcanAdapter, SlcanLines, SlcanReply, encode_frame, parse_frame};
use super::{CanError, CanFrame, CanTransport};

const DEFAULT_BAUD: u32 = 115_200;
/// Bytes that wait for a stream that takes none: some 80 frames.
const WAITING: usize = 2048;
/// The same in the emulated adapter: half a second of a hand at 333 Hz, for a host that other work holds up.
const WAITING_FOR_HOST: usize = 16 * 1024;
/// Refusals in a row, without a frame sent or received between them, after which the adapter is given up.
const REFUSALS: u32 = 16;
/// Ends a line left half written by somebody before, closes, sets 1 Mbit/s, opens.
const OPEN: &[u8] = b"\rC\rS8\rO\r";
/// Ends such a line, no more.
const END_OF_LINE: &[u8] = b"\r";
/// O_NOCTTY | O_NONBLOCK, as the system numbers them; serialport itself opens ports to block.
const FLAGS: i32 = if cfg!(target_os = "linux") { 0o400 | 0o4000 } else { 0x2_0000 | 0x4 };

/// The host's end: a bus behind a serial adapter.
#[derive(Debug)]
pub struct SlcanTransport<S: Read + Write + Send> {
    name: String,
    stream: S,
    lines: SlcanLines,
    outbox: Outbox,
    arrived: VecDeque<CanFrame>,
    refusals: u32,
    damaged: u64,
    /// Whether the channel is another program's: what that has opened stays open.
    joined: bool,
}

/// A serial port that does not block.
#[derive(Debug)]
pub struct SlcanPort {
    file: File,
    /// Holds the settings of the port.
    settings: TTYPort,
}

impl SlcanTransport<SlcanPort> {
    /// Opens the adapter on a serial port, `/dev/ttyUSB0` or `/dev/ttyUSB0@115200`, on a bus of 1 Mbit/s.
    /// Adapters that are USB devices themselves ignore the serial speed; a hand at 333 Hz needs about 600 000
    /// baud of a true serial line.
    ///
    /// # Errors
    /// If the port cannot be opened.
    pub fn open(spec: &str) -> Result<Self, CanError> {
        let port = SlcanPort::open(spec)?;
        // What an earlier session left there is none of ours.
        let _ = port.settings.clear(ClearBuffer::All);
        Self::over(&format!("slcan:{spec}"), port)
    }

    /// Joins the program that has opened the adapter on this port: frames go out on the channel as it is, which is left
    /// as it is in the end. What the adapter says goes to whichever of the two reads it first.
    ///
    /// # Errors
    /// If the port cannot be opened.
    pub fn join(spec: &str) -> Result<Self, CanError> {
        Self::with(&format!("slcan:{spec}"), SlcanPort::open(spec)?, true)
    }
}

impl SlcanPort {
    fn open(spec: &str) -> Result<Self, CanError> {
        let refuse = |message: String| CanError::Open { bus: format!("slcan:{spec}"), message };
        let (path, baud) = match spec.split_once('@') {
            None => (spec, DEFAULT_BAUD),
            Some((path, baud)) => {
                (path, baud.parse().map_err(|_| refuse(format!("{baud} is no serial speed")))?)
            }
        };
        let hint =
            "plug the adapter in, look for its name with `ls /dev/tty*`, and join the group that owns it";
        let settings = serialport::new(path, baud)
            .exclusive(false)
            .open_native()
            .map_err(|error| refuse(format!("{error}: {hint}")))?;
        let file = File::options().read(true).write(true).custom_flags(FLAGS).open(path);
        let file = file.map_err(|error| refuse(format!("{error}: {hint}")))?;
        Ok(Self { file, settings })
    }
}

impl<S: Read + Write + Send> SlcanTransport<S> {
    /// Opens the adapter at the other end of a stream that does not block. `name` is for messages.
    ///
    /// # Errors
    /// If the stream is gone.
    pub fn over(name: &str, stream: S) -> Result<Self, CanError> {
        Self::with(name, stream, false)
    }

    fn with(name: &str, stream: S, joined: bool) -> Result<Self, CanError> {
        let mut transport = Self {
            name: name.to_owned(),
            stream,
            lines: SlcanLines::default(),
            outbox: Outbox::new(WAITING),
            arrived: VecDeque::new(),
            refusals: 0,
            damaged: 0,
            joined,
        };
        transport.outbox.push(if joined { END_OF_LINE } else { OPEN });
        transport.flush()?;
        Ok(transport)
    }

    /// Lines that made no sense so far.
    pub fn damaged(&self) -> u64 {
        self.damaged
    }

    fn broken(&self, message: &str) -> CanError {
        CanError::Broken { bus: self.name.clone(), message: message.to_owned() }
    }

    fn flush(&mut self) -> Result<(), CanError> {
        self.outbox
            .flush(&mut self.stream)
            .map_err(|error| self.broken(&format!("{error}: plug the adapter in again, then start again")))
    }

    fn take(&mut self, byte: u8) {
        match self.lines.push(byte) {
            None => {}
            Some(SlcanReply::Bell) => self.refusals = self.refusals.saturating_add(1),
            Some(SlcanReply::Damaged) => self.damaged += 1,
            Some(SlcanReply::Line(line @ [b't' | b'r' | b'T' | b'R', ..])) => match parse_frame(line) {
                Ok(frame) => {
                    self.refusals = 0;
                    self.arrived.extend(frame);
                }
                Err(_) => self.damaged += 1,
            },
            // Other lines are answers: a frame or a command was accepted.
            Some(SlcanReply::Line(_)) => self.refusals = 0,
        }
    }
}

impl<S: Read + Write + Send> CanTransport for SlcanTransport<S> {
    fn send(&mut self, frame: CanFrame) -> Result<(), CanError> {
        let mut line = Vec::with_capacity(32);
        encode_frame(&frame, &mut line);
        self.flush()?;
        if !self.outbox.push(&line) {
            return Err(
                self.broken("the adapter takes no more bytes: is its serial speed (@baud) high enough?")
            );
        }
        self.flush()
    }

    fn receive(&mut self) -> Result<Option<CanFrame>, CanError> {
        if let Some(frame) = self.arrived.pop_front() {
            return Ok(Some(frame));
        }
        self.flush()?;
        let mut bytes = [0; 1024];
        match hear(&mut self.stream, &mut bytes) {
            Heard::Nothing => {}
            Heard::Gone => return Err(self.broken("the adapter is gone: plug it in again, then start again")),
            Heard::Bytes(len) => bytes.iter().take(len).for_each(|&byte| self.take(byte)),
        }
        if self.refusals >= REFUSALS {
            let message = "the adapter refuses every frame: check that the hand has power and the bus its \
                           terminator, and that no other program uses the adapter";
            return Err(self.broken(message));
        }
        Ok(self.arrived.pop_front())
    }
}

impl<S: Read + Write + Send> Drop for SlcanTransport<S> {
    /// Closes the channel if it is ours, so that the adapter does not go on sending into nowhere.
    fn drop(&mut self) {
        if !self.joined {
            self.outbox.push(b"C\r");
        }
        let _ = self.outbox.flush(&mut self.stream);
    }
}

impl Read for SlcanPort {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.file.read(buffer)
    }
}

impl Write for SlcanPort {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// The adapter's end: for an emulated device behind an emulated adapter. It receives what the host sends to
/// the bus.
#[derive(Debug)]
pub struct SlcanDevice<S: Read + Write + Send> {
    name: String,
    stream: S,
    adapter: SlcanAdapter,
    outbox: Outbox,
    arrived: VecDeque<CanFrame>,
}

impl SlcanDevice<Pty> {
    /// An adapter on a new pseudo terminal, and the path that a host opens.
    ///
    /// # Errors
    /// If the system gives no pseudo terminal.
    pub fn on_pty() -> Result<(Self, PathBuf), CanError> {
        let (pty, path) = Pty::open()?;
        Ok((Self::over(&path.display().to_string(), pty), path))
    }
}

impl<S: Read + Write + Send> SlcanDevice<S> {
    /// An adapter at this end of a stream that does not block. `name` is for messages.
    pub fn over(name: &str, stream: S) -> Self {
        Self {
            name: name.to_owned(),
            stream,
            adapter: SlcanAdapter::new(),
            outbox: Outbox::new(WAITING_FOR_HOST),
            arrived: VecDeque::new(),
        }
    }

    fn gone(&self) -> CanError {
        let message = "its host is gone: open the adapter again".to_owned();
        CanError::Broken { bus: self.name.clone(), message }
    }
}

impl<S: Read + Write + Send> CanTransport for SlcanDevice<S> {
    /// A host that does not read loses frames, as with a real adapter.
    fn send(&mut self, frame: CanFrame) -> Result<(), CanError> {
        let mut bytes = Vec::with_capacity(32);
        self.adapter.to_host(&frame, &mut bytes);
        self.outbox.push(&bytes);
        self.outbox.flush(&mut self.stream).map_err(|_| self.gone())
    }

    fn receive(&mut self) -> Result<Option<CanFrame>, CanError> {
        if let Some(frame) = self.arrived.pop_front() {
            return Ok(Some(frame));
        }
        let mut bytes = [0; 1024];
        match hear(&mut self.stream, &mut bytes) {
            Heard::Nothing => {}
            Heard::Gone => return Err(self.gone()),
            Heard::Bytes(len) => {
                let (mut frames, mut answers) = (Vec::new(), Vec::new());
                self.adapter.from_host(bytes.get(..len).unwrap_or(&bytes), &mut frames, &mut answers);
                self.arrived.extend(frames);
                self.outbox.push(&answers);
            }
        }
        self.outbox.flush(&mut self.stream).map_err(|_| self.gone())?;
        Ok(self.arrived.pop_front())
    }
}

/// The device's end of a pseudo terminal, without blocking.
#[derive(Debug)]
pub struct Pty {
    master: TTYPort,
    /// Kept open so that hosts may come and go.
    _slave: TTYPort,
}

impl Pty {
    /// A new pseudo terminal, and the path of its other end.
    ///
    /// # Errors
    /// If the system gives none.
    pub fn open() -> Result<(Self, PathBuf), CanError> {
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
