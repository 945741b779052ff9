//! A virtual bus: a CAN bus between processes over a Unix socket. Each frame of a client reaches
//! all other clients.
//!
//! It speaks the lines of serial adapters (slcan). A client that sends anything else is dropped,
//! because its stream is out of step: a torque must never be read from the middle of another frame.

use std::io;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

use etude_robot::can::{
    BUS_OFF, BUS_ON, CanError, CanFrame, SlcanLines, SlcanReply, encode_frame, parse_frame,
};
use etude_robot::stream::{Outbox, read_once};

use crate::socket::bind_socket;

const MAX_CLIENTS: usize = 32;
/// Bytes read of one client in one poll, so that none can block the others.
const READ: usize = 1024;
/// Bytes that wait for a client that does not read; later frames are lost.
const MAX_UNREAD: usize = 1 << 17;

/// Serves a bus.
#[derive(Debug)]
pub struct VirtualBus {
    path: PathBuf,
    listener: UnixListener,
    clients: Vec<Client>,
    off: bool,
}

impl VirtualBus {
    /// Opens the bus at `path`. A socket file that a dead process left there is replaced.
    ///
    /// # Errors
    /// If another emulator listens there, or the file cannot be made.
    pub fn bind(path: impl AsRef<Path>) -> Result<Self, CanError> {
        let path = path.as_ref().to_path_buf();
        let open = |message: String| CanError::Open { bus: path.display().to_string(), message };
        Ok(Self { listener: bind_socket(&path).map_err(open)?, clients: Vec::new(), path, off: false })
    }

    /// Accepts new clients, passes on what has arrived, and drops clients that are gone. Never
    /// blocks.
    pub fn poll(&mut self) {
        while self.clients.len() < MAX_CLIENTS {
            let Ok((stream, _)) = self.listener.accept() else { break };
            self.clients.extend(Client::new(stream).ok());
            if let (true, Some(client)) = (self.off, self.clients.last_mut()) {
                client.say(BUS_OFF);
            }
        }
        let mut from = 0;
        let (mut frames, mut lines) = (Vec::new(), Vec::new());
        while from < self.clients.len() {
            frames.clear();
            let alive = self.clients.get_mut(from).is_some_and(|client| client.read(&mut frames));
            for frame in frames.iter().filter(|_| !self.off) {
                lines.clear();
                encode_frame(frame, &mut lines);
                for (_, client) in self.clients.iter_mut().enumerate().filter(|(to, _)| *to != from) {
                    client.outbox.push(&lines);
                }
            }
            if alive {
                from += 1;
            } else {
                self.clients.remove(from);
            }
        }
        self.clients.retain_mut(|client| client.outbox.flush(&mut client.stream).is_ok());
    }

    /// Puts the bus into bus-off, or ends it. Every client receives that; during bus-off no frame
    /// is passed on.
    pub fn set_off(&mut self, off: bool) {
        if self.off != off {
            self.off = off;
            self.clients.iter_mut().for_each(|client| client.say(if off { BUS_OFF } else { BUS_ON }));
        }
    }

    /// How many clients there are.
    pub fn clients(&self) -> usize {
        self.clients.len()
    }
}

#[derive(Debug)]
struct Client {
    stream: UnixStream,
    lines: SlcanLines,
    outbox: Outbox,
}

impl Client {
    fn new(stream: UnixStream) -> io::Result<Self> {
        stream.set_nonblocking(true)?;
        Ok(Self { stream, lines: SlcanLines::default(), outbox: Outbox::new(MAX_UNREAD) })
    }

    /// Appends the frames that have come. Returns `false` if the client is gone or has sent
    /// something else than frames; bus-off comes from the bus alone.
    fn read(&mut self, frames: &mut Vec<CanFrame>) -> bool {
        let mut bytes = [0; READ];
        let Ok(len) = read_once(&mut self.stream, &mut bytes) else { return false };
        bytes.iter().take(len).all(|&byte| match self.lines.push(byte) {
            None | Some(SlcanReply::Line([])) => true,
            Some(SlcanReply::Line(line)) => match parse_frame(line) {
                Ok(Some(frame)) => {
                    frames.push(frame);
                    true
                }
                _ => false,
            },
            Some(SlcanReply::Bell | SlcanReply::Damaged) => false,
        })
    }

    fn say(&mut self, line: &[u8]) {
        self.outbox.push(&[line, b"\r"].concat());
    }
}

impl Drop for VirtualBus {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}
