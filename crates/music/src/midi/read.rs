//! From bytes to a song.

use std::collections::BTreeMap;

use super::MidiFile;
use super::chunks::{Division, TrackChunk, split};
use super::events::{BadEvent, Event, Events};
use super::remark::Remark;
use super::tempo::{Change, Changes};
use crate::error::MidiError;
use crate::file_limits::{MAX_DURATION_SECS, MAX_FILE_BYTES, MAX_NOTES};
use crate::note::Note;
use crate::song::Song;

/// Channel 10, counting from one: percussion by General MIDI, where a key number names a drum.
const PERCUSSION: u8 = 9;

/// Shorter silence before the first note is nothing to be remarked on, s.
const MIN_SILENCE_SECS: f64 = 1.0;

/// Reads a whole file; see [`MidiFile::read`].
pub(super) fn read(bytes: &[u8], title: String) -> Result<MidiFile, MidiError> {
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(MidiError(format!(
            "the file has {} bytes, more than the {MAX_FILE_BYTES} that are read; a song is far smaller, so check that \
             this is one",
            bytes.len()
        )));
    }
    let file = split(bytes)?;
    let mut reader = Reader { remarks: file.remarks, ..Reader::default() };
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
    /// It was struck while it was held, and the release of the stroke before is still to come.
    owes_release: bool,
    /// A release in its own tick was taken for that of the stroke before.
    has_paid: bool,
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
    ended_by_all_notes_off: usize,
    last_tick: u64,
    remarks: Vec<Remark>,
}

/// Keys held in a track, by channel and pitch.
type HeldKeys = BTreeMap<(u8, u8), Held>;

impl Reader {
    fn track(&mut self, number: usize, chunk: &TrackChunk<'_>) -> Result<(), MidiError> {
        let mut held = HeldKeys::new();
        let mut tick = 0u64;
        let mut events = Events::new(chunk.body);
        while let Some(event) = events.next() {
            let (ticks, event) = event.map_err(|BadEvent { at, why }| {
                MidiError(format!(
                    "track {number} is damaged at byte {} of the file ({why}); copy or export the file again",
                    chunk.offset + at
                ))
            })?;
            tick = tick.saturating_add(ticks);
            if event == Event::EndOfTrack {
                let strokes = strokes(events);
                if strokes > 0 {
                    self.remarks.push(Remark::AfterEndOfTrack { track: number, strokes });
                }
                break;
            }
            self.event(number, tick, event, &mut held)?;
        }
        self.last_tick = self.last_tick.max(tick);
        for ((_, pitch), stroke) in held {
            // Without another release, that one was its own.
            self.note(pitch, stroke, stroke.has_paid.then_some(stroke.start))?;
        }
        Ok(())
    }

    fn event(
        &mut self,
        number: usize,
        tick: u64,
        event: Event,
        held: &mut HeldKeys,
    ) -> Result<(), MidiError> {
        match event {
            Event::NoteOn { channel: PERCUSSION, .. } => self.percussion += 1,
            Event::NoteOn { channel, pitch, velocity } => {
                let before = held.remove(&(channel, pitch));
                let new = Held { start: tick, velocity, owes_release: before.is_some(), has_paid: false };
                held.insert((channel, pitch), new);
                if let Some(before) = before {
                    self.note(pitch, before, Some(tick))?;
                }
            }
            Event::NoteOff { channel, pitch } => {
                // The release of the stroke before, which the new stroke has ended.
                let is_of_before = |held: &&mut Held| held.owes_release && held.start == tick;
                if let Some(held) = held.get_mut(&(channel, pitch)).filter(is_of_before) {
                    (held.owes_release, held.has_paid) = (false, true);
                } else if let Some(before) = held.remove(&(channel, pitch)) {
                    self.note(pitch, before, Some(tick))?;
                }
            }
            Event::AllNotesOff { channel } => {
                for ((_, pitch), before) in held.extract_if(.., |(of, _), _| *of == channel) {
                    self.ended_by_all_notes_off += 1;
                    self.note(pitch, before, Some(tick))?;
                }
            }
            Event::Tempo(0) => {
                return Err(MidiError(format!(
                    "track {number} sets a tempo of zero seconds a beat; correct the tempo and export the song \
                     again"
                )));
            }
            Event::Tempo(micros) => self.changes.push(tick, Change::Tempo(micros))?,
            Event::TimeSignature { numerator, denominator_power } => {
                if let Some(signature) = Change::signature(numerator, denominator_power) {
                    self.changes.push(tick, signature)?;
                }
            }
            Event::EndOfTrack | Event::Other => {}
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

    fn finish(mut self, title: String, division: Division) -> Result<MidiFile, MidiError> {
        if self.notes.is_empty() {
            return Err(MidiError(format!(
                "the file has no notes to play{}",
                percussion_hint(self.percussion)
            )));
        }
        let map = std::mem::take(&mut self.changes).into_map(division);
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
        self.remark(&notes);
        let song = Song::new(title, notes, 0.0).map_err(|error| MidiError(error.to_string()))?;
        Ok(MidiFile { song: song.with_beats(map.into_beats()), remarks: self.remarks })
    }

    /// Remarks on the notes, which are `notes` in seconds.
    fn remark(&mut self, notes: &[Note]) {
        let earliest = |one: &&Note, other: &&Note| one.start_secs.total_cmp(&other.start_secs);
        let in_pairs = || self.notes.iter().zip(notes);
        let unreleased = || in_pairs().filter(|(ticks, _)| ticks.end.is_none()).map(|(_, note)| note);
        if let Some(first) = unreleased().min_by(earliest) {
            let &Note { pitch, start_secs, end_secs, .. } = first;
            let notes = unreleased().count();
            self.remarks.push(Remark::NeverReleased { notes, pitch, start_secs, end_secs });
        }
        if self.percussion > 0 {
            self.remarks.push(Remark::Percussion { strokes: self.percussion });
        }
        if self.ended_by_all_notes_off > 0 {
            self.remarks.push(Remark::AllNotesOff { notes: self.ended_by_all_notes_off });
        }
        let secs = notes.iter().min_by(earliest).map_or(0.0, |first| first.start_secs);
        if secs >= MIN_SILENCE_SECS {
            self.remarks.push(Remark::Silence { secs });
        }
    }
}

/// Strokes among the events that are left, as far as they can be read.
fn strokes(mut events: Events<'_>) -> usize {
    let left = std::iter::from_fn(|| events.next()?.ok());
    left.filter(|(_, event)| matches!(event, Event::NoteOn { .. })).count()
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
