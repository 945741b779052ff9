//! From bytes to a song.

use std::collections::BTreeMap;

use midly::{EventIter, MetaMessage, MidiMessage, TrackEventKind};

use super::chunks::{TrackChunk, split};
use super::tempo::{Change, Changes};
use crate::error::MidiError;
use crate::file_limits::{MAX_DURATION_SECS, MAX_FILE_BYTES, MAX_NOTES};
use crate::note::Note;
use crate::song::Song;

/// Channel 10, counting from one: percussion by General MIDI, where a key number names a drum.
const PERCUSSION: u8 = 9;

/// Reads a whole file; see [`Song::from_midi`].
pub(crate) fn read(bytes: &[u8], title: String) -> Result<Song, MidiError> {
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(MidiError(format!(
            "the file has {} bytes, more than the {MAX_FILE_BYTES} that are read; a song is far smaller, so check that \
             this is one",
            bytes.len()
        )));
    }
    let file = split(bytes)?;
    let mut reader = Reader::default();
    for (index, track) in file.tracks.iter().enumerate() {
        reader.track(index + 1, track)?;
    }
    reader.finish(title, file.division)
}

/// A key held down in one channel of one track.
#[derive(Copy, Clone)]
struct Held {
    start: u64,
    velocity: u8,
}

/// A note in ticks; without an end it lasts until the end of the file.
struct TickNote {
    pitch: u8,
    velocity: u8,
    start: u64,
    end: Option<u64>,
}

#[derive(Default)]
struct Reader {
    changes: Changes,
    notes: Vec<TickNote>,
    percussion: usize,
    last_tick: u64,
}

impl Reader {
    fn track(&mut self, number: usize, chunk: &TrackChunk<'_>) -> Result<(), MidiError> {
        let mut held: BTreeMap<(u8, u8), Held> = BTreeMap::new();
        let mut tick = 0u64;
        let mut events = EventIter::new(chunk.body);
        let mut last_was_variable_length = false;
        loop {
            let unread = events.unread();
            let bad = || {
                let offset = chunk.offset + chunk.body.len() - unread.len();
                MidiError(format!(
                    "track {number} is damaged at byte {offset} of the file; copy or export the file again"
                ))
            };
            let event = match events.next() {
                Some(Ok(event)) => event,
                // `midly` ends a track silently at an event that it cannot read, and takes the rest
                // of the track as the text of an event that is too long.
                None if unread.is_empty() && !last_was_variable_length => break,
                Some(Err(_)) | None => return Err(bad()),
            };
            tick = tick.saturating_add(u64::from(event.delta.as_int()));
            last_was_variable_length = !matches!(event.kind, TrackEventKind::Midi { .. });
            match event.kind {
                TrackEventKind::Midi { channel, message } => {
                    let (pitch, velocity) = match message {
                        MidiMessage::NoteOn { key, vel } => (key.as_int(), vel.as_int()),
                        MidiMessage::NoteOff { key, .. } => (key.as_int(), 0),
                        _ => continue,
                    };
                    let channel = channel.as_int();
                    if channel == PERCUSSION {
                        self.percussion += usize::from(velocity > 0);
                        continue;
                    }
                    let before = if velocity > 0 {
                        held.insert((channel, pitch), Held { start: tick, velocity })
                    } else {
                        held.remove(&(channel, pitch))
                    };
                    if let Some(before) = before {
                        self.note(pitch, before, Some(tick))?;
                    }
                }
                TrackEventKind::Meta(MetaMessage::Tempo(micros)) => match micros.as_int() {
                    0 => {
                        return Err(MidiError(format!(
                            "track {number} sets a tempo of zero seconds a beat; correct the tempo and export the song \
                             again"
                        )));
                    }
                    micros => self.changes.push(tick, Change::Tempo(micros))?,
                },
                TrackEventKind::Meta(MetaMessage::TimeSignature(numerator, power, ..)) => {
                    if let Some(signature) = Change::signature(numerator, power) {
                        self.changes.push(tick, signature)?;
                    }
                }
                TrackEventKind::Meta(MetaMessage::EndOfTrack) => break,
                _ => {}
            }
        }
        self.last_tick = self.last_tick.max(tick);
        for ((_, pitch), stroke) in held {
            self.note(pitch, stroke, None)?;
        }
        Ok(())
    }

    fn note(&mut self, pitch: u8, held: Held, end: Option<u64>) -> Result<(), MidiError> {
        if self.notes.len() >= MAX_NOTES {
            return Err(MidiError(format!(
                "the file has more than {MAX_NOTES} notes; cut out the part you want to hear"
            )));
        }
        self.notes.push(TickNote { pitch, velocity: held.velocity, start: held.start, end });
        Ok(())
    }

    fn finish(self, title: String, division: super::chunks::Division) -> Result<Song, MidiError> {
        if self.notes.is_empty() {
            return Err(MidiError(format!(
                "the file has no notes to play{}",
                percussion_hint(self.percussion)
            )));
        }
        let map = self.changes.into_map(division);
        let seconds = |note: &TickNote| Note {
            pitch: note.pitch,
            velocity: note.velocity,
            start_secs: map.secs(note.start),
            end_secs: map.secs(note.end.unwrap_or(self.last_tick)),
        };
        let notes: Vec<Note> = self.notes.iter().map(seconds).collect();
        let secs = notes.iter().map(|note| note.end_secs).fold(0.0, f64::max);
        if secs > MAX_DURATION_SECS {
            return Err(MidiError(format!(
                "the last note ends after {secs:.0} s, more than the limit of {MAX_DURATION_SECS} s; cut out the part you \
                 want to hear"
            )));
        }
        let song = Song::new(title, notes, 0.0).map_err(|error| MidiError(error.to_string()))?;
        Ok(song.with_beats(map.into_beats()))
    }
}

fn percussion_hint(strokes: usize) -> String {
    match strokes {
        0 => "; check that you exported the track with the melody".into(),
        1 => " (1 stroke on the percussion channel is ignored); move the melody to another channel than 10"
            .into(),
        n => format!(
            " ({n} strokes on the percussion channel are ignored); move the melody to another channel than 10"
        ),
    }
}
