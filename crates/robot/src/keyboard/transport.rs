//! What carries the bytes of the keyboard: a socket of the emulator, a raw device or serial line, or ALSA.
//!
//! Thin shells: no call blocks, nothing is decided here but whether the other end is still there.

use std::{
    fs::{self, File, OpenOptions},
    io::{self, ErrorKind, IsTerminal, Read, Write},
    os::unix::{
        fs::{FileTypeExt, OpenOptionsExt},
        net::{UnixListener, UnixStream},
    },
    path::{Path, PathBuf},
    time::Duration,
};

/// The keyboard cannot be reached.
#[derive(Debug, thiserror::Error)]
pub enum MidiError {
    /// The specification names no way to a keyboard.
    #[error(
        "`{spec}` names no keyboard; write alsa:NAME (part of a port's name), raw:/dev/snd/midiC1D0 (a raw \
         MIDI device, serial line or pty), or midi:/path/to/socket (an emulator)"
    )]
    Spec {
        /// As given.
        spec: String,
    },
    /// It is not there, or something else uses it.
    #[error("cannot open the keyboard {spec}: {message}")]
    Open {
        /// As given.
        spec: String,
        /// Why, and what to do.
        message: String,
    },
    /// It was there and is gone.
    #[error(
        "the keyboard {spec} is gone ({message}): check its cable, or that its emulator still runs; it \
         is tried again"
    )]
    Gone {
        /// As given.
        spec: String,
        /// How we know.
        message: String,
    },
    /// ALSA was left out of this program.
    #[error(
        "{spec} needs ALSA, which this program was built without: build it again with `--features hardware`"
    )]
    NoAlsa {
        /// As given.
        spec: String,
    },
}

/// Where the bytes of a keyboard come from.
pub trait MidiSource: Send {
    /// Appends the bytes that have come since the last call, at most a few thousand at once. Never blocks.
    ///
    /// # Errors
    /// If the keyboard is gone: drop the source and [`open`] it again. Bytes that came before are appended
    /// still.
    fn receive(&mut self, out: &mut Vec<u8>) -> Result<(), MidiError>;
}

/// Opens a keyboard: `alsa:NAME` (part of a port's name), `raw:PATH` (a raw MIDI device, serial line or pty)
/// or `midi:PATH` (the socket of a [`MidiOutlet`]).
///
/// # Errors
/// If the specification is wrong or nothing is there.
pub fn open(spec: &str) -> Result<Box<dyn MidiSource>, MidiError> {
    let fail = |message: String| MidiError::Open { spec: spec.to_owned(), message };
    match spec.split_once(':') {
        Some(("midi", path)) if !path.is_empty() => {
            let stream = UnixStream::connect(path)
                .and_then(|stream| stream.set_nonblocking(true).map(|()| stream))
                .map_err(|error| fail(format!("{error}; start the emulator that listens there first")))?;
            Ok(Box::new(Stream { spec: spec.to_owned(), reader: stream }))
        }
        Some(("raw", path)) if !path.is_empty() => open_raw(spec, path).map_err(|error| {
            fail(format!(
                "{error}; look for the keyboard with `ls /dev/snd/midi*`, and stop whatever else reads it"
            ))
        }),
        Some(("alsa", name)) => open_alsa(spec, name),
        _ => Err(MidiError::Spec { spec: spec.to_owned() }),
    }
}

#[cfg(all(feature = "hardware", target_os = "linux"))]
fn open_alsa(spec: &str, name: &str) -> Result<Box<dyn MidiSource>, MidiError> {
    Ok(Box::new(super::alsa::AlsaSource::open(spec, name)?))
}

#[cfg(not(all(feature = "hardware", target_os = "linux")))]
fn open_alsa(spec: &str, _name: &str) -> Result<Box<dyn MidiSource>, MidiError> {
    Err(MidiError::NoAlsa { spec: spec.to_owned() })
}

