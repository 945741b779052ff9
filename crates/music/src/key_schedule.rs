//! The key schedule: which keys are due in each control step.
//!
//! A score gives the end of a repeated note as the beginning of the next one. A key has to be up
//! before it can be struck again, so a player leaves it earlier. RoboPianist's frames instead begin
//! the next note one frame late ([`Song::frames`]): a player who follows them exactly is 50 ms late
//! on every repeated note.

use etude_checks::check_range;
use serde::{Deserialize, Serialize};

use crate::CONTROL_HZ;
use crate::error::SongError;
use crate::frames::{FRAME_TOLERANCE, ceil_frame};
use crate::keys::{KeySet, pitch_name};
use crate::note::Note;
use crate::song::Song;

/// Longest time that a key may be asked to be up before it is struck again, s.
const MAX_RESTRIKE_SECS: f64 = 1.0;
/// Longest time by which a player may be early, s.
pub const MAX_LATENCY_COMPENSATION_SECS: f64 = 0.25;

/// How the notes of a score become keys that are due.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum KeyScheduleRule {
    /// [`Song::frames`]: a note covers every frame that it touches; where a key is struck again,
    /// the later note begins a frame late.
    #[default]
    Robopianist,
    /// A note begins and ends at the nearest frames; where a key is struck again, the earlier note
    /// ends [`KeyScheduleConfig::restrike_secs`] before the later one.
    Articulated,
}

/// How a song becomes a [`KeySchedule`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct KeyScheduleConfig {
    /// From notes to keys.
    pub rule: KeyScheduleRule,
    /// How long a key is up before it is struck again, s: for [`KeyScheduleRule::Articulated`].
    pub restrike_secs: f64,
    /// How much earlier than written the player starts to play, s. A key that is due in a control
    /// step may go down at any time in it, half a step after its beginning on average; with half a
    /// step here notes are on time on average. RoboPianist has 0.
    pub latency_compensation_secs: f64,
}

impl Default for KeyScheduleConfig {
    fn default() -> Self {
        Self { rule: KeyScheduleRule::default(), restrike_secs: 0.1, latency_compensation_secs: 0.0 }
    }
}

/// What is due, at [`CONTROL_HZ`]. Time zero is the beginning of the first frame.
#[derive(Clone, Debug, PartialEq)]
pub struct KeySchedule {
    /// The notes to be heard. Their onsets are those of the score, after the initial silence and
    /// latency compensation.
    pub song: Song,
    /// The keys that are due in each frame.
    pub frames: Vec<KeySet>,
    /// Those that are due by RoboPianist's rule, by which the paper's F1 counts.
    pub robopianist_frames: Vec<KeySet>,
    /// Time by which the notes are later than the keys that are due, s.
    pub latency_compensation_secs: f64,
}

impl KeyScheduleConfig {
    /// The key schedule of a song after this much silence, which is rounded to whole frames.
    ///
    /// With [`KeyScheduleRule::Articulated`], a note keeps at least half of the frames until its
    /// key is struck again; [`KeyScheduleConfig::quick_repeats`] lists where the rest is shorter
    /// for that reason.
    ///
    /// # Errors
    /// As [`Song::episode_frames`]; also if a number is out of its range.
    pub fn schedule(&self, song: &Song, initial_silence_secs: f64) -> Result<KeySchedule, SongError> {
        self.check()?;
        let silence_secs = (initial_silence_secs * CONTROL_HZ).round() / CONTROL_HZ;
        let with_notes = |notes| Song::new(song.title(), notes, song.duration_secs());
        let (sounding, in_frames) = match self.rule {
            KeyScheduleRule::Robopianist => (song.clone(), song.clone()),
            KeyScheduleRule::Articulated => {
                let (sounding, in_frames) = self.articulated(song.notes());
                (with_notes(sounding)?.with_beats(song.beats().clone()), with_notes(in_frames)?)
            }
        };
        Ok(KeySchedule {
            song: sounding.with_initial_silence(silence_secs + self.latency_compensation_secs)?,
            frames: in_frames.episode_frames(CONTROL_HZ, silence_secs)?,
            robopianist_frames: song.episode_frames(CONTROL_HZ, silence_secs)?,
            latency_compensation_secs: self.latency_compensation_secs,
        })
    }

