//! Where the bytes of a keyboard come from, and what can go wrong there.

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
    /// It is not connected, or another program uses it.
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
    Lost {
        /// As given.
        spec: String,
        /// How this was noticed.
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
    /// Appends the bytes that have come since the last call, at most a few thousand at once. Never
    /// blocks.
    ///
    /// # Errors
    /// If the keyboard is gone: drop the source and [`open`](super::open) it again. Bytes that came
    /// before are appended still.
    fn receive(&mut self, out: &mut Vec<u8>) -> Result<(), MidiError>;
}