fn open_raw(spec: &str, path: &str) -> io::Result<Box<dyn MidiSource>> {
    /// Opening and reading return at once.
    const O_NONBLOCK: i32 = if cfg!(target_os = "linux") { 0o4000 } else { 0x4 };
    /// Speed of a five-pin MIDI line behind a serial port; a pty has none and does not mind.
    const DIN_BAUD: u32 = 31_250;
    let file = OpenOptions::new().read(true).custom_flags(O_NONBLOCK).open(path)?;
    let kind = file.metadata()?.file_type();
    if !(kind.is_char_device() || kind.is_fifo()) {
        return Err(io::Error::new(ErrorKind::InvalidInput, "it is no device"));
    }
    if !file.is_terminal() {
        // A raw MIDI device drops what comes before it is read for the first time. Reading nothing is enough.
        let _ = (&file).read(&mut [])?;
        return Ok(Box::new(Stream::<File> { spec: spec.to_owned(), reader: file }));
    }
    // A terminal would gather lines and interpret control characters: the serial port turns all of that off.
    drop(file);
    let port = serialport::new(path, DIN_BAUD).timeout(Duration::ZERO).open_native()?;
    Ok(Box::new(Stream { spec: spec.to_owned(), reader: port }))
}

/// Anything that can be read without blocking.
struct Stream<R> {
    spec: String,
    reader: R,
}

impl<R: Read + Send> MidiSource for Stream<R> {
    fn receive(&mut self, out: &mut Vec<u8>) -> Result<(), MidiError> {
        /// One cycle takes in at most so many pieces, so that a babbling device cannot hold it up.
        const MAX_READS: usize = 16;
        let gone = |message: String| MidiError::Gone { spec: self.spec.clone(), message };
        let mut piece = [0; 256];
        for _ in 0..MAX_READS {
            match self.reader.read(&mut piece) {
                Ok(0) => return Err(gone("its other end was closed".to_owned())),
                Ok(count) => out.extend_from_slice(piece.get(..count).unwrap_or_default()),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => break,
                Err(error) => return Err(gone(error.to_string())),
            }
        }
        Ok(())
    }
}

/// The other end of `midi:PATH`: a socket through which an emulator in this process plays to a driver in
/// another.
///
/// One driver at a time: others are turned away while it is there. The socket's file goes when this is
/// dropped.
#[derive(Debug)]
pub struct MidiOutlet {
    path: PathBuf,
    listener: UnixListener,
    driver: Option<UnixStream>,
}

impl MidiOutlet {
    /// Listens at `path`. A socket that a dead emulator left there is replaced, a living one is not.
    ///
    /// # Errors
    /// If the path cannot be used, or another emulator listens there.
    pub fn bind(path: &Path) -> Result<Self, MidiError> {
        let fail = |message: String| MidiError::Open { spec: format!("midi:{}", path.display()), message };
        if UnixStream::connect(path).is_ok() {
            return Err(fail("another emulator listens there; stop it or choose another path".to_owned()));
        }
        if fs::symlink_metadata(path).is_ok_and(|data| data.file_type().is_socket()) {
            fs::remove_file(path).map_err(|error| fail(error.to_string()))?;
        }
        let listener = UnixListener::bind(path)
            .and_then(|listener| listener.set_nonblocking(true).map(|()| listener))
            .map_err(|error| {
                fail(format!("{error}; choose a path in a folder that exists, of at most 100 characters"))
            })?;
        Ok(Self { path: path.to_owned(), listener, driver: None })
    }

    /// Sends bytes to the driver, if there is one: like a real keyboard, it does not care whether anybody
    /// listens. A driver that went away or does not read any more is let go. Never blocks.
    pub fn send(&mut self, bytes: &[u8]) {
        // A driver says nothing: there is something to read only once it has gone.
        let gone = |driver: &mut UnixStream| {
            driver.read(&mut [0]).map_or_else(|error| error.kind() != ErrorKind::WouldBlock, |_| true)
        };
        while let Ok((stream, _)) = self.listener.accept() {
            if self.driver.as_mut().is_none_or(gone) && stream.set_nonblocking(true).is_ok() {
                self.driver = Some(stream);
            }
        }
        if let Some(driver) = &mut self.driver
            && driver.write_all(bytes).is_err()
        {
            self.driver = None;
        }
    }

