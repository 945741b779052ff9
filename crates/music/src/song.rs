//! A song: notes in seconds, and the beat grid they were written on.
//!
//! A song is immutable; changing one makes another. Its notes are always sorted, finite, without
//! overlaps of one pitch, and within fixed limits, so that no other code needs to check them.

use etude_checks::{POSITIVE, check_range};

use crate::CONTROL_HZ;
use crate::error::SongError;
use crate::file_limits::{MAX_DURATION_SECS, MAX_NOTES};
use crate::keys::{HIGHEST_PITCH, LOWEST_PITCH, key_of_pitch, pitch_name};
use crate::meter::{BeatGrid, Position};
use crate::note::{Note, chords, without_overlaps};
use crate::range::{OffendingNote, OutOfRange};

const MAX_PITCH: u8 = 127;
/// Largest difference of one note's onset in two MIDI files of a song, s: files count time in
/// ticks.
const ONSET_TOLERANCE_SECS: f64 = 0.01;
pub(crate) const MAX_VELOCITY: u8 = 127;

/// Notes with times in seconds, a title, and bars and beats.
#[derive(Clone, Debug, PartialEq)]
pub struct Song {
    title: String,
    notes: Vec<Note>,
    duration_secs: f64,
    beats: BeatGrid,
}

impl Song {
    /// A song of these notes, in any order. It lasts `duration_secs` or until its last note ends,
    /// whichever is later. Overlapping notes of one pitch are split at each onset; the last of them
    /// ends at the latest end.
    ///
    /// # Errors
    /// If a note has a pitch or velocity that MIDI lacks, or times that are not finite, negative or
    /// reversed; if there are too many notes, or they last too long ([`MAX_NOTES`],
    /// [`MAX_DURATION_SECS`]).
    pub fn new(title: impl Into<String>, notes: Vec<Note>, duration_secs: f64) -> Result<Song, SongError> {
        if notes.len() > MAX_NOTES {
            return Err(SongError::Invalid(format!(
                "{} notes are more than the limit of {MAX_NOTES}; cut out the part you want to hear",
                notes.len()
            )));
        }
        for (index, note) in notes.iter().enumerate() {
            check(note).map_err(|why| {
                SongError::Invalid(format!("note {index} (counting from 0) is not playable: {why}"))
            })?;
        }
        let duration_secs = notes.iter().map(|note| note.end_secs).fold(duration_secs, f64::max);
        check_range("duration_secs", duration_secs, 0.0..=MAX_DURATION_SECS)?;
        let notes = without_overlaps(notes);
        Ok(Song { title: title.into(), notes, duration_secs, beats: BeatGrid::default() })
    }

    /// The same song on this beat grid.
    #[must_use]
    pub fn with_beats(self, beats: BeatGrid) -> Song {
        Song { beats, ..self }
    }

    /// Whether `other` has the same keys at the same times, to the precision of a MIDI file.
    pub fn has_the_notes_of(&self, other: &Song) -> bool {
        self.notes().len() == other.notes().len()
            && self.notes().iter().zip(other.notes()).all(|(one, other)| {
                one.pitch == other.pitch && (one.start_secs - other.start_secs).abs() < ONSET_TOLERANCE_SECS
            })
    }

    /// What the song is called.
    pub fn title(&self) -> &str {
        &self.title
    }

    /// The notes, sorted by start and then pitch. Notes of one pitch never overlap.
    pub fn notes(&self) -> &[Note] {
        &self.notes
    }

    /// Length in seconds.
    pub fn duration_secs(&self) -> f64 {
        self.duration_secs
    }

    /// The beat grid.
    pub fn beats(&self) -> &BeatGrid {
        &self.beats
    }

    /// Bar and beat at this many seconds.
    pub fn position(&self, secs: f64) -> Position {
        self.beats.position(secs)
    }

    /// The song slower (`factor` above 1) or faster (below 1).
    ///
    /// # Errors
    /// If the factor is not a positive number, or the song becomes longer than
    /// [`MAX_DURATION_SECS`].
    pub fn stretch(&self, factor: f64) -> Result<Song, SongError> {
        check_range("the stretch factor", factor, POSITIVE)?;
        let scale = |note: &Note| Note {
            start_secs: note.start_secs * factor,
            end_secs: note.end_secs * factor,
            ..*note
        };
        let notes = self.notes.iter().map(scale).collect();
        Ok(Song::new(self.title.clone(), notes, self.duration_secs * factor)?
            .with_beats(self.beats.scaled(factor)))
    }

