//! Bytes to key events: a streaming MIDI parser that recovers from any damage of the stream.
//!
//! Source of the byte layouts: the MIDI 1.0 specification.

/// The events that are used; all others are skipped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MidiEvent {
    /// A key went down.
    NoteOn {
        /// 0 to 15.
        channel: u8,
        /// MIDI number, 0 to 127.
        note: u8,
        /// 1 to 127.
        velocity: u8,
    },
    /// A key came up; a note-on of velocity 0 says the same as a note-off.
    NoteOff {
        /// 0 to 15.
        channel: u8,
        /// MIDI number, 0 to 127.
        note: u8,
    },
    /// Active sensing: after the first of these, silence means that the link is gone.
    ActiveSensing,
}

/// What the data bytes that come next belong to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Expecting {
    /// Nothing was begun: a data byte now is damage.
    #[default]
    Status,
    /// Messages of this channel status, which stays in force (running status).
    Channel { status: u8 },
    /// Number of data bytes left of a system message that is not used.
    System { remaining: u8 },
    /// Data up to the end mark, of any length.
    Exclusive,
}

/// Takes the bytes of one MIDI stream, one at a time.
///
/// It counts damage in the stream and continues at the next status byte.
#[derive(Clone, Debug, Default)]
pub struct MidiParser {
    expecting: Expecting,
    /// First data byte of a channel message of two.
    first: Option<u8>,
    damaged: u64,
}

impl MidiParser {
    /// A parser at the start of a stream, or wherever it is joined: it waits for the first status
    /// byte.
    pub fn new() -> Self {
        Self::default()
    }

    /// Number of damaged parts of the stream so far: data bytes without a status, ends of nothing,
    /// and incomplete messages.
    ///
    /// A stream that is joined in the middle of a message counts the rest of that message too.
    pub fn damaged(&self) -> u64 {
        self.damaged
    }

    /// Forgets a message that was begun and the status in force, as after a reconnect; keeps the
    /// count of the damage.
    pub fn restart(&mut self) {
        (self.expecting, self.first) = (Expecting::Status, None);
    }

    /// The next byte of the stream; what it completes, if anything.
    pub fn push(&mut self, byte: u8) -> Option<MidiEvent> {
        match byte {
            0x00..=0x7F => self.data(byte),
            // Real time: allowed between any two bytes, disturbs nothing.
            0xFE => Some(MidiEvent::ActiveSensing),
            0xF8..=0xFF => None,
            0x80..=0xEF => {
                self.begin(Expecting::Channel { status: byte });
                None
            }
            0xF7 if self.expecting == Expecting::Exclusive => {
                self.restart();
                None
            }
            0xF0..=0xF7 => {
                self.begin(match byte {
                    0xF0 => Expecting::Exclusive,
                    0xF1 | 0xF3 => Expecting::System { remaining: 1 },
                    0xF2 => Expecting::System { remaining: 2 },
                    _ => Expecting::Status,
                });
                // The end of a system exclusive message that never began.
                self.damaged += u64::from(byte == 0xF7);
                None
            }
        }
    }

    /// A status byte: a message that was begun is incomplete.
    fn begin(&mut self, next: Expecting) {
        // Any status byte may end a system exclusive message: that is no damage.
        let cut_short = self.first.is_some() || matches!(self.expecting, Expecting::System { .. });
        self.damaged += u64::from(cut_short);
        (self.expecting, self.first) = (next, None);
    }

    fn data(&mut self, byte: u8) -> Option<MidiEvent> {
        match self.expecting {
            Expecting::Exclusive => None,
            Expecting::Status => {
                self.damaged += 1;
                None
            }
            Expecting::System { remaining } => {
                self.expecting = match remaining.saturating_sub(1) {
                    0 => Expecting::Status,
                    remaining => Expecting::System { remaining },
                };
                None
            }
            Expecting::Channel { status } => self.channel_data(status, byte),
        }
    }

