//! The events of a track, one after the other.
//!
//! As in other players, what says nothing of notes is skipped however odd its values are, and a
//! running status continues after a meta event or a system exclusive one. (`midly` refuses both.)

/// What an event means to a song.
#[derive(Copy, Clone, Debug, PartialEq)]
pub(super) enum Event {
    NoteOn {
        channel: u8,
        pitch: u8,
        velocity: u8,
    },
    NoteOff {
        channel: u8,
        pitch: u8,
    },
    /// Every note of the channel ends.
    AllNotesOff {
        channel: u8,
    },
    /// Length of a quarter note, µs.
    Tempo(u32),
    TimeSignature {
        numerator: u8,
        denominator_power: u8,
    },
    EndOfTrack,
    /// Nothing.
    Other,
}

/// Why an event cannot be read, and the byte of the track at which it begins.
#[derive(Debug, PartialEq)]
pub(super) struct BadEvent {
    pub at: usize,
    pub why: String,
}

/// Reads the events of a track.
pub(super) struct Events<'a> {
    body: &'a [u8],
    at: usize,
    running_status: Option<u8>,
}

const META: u8 = 0xFF;
const TEMPO: u8 = 0x51;
const TIME_SIGNATURE: u8 = 0x58;
const END_OF_TRACK: u8 = 0x2F;
/// Controllers that end all notes: "all sound off", and from "all notes off" to the changes of
/// mode.
const ALL_SOUND_OFF: u8 = 120;
const ALL_NOTES_OFF: u8 = 123;
const MAX_DATA: u8 = 0x7F;

impl<'a> Events<'a> {
    pub fn new(body: &'a [u8]) -> Self {
        Self { body, at: 0, running_status: None }
    }

    /// The bytes that are not yet read.
    pub fn unread(&self) -> &'a [u8] {
        self.body.get(self.at..).unwrap_or_default()
    }

    /// The next event and the ticks before it; none at the end of the body.
    pub fn next(&mut self) -> Option<Result<(u64, Event), BadEvent>> {
        let at = self.at;
        (at < self.body.len()).then(|| self.event().map_err(|why| BadEvent { at, why }))
    }

    fn event(&mut self) -> Result<(u64, Event), String> {
        let ticks = self.number()?;
        let status = match self.unread().first() {
            Some(&status) if status > MAX_DATA => {
                self.at += 1;
                status
            }
            Some(_) => self.running_status.ok_or("a value without a command before it")?,
            None => return Err("the track ends in an event".into()),
        };
        let event = match status {
            META => self.meta()?,
            0xF0 | 0xF7 => {
                self.block()?;
                Event::Other
            }
            // System common and realtime messages belong on a wire, and mean nothing here.
            0xF1 | 0xF3 => self.bytes(1).map(|_| Event::Other)?,
            0xF2 => self.bytes(2).map(|_| Event::Other)?,
            0xF4.. => Event::Other,
            _ => {
                self.running_status = Some(status);
                self.channel_event(status)?
            }
        };
        Ok((ticks, event))
    }

    fn channel_event(&mut self, status: u8) -> Result<Event, String> {
        let channel = status & 0x0F;
        let is_short = matches!(status >> 4, 0xC | 0xD);
        let values = self.bytes(if is_short { 1 } else { 2 })?;
        let (first, second) = (values[0], values.get(1).copied().unwrap_or_default());
        Ok(match status >> 4 {
            0x8 | 0x9 if first > MAX_DATA => {
                return Err(format!("a note of pitch {first}, above {MAX_DATA}"));
            }
            0x9 if second > MAX_DATA => return Err(format!("a note of velocity {second}, above {MAX_DATA}")),
            0x8 => Event::NoteOff { channel, pitch: first },
            0x9 if second == 0 => Event::NoteOff { channel, pitch: first },
            0x9 => Event::NoteOn { channel, pitch: first, velocity: second },
            0xB if first == ALL_SOUND_OFF || (ALL_NOTES_OFF..=MAX_DATA).contains(&first) => {
                Event::AllNotesOff { channel }
            }
            _ => Event::Other,
        })
    }

    fn meta(&mut self) -> Result<Event, String> {
        let kind = self.bytes(1)?[0];
        // The length of the last event may be cut off: it is zero.
        if kind == END_OF_TRACK && self.unread().is_empty() {
            return Ok(Event::EndOfTrack);
        }
        Ok(match (kind, self.block()?) {
            (TEMPO, &[high, middle, low, ..]) => Event::Tempo(u32::from_be_bytes([0, high, middle, low])),
            (TIME_SIGNATURE, &[numerator, denominator_power, ..]) => {
                Event::TimeSignature { numerator, denominator_power }
            }
            (END_OF_TRACK, _) => Event::EndOfTrack,
            _ => Event::Other,
        })
    }

    /// A length, and as many bytes.
    fn block(&mut self) -> Result<&'a [u8], String> {
        let length = self.number()?;
        self.bytes(usize::try_from(length).unwrap_or(usize::MAX))
    }

    fn bytes(&mut self, count: usize) -> Result<&'a [u8], String> {
        let left = self.unread();
        let bytes = left.get(..count).ok_or_else(|| match left.len() {
            0 => "the track ends in an event".to_string(),
            left => format!("an event of {count} bytes where the track has {left}"),
        })?;
        self.at += count;
        Ok(bytes)
    }

    /// A number of seven bits a byte; all but its last byte have the eighth bit.
    fn number(&mut self) -> Result<u64, String> {
        let mut number = 0u64;
        loop {
            let byte = self.bytes(1)?[0];
            number = number << 7 | u64::from(byte & MAX_DATA);
            if byte <= MAX_DATA {
                return Ok(number);
            }
            if number > u64::from(u32::MAX) {
                return Err("a time or a length of more than 32 bits".into());
            }
        }
    }
}