    /// The notes with their ends as they should be heard, and the same on the grid of frames.
    fn articulated(&self, notes: &[Note]) -> (Vec<Note>, Vec<Note>) {
        let mut sounding = notes.to_vec();
        let mut in_frames: Vec<Note> = notes.iter().map(in_whole_frames).collect();
        let rest = self.rest_frames();
        for repeat in repeats(notes) {
            let end_secs = (repeat.first + repeat.sounding(rest)) as f64 / CONTROL_HZ;
            for note in [&mut sounding[repeat.note], &mut in_frames[repeat.note]] {
                note.end_secs = note.end_secs.min(end_secs).max(note.start_secs);
            }
        }
        (sounding, in_frames)
    }

    /// The repeated notes that come too soon for the whole rest, in order of time, a line each;
    /// none with [`KeyScheduleRule::Robopianist`].
    pub fn quick_repeats(&self, song: &Song) -> Vec<String> {
        if self.rule == KeyScheduleRule::Robopianist {
            return Vec::new();
        }
        let notes = song.notes();
        let (_, in_frames) = self.articulated(notes);
        let end_frame = |repeat: &Repeat| nearest_frame(in_frames[repeat.note].end_secs);
        let rest = self.rest_frames();
        let quick = repeats(notes).filter(|repeat| end_frame(repeat) + rest > repeat.first + repeat.frames);
        let mut quick: Vec<&Note> = quick.map(|repeat| &notes[repeat.again]).collect();
        quick.sort_by(|a, b| a.start_secs.total_cmp(&b.start_secs));
        let line = |note: &Note| {
            let (position, name) = (song.position(note.start_secs), pitch_name(note.pitch));
            let why = "is struck again before the key has been up for long enough";
            format!("{position} ({:.2} s): {name} {why}", note.start_secs)
        };
        quick.into_iter().map(line).collect()
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// Names the one that is out of range.
    pub fn check(&self) -> Result<(), SongError> {
        check_range("task.plan.restrike_secs", self.restrike_secs, 0.0..=MAX_RESTRIKE_SECS)?;
        let (secs, range) = (self.latency_compensation_secs, 0.0..=MAX_LATENCY_COMPENSATION_SECS);
        Ok(check_range("task.plan.latency_compensation_secs", secs, range)?)
    }

    /// Frames in which a key is up before it is struck again; without one, it would not be struck.
    pub fn rest_frames(&self) -> usize {
        match self.rule {
            KeyScheduleRule::Robopianist => 1,
            KeyScheduleRule::Articulated => ceil_frame(self.restrike_secs * CONTROL_HZ).max(1),
        }
    }
}

/// Two successive notes of one pitch.
struct Repeat {
    /// Index of the earlier note.
    note: usize,
    /// Index of the later note.
    again: usize,
    /// Frame in which the earlier note begins.
    first: usize,
    /// Frames from one beginning to the other.
    frames: usize,
}

impl Repeat {
    /// Frames for which the key may sound so that it is up for `rest` frames afterwards; at least
    /// half of all.
    fn sounding(&self, rest: usize) -> usize {
        self.frames.saturating_sub(rest).max(self.frames.div_ceil(2)).max(1)
    }
}

/// The frame whose beginning is nearest to a time.
fn nearest_frame(secs: f64) -> usize {
    (secs * CONTROL_HZ + FRAME_TOLERANCE).round() as usize
}

/// The note from frame to frame, one at least.
fn in_whole_frames(note: &Note) -> Note {
    let first = nearest_frame(note.start_secs);
    let end = nearest_frame(note.end_secs).max(first + 1);
    Note { start_secs: first as f64 / CONTROL_HZ, end_secs: end as f64 / CONTROL_HZ, ..*note }
}

/// Every two successive notes of one pitch. `notes` are in order of time.
fn repeats(notes: &[Note]) -> impl Iterator<Item = Repeat> {
    let next_of_pitch = |index: usize| {
        let later = notes.iter().enumerate().skip(index + 1);
        later.filter(|(_, note)| note.pitch == notes[index].pitch).map(|(again, _)| again).next()
    };
    (0..notes.len()).filter_map(move |note| {
        let again = next_of_pitch(note)?;
        let [first, next] = [note, again].map(|index| nearest_frame(notes[index].start_secs));
        Some(Repeat { note, again, first, frames: next - first })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const ARTICULATED: KeyScheduleConfig = KeyScheduleConfig {
        rule: KeyScheduleRule::Articulated,
        restrike_secs: 0.1,
        latency_compensation_secs: 0.0,
    };

    fn song(notes: &[(u8, f64, f64)]) -> Song {
        let note = |&(pitch, start_secs, end_secs)| Note { pitch, velocity: 64, start_secs, end_secs };
        Song::new("", notes.iter().map(note).collect(), 0.0).unwrap()
    }

    fn frames(config: KeyScheduleConfig, notes: &[(u8, f64, f64)]) -> String {
        let frames = config.schedule(&song(notes), 0.0).unwrap().frames;
        frames.iter().map(|keys| if *keys == KeySet::EMPTY { '.' } else { '#' }).collect()
    }

    #[test]
    fn a_key_is_up_before_it_is_struck_again_and_onsets_stay() {
        let twice = [(60, 0.0, 0.4), (60, 0.4, 0.7)];
        assert_eq!(frames(KeyScheduleConfig::default(), &twice), "########.#####.");
        assert_eq!(frames(ARTICULATED, &twice), "######..######.");
        let longer = KeyScheduleConfig { restrike_secs: 0.12, ..ARTICULATED };
        assert_eq!(frames(longer, &twice), "#####...######.");
        // Without any rest the second note would not begin.
        assert_eq!(
            frames(KeyScheduleConfig { restrike_secs: 0.0, ..ARTICULATED }, &twice),
            "#######.######."
        );
        // A rest that is written stays.
        assert_eq!(frames(ARTICULATED, &[(60, 0.0, 0.1), (60, 0.4, 0.5)]), "##......##.");
    }

    #[test]
    fn notes_off_the_grid_begin_at_the_nearest_frame_and_are_heard_as_written() {
        let notes = [(60, 0.03, 0.08), (62, 0.12, 0.36), (64, 0.36, 0.37)];
        let schedule = ARTICULATED.schedule(&song(&notes), 0.0).unwrap();
        let due: Vec<String> = schedule.frames.iter().map(KeySet::to_string).collect();
        assert_eq!(due, ["", "60", "62", "62", "62", "62", "62", "64", ""]);
        assert_eq!(schedule.song, song(&notes));
    }

    #[test]
    fn silence_moves_frames_and_latency_compensation_does_not() {
        let early = KeyScheduleConfig { latency_compensation_secs: 0.025, ..ARTICULATED };
        let schedule = early.schedule(&song(&[(60, 0.1, 0.2)]), 0.26).unwrap();
        let due: Vec<usize> = schedule.frames.iter().map(|keys| keys.len()).collect();
        assert_eq!(due, [0, 0, 0, 0, 0, 0, 0, 1, 1, 0]);
        assert!((schedule.song.notes()[0].start_secs - (0.25 + 0.1 + 0.025)).abs() < 1e-12);
    }

    #[test]
    fn other_keys_are_left_alone() {
        let legato = song(&[(60, 0.0, 0.4), (62, 0.4, 0.8), (64, 0.6, 1.0)]);
        let schedule = ARTICULATED.schedule(&legato, 0.0).unwrap();
        assert_eq!((schedule.frames, schedule.song), (legato.frames(CONTROL_HZ).unwrap(), legato.clone()));
        assert!(ARTICULATED.quick_repeats(&legato).is_empty());
    }

    #[test]
    fn quick_repeats_keep_half_a_note_and_are_named() {
        let quick = [(60, 0.0, 0.15), (60, 0.15, 0.25), (60, 0.25, 0.30), (60, 0.30, 0.35)];
        // Three frames, two, one: the last two cannot be told apart by a key that has to be up in
        // between.
        assert_eq!(frames(ARTICULATED, &quick), "##.#.#..");
        let named = ARTICULATED.quick_repeats(&song(&quick));
        assert_eq!(named.len(), 3);
        for (line, secs) in named.iter().zip(["0.15 s", "0.25 s", "0.30 s"]) {
            assert!(line.contains(secs) && line.contains("C4"), "{line}");
        }
        assert!(KeyScheduleConfig::default().quick_repeats(&song(&quick)).is_empty());
        // Three frames, and the written note leaves two of them for the rest.
        assert!(ARTICULATED.quick_repeats(&song(&[(60, 0.0, 0.05), (60, 0.15, 0.2)])).is_empty());
    }

    #[test]
    fn numbers_out_of_range_are_refused() {
        let refused = |config: KeyScheduleConfig| {
            config.schedule(&song(&[(60, 0.0, 1.0)]), 0.0).unwrap_err().to_string()
        };
        for secs in [-0.1, 2.0, f64::NAN] {
            assert!(
                refused(KeyScheduleConfig { restrike_secs: secs, ..ARTICULATED }).contains("restrike_secs")
            );
            assert!(
                refused(KeyScheduleConfig { latency_compensation_secs: secs, ..ARTICULATED })
                    .contains("latency_compensation_secs")
            );
        }
    }
}
