//! A bus behind a serial adapter, on a serial port; and a virtual bus between processes, which uses
//! the adapters' lines on a Unix socket.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::os::unix::net::UnixStream;
use std::path::Path;

use serialport::{ClearBuffer, SerialPort, TTYPort};

use super::slcan::{BUS_OFF, SlcanLines, SlcanReply, encode_frame, parse_frame};
use super::{CanError, CanFrame, CanTransport};
use crate::stream::{Outbox, read_once};

const DEFAULT_BAUD: u32 = 115_200;
/// Largest number of bytes that wait while the stream accepts none: about 80 frames.
const WAITING: usize = 2048;
const ADAPTER_GONE: &str = "the adapter is gone: plug it in again, then start again";
const BUS_GONE: &str = "its virtual bus has ended: start it again, then this program";
/// Refusals in a row, without a frame sent or received between them, after which the adapter is
/// abandoned.
const REFUSALS: u32 = 16;
/// Ends a half-written line of an earlier program, closes, sets 1 Mbit/s, opens.
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
    /// Whether the channel is another program's: what that has opened stays open.
    joined: bool,
    /// What to do when the other end is gone.
    gone: &'static str,
    /// Whether a virtual bus is in bus-off.
    off: bool,
}

/// A serial port that does not block.
#[derive(Debug)]
pub struct SlcanPort {
    file: File,
    /// Holds the settings of the port.
    settings: TTYPort,
}

impl SlcanTransport<SlcanPort> {
    /// Opens the adapter on a serial port, `/dev/ttyUSB0` or `/dev/ttyUSB0@115200`, on a bus of 1
    /// Mbit/s. Adapters that are USB devices themselves ignore the serial speed; a hand at 333 Hz
    /// needs about 600 000 baud of a true serial line.
    ///
    /// # Errors
    /// If the port cannot be opened.
    pub fn open(spec: &str) -> Result<Self, CanError> {
        let port = SlcanPort::open(spec)?;
        // Discards what an earlier session left.
        let _ = port.settings.clear(ClearBuffer::All);
        Self::over(&format!("slcan:{spec}"), port)
    }

    /// Joins the program that has opened the adapter on this port: frames go out on the channel as
    /// it is, which is left as it is in the end. The adapter's answers go to the program that reads
    /// them first.
    ///
    /// # Errors
    /// If the port cannot be opened.
    pub fn join(spec: &str) -> Result<Self, CanError> {
        Self::with(&format!("slcan:{spec}"), SlcanPort::open(spec)?, true, ADAPTER_GONE)
    }
}

impl SlcanTransport<UnixStream> {
    /// Joins the virtual bus at `path`.
    ///
    /// # Errors
    /// If none is served there.
    pub fn connect(path: impl AsRef<Path>) -> Result<Self, CanError> {
        let bus = path.as_ref().display().to_string();
        let hint = "start the emulator that serves this bus first, and give both the same path";
        let connected =
            UnixStream::connect(path).and_then(|stream| stream.set_nonblocking(true).map(|()| stream));
        match connected {
            Ok(stream) => Self::with(&bus, stream, true, BUS_GONE),
            Err(error) => Err(CanError::Open { bus, message: format!("{error}: {hint}") }),
        }
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
        Self::with(name, stream, false, ADAPTER_GONE)
    }

    fn with(name: &str, stream: S, joined: bool, gone: &'static str) -> Result<Self, CanError> {
        let mut transport = Self {
            name: name.to_owned(),
            stream,
            lines: SlcanLines::default(),
            outbox: Outbox::new(WAITING),
            arrived: VecDeque::new(),
            refusals: 0,
            joined,
            gone,
            off: false,
        };
        transport.outbox.push(if joined { END_OF_LINE } else { OPEN });
        transport.flush()?;
        Ok(transport)
    }

    fn broken(&self, message: &str) -> CanError {
        CanError::Broken { bus: self.name.clone(), message: message.to_owned() }
    }

    fn flush(&mut self) -> Result<(), CanError> {
        self.outbox.flush(&mut self.stream).map_err(|error| self.broken(&format!("{}: {error}", self.gone)))
    }

    fn take(&mut self, byte: u8) {
        match self.lines.push(byte) {
            None | Some(SlcanReply::Damaged) => {}
            Some(SlcanReply::Bell) => self.refusals = self.refusals.saturating_add(1),
            // A line that cannot be read is left out.
            Some(SlcanReply::Line(line @ [b't' | b'r' | b'T' | b'R', ..])) => {
                if let Ok(frame) = parse_frame(line) {
                    self.refusals = 0;
                    self.arrived.extend(frame);
                }
            }
            Some(SlcanReply::Line(status @ [b'F', ..])) => self.off = status == BUS_OFF,
            // Other lines are answers: a frame or a command was accepted.
            Some(SlcanReply::Line(_)) => self.refusals = 0,
        }
    }
}

impl<S: Read + Write + Send> CanTransport for SlcanTransport<S> {
    fn send(&mut self, frame: CanFrame) -> Result<(), CanError> {
        if self.off {
            return Err(CanError::off(&self.name, "can0"));
        }
        let mut line = Vec::with_capacity(32);
        encode_frame(&frame, &mut line);
        self.flush()?;
        if !self.outbox.push(&line) {
            return Err(
                self.broken("the other end takes no more bytes: is a serial speed (@baud) high enough?")
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
        let read = read_once(&mut self.stream, &mut bytes);
        let len = read.map_err(|_| self.broken(self.gone))?;
        bytes.iter().take(len).for_each(|&byte| self.take(byte));
        if self.refusals >= REFUSALS {
            let message = "the adapter refuses every frame: check that the hand has power and the bus its \
                           terminator, and that no other program uses the adapter";
            return Err(self.broken(message));
        }
        match self.arrived.pop_front() {
            None if self.off => Err(CanError::off(&self.name, "can0")),
            arrived => Ok(arrived),
        }
    }
}

impl<S: Read + Write + Send> Drop for SlcanTransport<S> {
    /// Closes the channel if it is ours, so that the adapter stops sending. After a panic it stays
    /// open: the guard uses it to stop the hand.
    fn drop(&mut self) {
        if !self.joined && !std::thread::panicking() {
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