    /// The song higher (positive) or lower (negative). Unlike RoboPianist it drops no notes: what
    /// no longer fits the keyboard is reported by [`Song::check_range`].
    ///
    /// # Errors
    /// If a note leaves the pitches that MIDI has.
    pub fn transpose(&self, semitones: i32) -> Result<Song, SongError> {
        let mut song = self.clone();
        for note in &mut song.notes {
            note.pitch = i32::from(note.pitch)
                .checked_add(semitones)
                .and_then(|pitch| u8::try_from(pitch).ok())
                .filter(|&pitch| pitch <= MAX_PITCH)
                .ok_or_else(|| {
                    let (name, pitch) = (pitch_name(note.pitch), note.pitch);
                    SongError::Invalid(format!(
                        "transposing by {semitones} semitones takes {name} (MIDI {pitch}) off the MIDI scale; transpose \
                         by less"
                    ))
                })?;
        }
        Ok(song)
    }

    /// The upper voice alone: of the notes that begin together the highest, unless a higher one
    /// still sounds. A note that ends within a control step from then is legato and does not count.
    #[must_use]
    pub fn upper_voice(&self) -> Song {
        let mut sounding: Vec<Note> = Vec::new();
        let mut notes = Vec::new();
        for chord in chords(&self.notes) {
            let start = chord[0].start_secs;
            sounding.retain(|note| note.end_secs - start > 1.0 / CONTROL_HZ);
            let held = sounding.iter().map(|note| note.pitch).max().unwrap_or(0);
            notes.extend(chord.iter().max_by_key(|note| note.pitch).filter(|note| note.pitch > held));
            sounding.extend(chord);
        }
        Song { notes, ..self.clone() }
    }

    /// Checks that every note is on the keyboard.
    ///
    /// # Errors
    /// [`SongError::OutOfRange`] with every note outside it and every transposition with which all
    /// notes fit.
    pub fn check_range(&self) -> Result<(), SongError> {
        let notes: Vec<OffendingNote> = self
            .notes
            .iter()
            .filter(|note| key_of_pitch(note.pitch).is_none())
            .map(|note| OffendingNote { note: *note, position: self.position(note.start_secs) })
            .collect();
        if notes.is_empty() {
            return Ok(());
        }
        let pitches = || self.notes.iter().map(|note| i32::from(note.pitch));
        let (lowest, highest) = (pitches().min().unwrap_or(0), pitches().max().unwrap_or(0));
        let transpositions =
            (i32::from(LOWEST_PITCH) - lowest..=i32::from(HIGHEST_PITCH) - highest).collect();
        Err(OutOfRange { title: self.title().to_owned(), notes, transpositions }.into())
    }

    /// The song from its first note on.
    #[must_use]
    pub fn without_initial_silence(&self) -> Song {
        let secs = self.notes.first().map_or(0.0, |first| first.start_secs);
        let notes = self.notes.iter().map(|note| shifted(note, -secs)).collect();
        let (duration_secs, beats) = (self.duration_secs - secs, self.beats.after_secs(secs));
        Song { notes, duration_secs, beats, title: self.title.clone() }
    }

    /// The song without the notes that the keyboard does not have.
    #[must_use]
    pub fn within_range(&self) -> Song {
        let mut song = self.clone();
        song.notes.retain(|note| key_of_pitch(note.pitch).is_some());
        song
    }

    /// The song with this many seconds of silence in front, which are bar zero.
    ///
    /// # Errors
    /// If the silence is negative or not finite, or the song becomes longer than
    /// [`MAX_DURATION_SECS`].
    pub fn with_initial_silence(&self, secs: f64) -> Result<Song, SongError> {
        let duration_secs = self.duration_secs + secs;
        check_range("initial_silence_secs", secs, 0.0..)?;
        check_range("duration_secs", duration_secs, ..=MAX_DURATION_SECS)?;
        let notes = self.notes.iter().map(|note| shifted(note, secs)).collect();
        Ok(Song { notes, duration_secs, beats: self.beats.delayed(secs), title: self.title.clone() })
    }
}