    /// Pulls the plug: the driver sees its connection end, and may connect again at once.
    pub fn disconnect(&mut self) {
        self.driver = None;
    }

    /// Whether a driver was there at the last [`send`](Self::send).
    pub fn is_connected(&self) -> bool {
        self.driver.is_some()
    }
}

impl Drop for MidiOutlet {
    fn drop(&mut self) {
        // Nobody is left to be told if this fails; the next emulator replaces the file.
        let _ = fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads until something is there; the other end has written already, so this is a matter of a moment.
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

    fn error(spec: &str) -> String {
        open(spec).err().unwrap().to_string()
    }

    #[test]
    fn errors_say_what_to_do() {
        for spec in ["", "Keystation", "midi:", "raw:", "usb:1"] {
            assert!(error(spec).contains("alsa:NAME"), "{spec}");
        }
        assert!(error("midi:/nowhere/at/all").contains("start the emulator"));
        assert!(error("raw:/dev/snd/midiC99D0").contains("ls /dev/snd/midi*"));
        assert!(error("raw:/etc/passwd").contains("it is no device"));
        if cfg!(not(feature = "hardware")) {
            assert!(error("alsa:Keystation").contains("--features hardware"));
        }
    }

    #[test]
    fn a_socket_carries_bytes_until_it_is_closed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys");
        let spec = format!("midi:{}", path.display());
        let mut outlet = MidiOutlet::bind(&path).unwrap();
        outlet.send(&[1]);
        let mut source = open(&spec).unwrap();
        outlet.send(&[0x90, 60, 100]);
        assert!(outlet.is_connected());
        assert_eq!(read(source.as_mut(), 3), [0x90, 60, 100], "what was sent before nobody heard");
        assert!(MidiOutlet::bind(&path).unwrap_err().to_string().contains("another emulator"));

        outlet.send(&[0x80]);
        outlet.disconnect();
        let mut last = Vec::new();
        assert!(matches!(source.receive(&mut last), Err(MidiError::Gone { .. })));
        assert_eq!(last, [0x80], "bytes before the end still count");
        let mut source = open(&spec).unwrap();
        outlet.send(&[7]);
        assert_eq!(read(source.as_mut(), 1), [7], "replugged");
        let mut second = open(&spec).unwrap();
        outlet.send(&[8]);
        assert_eq!(read(source.as_mut(), 1), [8], "the first driver keeps its place");
        assert!(second.receive(&mut last).is_err(), "the second one is turned away");
        drop(outlet);
        assert!(!path.exists());
        assert!(source.receive(&mut last).is_err());
    }

    #[test]
    fn a_dead_socket_is_replaced_and_other_files_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys");
        drop(UnixListener::bind(&path).unwrap());
        assert!(path.exists());
        drop(MidiOutlet::bind(&path).unwrap());
        fs::write(&path, "precious").unwrap();
        assert!(MidiOutlet::bind(&path).is_err());
        assert_eq!(fs::read_to_string(&path).unwrap(), "precious");
    }

    #[test]
    fn a_driver_that_does_not_read_never_blocks_the_emulator() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys");
        let mut outlet = MidiOutlet::bind(&path).unwrap();
        let _source = open(&format!("midi:{}", path.display())).unwrap();
        outlet.send(&vec![0; 1 << 24]);
        assert!(!outlet.is_connected());
    }

    #[test]
    fn a_pty_carries_every_byte_unchanged() {
        let (mut master, slave) = serialport::TTYPort::pair().unwrap();
        let path = serialport::SerialPort::name(&slave).unwrap();
        drop(slave);
        let mut source = open(&format!("raw:{path}")).unwrap();
        let all: Vec<u8> = (0..=255).collect();
        master.write_all(&all).unwrap();
        assert_eq!(read(source.as_mut(), all.len()), all, "control characters, line ends and all");
        drop(master);
        assert!(matches!(source.receive(&mut Vec::new()), Err(MidiError::Gone { .. })));
    }
}
