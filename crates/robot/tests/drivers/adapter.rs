//! A serial CAN adapter for tests: the other end of a pseudo terminal that a host opens.

use std::io::{Read as _, Write as _};
use std::time::Duration;

use etude_robot::can::{CanError, CanFrame, CanTransport, encode_frame, parse_frame};
use serialport::{SerialPort as _, TTYPort};

/// What the host writes, line by line, and whether it has opened the channel.
pub struct Adapter {
    port: TTYPort,
    /// Kept open so that hosts may come and go.
    _host: TTYPort,
    line: Vec<u8>,
    open: bool,
}

impl Adapter {
    /// An adapter, and the path that a host opens.
    pub fn new() -> (Self, String) {
        let (mut port, host) = TTYPort::pair().unwrap();
        port.set_timeout(Duration::ZERO).unwrap();
        let path = host.name().unwrap();
        (Self { port, _host: host, line: Vec::new(), open: false }, path)
    }
}

impl CanTransport for Adapter {
    /// Nothing while the channel is closed; a host that does not read loses frames.
    fn send(&mut self, frame: CanFrame) -> Result<(), CanError> {
        let mut line = Vec::new();
        encode_frame(&frame, &mut line);
        if self.open {
            let _ = self.port.write_all(&line);
        }
        Ok(())
    }

    /// The next frame that the host sends to the bus.
    fn receive(&mut self) -> Result<Option<CanFrame>, CanError> {
        let mut byte = [0];
        while matches!(self.port.read(&mut byte), Ok(1)) {
            if byte != [b'\r'] {
                self.line.push(byte[0]);
                continue;
            }
            let line = std::mem::take(&mut self.line);
            match line[..] {
                [b'O'] => self.open = true,
                [b'C'] => self.open = false,
                [b't' | b'r', ..] if self.open => return Ok(parse_frame(&line).unwrap()),
                _ => {}
            }
        }
        Ok(None)
    }
}