fn shifted(note: &Note, secs: f64) -> Note {
    Note { start_secs: note.start_secs + secs, end_secs: note.end_secs + secs, ..*note }
}

fn check(note: &Note) -> Result<(), &'static str> {
    if note.pitch > MAX_PITCH {
        return Err("its pitch is above 127, the highest that MIDI has");
    }
    if note.velocity == 0 || note.velocity > MAX_VELOCITY {
        return Err("its velocity must be from 1 to 127");
    }
    if !(note.start_secs >= 0.0 && note.end_secs >= note.start_secs && note.end_secs.is_finite()) {
        return Err("its times must be finite, not negative, and the end not before the start");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::repertoire;

    fn note(pitch: u8, start_secs: f64, end_secs: f64) -> Note {
        Note { pitch, velocity: 64, start_secs, end_secs }
    }

    #[test]
    fn impossible_notes_are_refused() {
        let bad = [
            note(128, 0.0, 1.0),
            note(60, -1.0, 1.0),
            note(60, 1.0, 0.5),
            note(60, 0.0, f64::NAN),
            note(60, f64::NAN, 1.0),
            note(60, 0.0, f64::INFINITY),
            Note { velocity: 0, ..note(60, 0.0, 1.0) },
        ];
        for one in bad {
            let refused = Song::new("", vec![note(60, 0.0, 1.0), one], 0.0).unwrap_err();
            assert!(refused.to_string().starts_with("note 1 "), "{one:?}: {refused}");
        }
        assert!(Song::new("", vec![note(60, 0.0, 1e5)], 0.0).is_err());
        assert!(Song::new("", vec![], -1.0).is_err());
        assert!(Song::new("", vec![], f64::NAN).is_err());
    }

    #[test]
    fn the_upper_voice_is_what_is_highest_when_it_begins() {
        let note = |pitch, start_secs, end_secs| Note { pitch, velocity: 64, start_secs, end_secs };
        let bass = note(48, 0.0, 4.0);
        let high = [note(72, 0.0, 1.02), note(71, 1.0, 2.0), note(76, 2.0, 4.0)];
        let below = [note(64, 0.0, 1.0), note(74, 3.0, 3.5), note(60, 3.96, 4.5)];
        let song = Song::new("", [[bass].as_slice(), &high, &below].concat(), 0.0).unwrap();
        // The last note begins when the one above it ends: legato.
        assert_eq!(song.upper_voice().notes(), [high.as_slice(), &below[2..]].concat());
        assert_eq!(song.upper_voice().duration_secs(), song.duration_secs());
    }

    #[test]
    fn changes_move_notes_and_bars_together() {
        let song = repertoire::get("happy-birthday").unwrap();
        let late = song.with_initial_silence(2.5).unwrap();
        assert_eq!(late.position(3.5), song.position(1.0));
        let starts = late
            .notes()
            .iter()
            .zip(song.notes())
            .all(|(late, note)| late.start_secs == note.start_secs + 2.5);
        assert!(starts && late.duration_secs() == song.duration_secs() + 2.5);
        let slow = song.stretch(2.0).unwrap();
        assert_eq!(slow.position(8.0), song.position(4.0));
        assert_eq!(slow.duration_secs(), 48.0);
        let high = song.transpose(12).unwrap();
        assert_eq!(high.notes()[0].pitch, song.notes()[0].pitch + 12);
        assert_eq!(high.transpose(-12).unwrap(), song);
    }

    #[test]
    fn impossible_changes_are_refused() {
        let song = repertoire::get("twinkle").unwrap();
        for factor in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e9] {
            assert!(song.stretch(factor).is_err(), "{factor}");
        }
        for semitones in [100, -100, i32::MAX, i32::MIN] {
            assert!(song.transpose(semitones).is_err(), "{semitones}");
        }
        for secs in [-1.0, f64::NAN, f64::INFINITY, 4000.0] {
            assert!(song.with_initial_silence(secs).is_err(), "{secs}");
        }
    }
}
