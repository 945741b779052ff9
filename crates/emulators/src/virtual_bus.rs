//! A virtual bus: a CAN bus between processes over a Unix socket. Each frame of a client reaches
//! all other clients.
//!
//! A client that sends invalid records is dropped, because its stream is out of step: a torque must
//! never be read from the middle of another record.

use std::os::unix::fs::FileTypeExt as _;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

use etude_robot::can::{BusRecord, CanError, VirtualBusLink};

const MAX_CLIENTS: usize = 32;

/// Serves a bus.
#[derive(Debug)]
pub struct VirtualBus {
    path: PathBuf,
    listener: UnixListener,
    clients: Vec<VirtualBusLink>,
    off: bool,
}

impl VirtualBus {
    /// Opens the bus at `path`. A socket file that a dead process left there is replaced.
    ///
    /// # Errors
    /// If another virtual bus is served there, or the file cannot be made.
    pub fn bind(path: impl AsRef<Path>) -> Result<Self, CanError> {
        let path = path.as_ref().to_path_buf();
        let open = |message: String| CanError::Open { bus: path.display().to_string(), message };
        // Another kind of file is never removed.
        if std::fs::symlink_metadata(&path).is_ok_and(|file| file.file_type().is_socket()) {
            if UnixStream::connect(&path).is_ok() {
                return Err(open(
                    "another virtual bus is served there: stop it, or choose another path".to_owned(),
                ));
            }
            std::fs::remove_file(&path).map_err(|error| open(format!("{error}: remove this old socket")))?;
        }
        let hint = "choose a path that does not exist in a folder that you may write";
        let listener = UnixListener::bind(&path)
            .and_then(|listener| listener.set_nonblocking(true).map(|()| listener))
            .map_err(|error| open(format!("{error}: {hint}")))?;
        Ok(Self { listener, clients: Vec::new(), path, off: false })
    }

    /// Accepts new clients, passes on what has arrived, and drops clients that are gone. Never
    /// blocks.
    pub fn poll(&mut self) {
        while self.clients.len() < MAX_CLIENTS {
            let Ok((stream, _)) = self.listener.accept() else { break };
            self.clients.extend(VirtualBusLink::new(stream).ok());
            if let (true, Some(client)) = (self.off, self.clients.last_mut()) {
                client.push(&BusRecord::BusOff(true));
            }
        }
        let mut from = 0;
        let mut records = Vec::new();
        while from < self.clients.len() {
            records.clear();
            let alive = self.clients.get_mut(from).is_some_and(|client| client.read(&mut records));
            // Bus-off comes from the bus alone.
            let alive = alive && records.iter().all(|record| matches!(record, BusRecord::Frame(_)));
            records.retain(|record| matches!(record, BusRecord::Frame(_)) && !self.off);
            for (_, client) in self.clients.iter_mut().enumerate().filter(|(to, _)| *to != from) {
                // A client that does not read loses whole frames.
                records.iter().for_each(|record| _ = client.push(record));
            }
            if alive {
                from += 1;
            } else {
                self.clients.remove(from);
            }
        }
        self.clients.retain_mut(VirtualBusLink::flush);
    }

    /// Puts the bus into bus-off, or ends it. Every client receives an error frame; during bus-off
    /// no frame is passed on.
    pub fn set_off(&mut self, off: bool) {
        if self.off != off {
            self.off = off;
            self.clients.iter_mut().for_each(|client| _ = client.push(&BusRecord::BusOff(off)));
        }
    }

    /// How many clients there are.
    pub fn clients(&self) -> usize {
        self.clients.len()
    }
}

impl Drop for VirtualBus {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}