    fn channel_data(&mut self, status: u8, byte: u8) -> Option<MidiEvent> {
        // Program change and channel pressure have one data byte: complete, and not used.
        if matches!(status >> 4, 0xC | 0xD) {
            return None;
        }
        let Some(note) = self.first.take() else {
            self.first = Some(byte);
            return None;
        };
        let channel = status & 0x0F;
        match (status >> 4, byte) {
            (0x8, _) | (0x9, 0) => Some(MidiEvent::NoteOff { channel, note }),
            (0x9, velocity) => Some(MidiEvent::NoteOn { channel, note, velocity }),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(bytes: &[u8]) -> (Vec<MidiEvent>, u64) {
        let mut parser = MidiParser::new();
        let events = bytes.iter().filter_map(|&byte| parser.push(byte)).collect();
        (events, parser.damaged())
    }

    const fn on(note: u8, velocity: u8) -> MidiEvent {
        MidiEvent::NoteOn { channel: 0, note, velocity }
    }

    const fn off(note: u8) -> MidiEvent {
        MidiEvent::NoteOff { channel: 0, note }
    }

    #[test]
    fn both_codings_of_a_release() {
        assert_eq!(parse(&[0x90, 0x3C, 0x64, 0x80, 0x3C, 0x40]), (vec![on(60, 100), off(60)], 0));
        assert_eq!(parse(&[0x90, 0x3C, 0x64, 0x90, 0x3C, 0x00]), (vec![on(60, 100), off(60)], 0));
    }

    #[test]
    fn running_status() {
        assert_eq!(
            parse(&[0x90, 60, 1, 62, 2, 60, 0, 62, 0]),
            (vec![on(60, 1), on(62, 2), off(60), off(62)], 0)
        );
    }

    #[test]
    fn the_channel_is_kept() {
        assert_eq!(parse(&[0x9F, 0, 127]).0, [MidiEvent::NoteOn { channel: 15, note: 0, velocity: 127 }]);
    }

    #[test]
    fn real_time_between_any_two_bytes() {
        let bytes = [0xF8, 0x90, 0xFE, 60, 0xFA, 1, 0xFD, 62, 0xFF, 2];
        assert_eq!(parse(&bytes), (vec![MidiEvent::ActiveSensing, on(60, 1), on(62, 2)], 0));
    }

    #[test]
    fn system_messages_are_skipped_and_end_the_running_status() {
        for system in [&[0xF0, 1, 2, 0xF8, 3, 0xF7][..], &[0xF1, 9], &[0xF2, 9, 9], &[0xF3, 9], &[0xF6]] {
            let bytes = [&[0x90, 60, 1], system, &[62, 2]].concat();
            assert_eq!(parse(&bytes), (vec![on(60, 1)], 2), "{system:02X?}");
        }
    }

    #[test]
    fn other_channel_messages_are_skipped_with_their_data() {
        for other in
            [&[0xA0, 1, 2][..], &[0xB0, 123, 0], &[0xC0, 5], &[0xD0, 5], &[0xE0, 0, 64], &[0xC0, 5, 6, 7]]
        {
            let bytes = [other, &[0x90, 60, 1]].concat();
            assert_eq!(parse(&bytes), (vec![on(60, 1)], 0), "{other:02X?}");
        }
    }

    #[test]
    fn damage_is_counted_once_for_each_piece() {
        assert_eq!(parse(&[1, 2, 3]), (vec![], 3), "data without a status");
        assert_eq!(parse(&[0x90, 60, 0x80, 60, 0]), (vec![off(60)], 1), "an incomplete message");
        assert_eq!(parse(&[0xF7]), (vec![], 1), "an end of nothing");
        assert_eq!(parse(&[0xF2, 1, 0x90, 60, 1]), (vec![on(60, 1)], 1), "an incomplete system message");
        assert_eq!(parse(&[0xF0, 1, 0x90, 60, 1]), (vec![on(60, 1)], 0), "any status may end an exclusive");
    }

    #[test]
    fn a_restart_waits_for_a_status() {
        let mut parser = MidiParser::new();
        assert_eq!((parser.push(0x90), parser.push(60)), (None, None));
        parser.restart();
        assert_eq!((parser.push(100), parser.damaged()), (None, 1));
    }
}
