//! What carries the bytes of the keyboard: a socket of the emulator, a raw device or serial line,
//! or ALSA.
//!
//! Thin wrappers: no call blocks, and the only decision here is whether the other end is still
//! connected.

use std::{
    fs::{File, OpenOptions},
    io::{self, ErrorKind, IsTerminal, Read},
    os::unix::{
        fs::{FileTypeExt, OpenOptionsExt},
        net::UnixStream,
    },
    time::Duration,
};

use super::source::{MidiError, MidiSource};
use crate::stream::read_available;

/// Opens a keyboard: `alsa:NAME` (part of a port's name), `raw:PATH` (a raw MIDI device, serial
/// line or pty) or `midi:PATH` (the socket of an emulator).
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
    /// Speed of a five-pin MIDI line behind a serial port; a pty ignores it.
    const DIN_BAUD: u32 = 31_250;
    let file = OpenOptions::new().read(true).custom_flags(O_NONBLOCK).open(path)?;
    let kind = file.metadata()?.file_type();
    if !(kind.is_char_device() || kind.is_fifo()) {
        return Err(io::Error::new(ErrorKind::InvalidInput, "it is no device"));
    }
    if !file.is_terminal() {
        // A raw MIDI device drops what comes before it is read for the first time. Reading nothing
        // is enough.
        let _ = (&file).read(&mut [])?;
        return Ok(Box::new(Stream::<File> { spec: spec.to_owned(), reader: file }));
    }
    // A terminal would gather lines and interpret control characters: the serial port turns all of
    // that off.
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
        let lost = |error: io::Error| MidiError::Lost { spec: self.spec.clone(), message: error.to_string() };
        read_available(&mut self.reader, |piece| out.extend_from_slice(piece)).map_err(lost)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

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
    fn a_pty_carries_every_byte_unchanged() {
        let (mut master, slave) = serialport::TTYPort::pair().unwrap();
        let path = serialport::SerialPort::name(&slave).unwrap();
        drop(slave);
        let mut source = open(&format!("raw:{path}")).unwrap();
        let all: Vec<u8> = (0..=255).collect();
        master.write_all(&all).unwrap();
        assert_eq!(read(source.as_mut(), all.len()), all, "control characters, line ends and all");
        drop(master);
        assert!(matches!(source.receive(&mut Vec::new()), Err(MidiError::Lost { .. })));
    }
}
