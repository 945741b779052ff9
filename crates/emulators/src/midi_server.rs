//! A socket (`midi:PATH`) on which an emulated keyboard sends to a driver in another process.

use std::fs;
use std::io::{ErrorKind, Read as _, Write as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

use etude_robot::keyboard::MidiError;

use crate::socket::bind_socket;

/// Serves one driver at a time; others are refused while it is connected. Removes the socket's file
/// when dropped.
#[derive(Debug)]
pub struct MidiServer {
    path: PathBuf,
    listener: UnixListener,
    driver: Option<UnixStream>,
}

impl MidiServer {
    /// Listens at `path`. A socket left there by an emulator that has ended is replaced; one that
    /// is served is not.
    ///
    /// # Errors
    /// If the path cannot be used, or another emulator listens there.
    pub fn bind(path: &Path) -> Result<Self, MidiError> {
        let fail = |message: String| MidiError::Open { spec: format!("midi:{}", path.display()), message };
        let listener = bind_socket(path).map_err(fail)?;
        Ok(Self { path: path.to_owned(), listener, driver: None })
    }

    /// Sends bytes to the driver, if there is one: as with a real keyboard, nothing depends on
    /// whether a driver is connected. A driver that is gone or does not read is disconnected. Never
    /// blocks.
    pub fn send(&mut self, bytes: &[u8]) {
        // A driver sends nothing: a read succeeds only after it has closed the socket.
        let is_lost = |driver: &mut UnixStream| {
            driver.read(&mut [0]).map_or_else(|error| error.kind() != ErrorKind::WouldBlock, |_| true)
        };
        while let Ok((stream, _)) = self.listener.accept() {
            if self.driver.as_mut().is_none_or(is_lost) && stream.set_nonblocking(true).is_ok() {
                self.driver = Some(stream);
            }
        }
        if let Some(driver) = &mut self.driver
            && driver.write_all(bytes).is_err()
        {
            self.driver = None;
        }
    }

    /// Unplugs the keyboard: the driver's connection ends, and it may connect again.
    pub fn disconnect(&mut self) {
        self.driver = None;
    }
}

impl Drop for MidiServer {
    fn drop(&mut self) {
        // If this fails, the next emulator replaces the file.
        let _ = fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use etude_robot::keyboard::{MidiPort, MidiSource, open};

    use super::*;

    /// Reads until something is there; the other end has written already, so this is a matter of a
    /// moment.
    fn read(source: &mut dyn MidiSource, count: usize) -> Vec<u8> {
        let mut bytes = Vec::new();
        for _ in 0..2000 {
            source.receive(&mut bytes).unwrap();
            if bytes.len() >= count {
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        bytes
    }

    #[test]
    fn a_socket_carries_bytes_until_it_is_closed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys");
        let spec = format!("midi:{}", path.display());
        let mut server = MidiServer::bind(&path).unwrap();
        server.send(&[1]);
        let mut source = open(&spec).unwrap();
        server.send(&[0x90, 60, 100]);
        assert!(server.driver.is_some());
        assert_eq!(read(source.as_mut(), 3), [0x90, 60, 100], "what was sent before nobody heard");
        assert!(MidiServer::bind(&path).unwrap_err().to_string().contains("another emulator"));

        server.send(&[0x80]);
        server.disconnect();
        let mut last = Vec::new();
        assert!(matches!(source.receive(&mut last), Err(MidiError::Lost { .. })));
        assert_eq!(last, [0x80], "bytes before the end still count");
        let mut source = open(&spec).unwrap();
        server.send(&[7]);
        assert_eq!(read(source.as_mut(), 1), [7], "replugged");
        let mut second = open(&spec).unwrap();
        server.send(&[8]);
        assert_eq!(read(source.as_mut(), 1), [8], "the first driver keeps its place");
        assert!(second.receive(&mut last).is_err(), "the second one is turned away");
        drop(server);
        assert!(!path.exists());
        assert!(source.receive(&mut last).is_err());
    }

    #[test]
    fn a_dead_socket_is_replaced_and_other_files_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys");
        drop(UnixListener::bind(&path).unwrap());
        assert!(path.exists());
        drop(MidiServer::bind(&path).unwrap());
        fs::write(&path, "precious").unwrap();
        assert!(MidiServer::bind(&path).is_err());
        assert_eq!(fs::read_to_string(&path).unwrap(), "precious");
    }

    #[test]
    fn a_driver_that_does_not_read_never_blocks_the_emulator() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys");
        let mut server = MidiServer::bind(&path).unwrap();
        let _source = open(&format!("midi:{}", path.display())).unwrap();
        server.send(&vec![0; 1 << 24]);
        assert!(server.driver.is_none());
    }

    #[test]
    fn an_unplugged_keyboard_is_opened_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys");
        let spec = format!("midi:{}", path.display());
        assert!(MidiPort::open(&spec).is_err(), "it must be there");
        let mut port = MidiPort::new(&spec);
        let mut bytes = Vec::new();
        let secs = Duration::from_secs_f64;
        let nobody = port.receive(secs(0.0), &mut bytes).unwrap_err().to_string();
        assert!(nobody.contains("start the emulator"), "{nobody}");
        let mut server = MidiServer::bind(&path).unwrap();
        let waits = port.receive(secs(0.9), &mut bytes).unwrap_err().to_string();
        assert!(waits.contains("not found again yet"), "{waits}");
        port.receive(secs(1.0), &mut bytes).unwrap();
        server.send(&[0x90, 36, 100]);
        port.receive(secs(1.1), &mut bytes).unwrap();
        assert_eq!(bytes, [0x90, 36, 100]);

        server.send(&[0xFE]);
        server.disconnect();
        assert!(port.receive(secs(1.2), &mut bytes).is_err());
        assert_eq!(bytes.last(), Some(&0xFE), "what came before the end");
        assert!(port.receive(secs(2.1), &mut bytes).is_err());
        port.receive(secs(2.2), &mut bytes).unwrap();
    }
}
