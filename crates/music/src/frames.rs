//! From notes to frames (the keys that are due in each control step), and from key events to notes.
//!
//! The rules are RoboPianist's (github.com/google-research/robopianist, `music/midi_file.py` and
//! `music/piano_roll.py`), so that scores compare: the number of frames of a song, the frames that
//! a note covers, and the gap of one frame between two strokes of a key.

use etude_checks::{check_range, positive_to};

use crate::error::SongError;
use crate::file_limits::MAX_CONTROL_HZ;
use crate::keys::{KEY_COUNT, KeySet, LOWEST_PITCH, key_of_pitch};
use crate::note::{Note, without_overlaps};
use crate::song::Song;

/// A time this close to a frame's beginning, in frames, is on it. RoboPianist truncates floating
/// point products, so that with steps of 0.7 s some notes are one frame off; here they are not.
pub(crate) const FRAME_TOLERANCE: f64 = 1e-6;
/// An event this short a time after a sample is included in it, s.
const TIME_TOLERANCE_SECS: f64 = 1e-9;

impl Song {
    /// One set of keys a control step.
    ///
    /// A song of *T* seconds has floor(*T*·rate) + 1 frames. A note covers the frames from
    /// floor(start·rate) up to but not including ceil(end·rate), one at least. Where a key sounds
    /// in one frame and is struck again in the next, it is left out of that next frame, so that it
    /// has to be released.
    ///
    /// # Errors
    /// If a note is off the keyboard, or the rate is not above 0 and at most 1000 Hz.
    pub fn frames(&self, control_hz: f64) -> Result<Vec<KeySet>, SongError> {
        check_range("control_hz", control_hz, positive_to(MAX_CONTROL_HZ))?;
        self.check_range()?;
        let count = floor_frame(self.duration_secs() * control_hz) + 1;
        let mut sounding = vec![KeySet::EMPTY; count];
        let mut struck = vec![KeySet::EMPTY; count];
        for note in self.notes() {
            let Some(key) = key_of_pitch(note.pitch) else { continue };
            let first = floor_frame(note.start_secs * control_hz).min(count - 1);
            let end = ceil_frame(note.end_secs * control_hz).clamp(first + 1, count);
            struck[first].insert(key);
            for frame in &mut sounding[first..end] {
                frame.insert(key);
            }
        }
        let mut before = KeySet::EMPTY;
        for (frame, struck) in sounding.iter_mut().zip(&struck) {
            let now = *frame;
            *frame = now.difference(struck.intersection(before));
            before = now;
        }
        Ok(sounding)
    }

    /// The frames of a whole episode: silence first, then the song. The silence lasts the whole
    /// number of frames nearest to `initial_silence_secs` (RoboPianist's `initial_buffer_time`).
    ///
    /// # Errors
    /// As [`Song::frames`]; also if the silence is negative or takes the song beyond the longest
    /// duration.
    pub fn episode_frames(
        &self,
        control_hz: f64,
        initial_silence_secs: f64,
    ) -> Result<Vec<KeySet>, SongError> {
        let song = self.frames(control_hz)?;
        self.with_initial_silence(initial_silence_secs)?;
        let silent = (initial_silence_secs * control_hz).round() as usize;
        let mut frames = vec![KeySet::EMPTY; silent];
        frames.extend(song);
        Ok(frames)
    }
}

fn floor_frame(frames: f64) -> usize {
    (frames + FRAME_TOLERANCE).floor() as usize
}

/// The whole frames that cover this many; one that is complete except for rounding does not begin
/// another.
pub fn ceil_frame(frames: f64) -> usize {
    (frames - FRAME_TOLERANCE).ceil().max(0.0) as usize
}

/// A key going down or coming up, as a physics step or a MIDI keyboard reports it.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct KeyEvent {
    /// When, in seconds.
    pub secs: f64,
    /// Key index from the left.
    pub key: usize,
    /// MIDI velocity of the stroke, 1 to 127; zero for a release.
    pub velocity: u8,
}

/// The notes of key events, in order of time. A stroke of a key that is down ends its note and
/// begins another; a release of a key that is up is ignored; keys that are not released end at
/// `end_secs`. Events with keys outside the keyboard or times that are not finite are ignored.
pub fn notes_from_key_events(events: &[KeyEvent], end_secs: f64) -> Vec<Note> {
    let mut events: Vec<&KeyEvent> =
        events.iter().filter(|event| event.key < KEY_COUNT && event.secs.is_finite()).collect();
    events.sort_by(|a, b| a.secs.total_cmp(&b.secs));
    let mut down: [Option<(f64, u8)>; KEY_COUNT] = [None; KEY_COUNT];
    let mut notes = Vec::new();
    let mut close = |key: usize, stroke: Option<(f64, u8)>, at_secs: f64| {
        if let Some((start_secs, velocity)) = stroke {
            let end_secs = at_secs.max(start_secs);
            notes.push(Note { pitch: LOWEST_PITCH + key as u8, velocity, start_secs, end_secs });
        }
    };
    for event in events {
        let stroke = (event.velocity > 0).then(|| (event.secs, event.velocity.min(127)));
        close(event.key, std::mem::replace(&mut down[event.key], stroke), event.secs);
    }
    for (key, stroke) in down.into_iter().enumerate() {
        close(key, stroke, end_secs);
    }
    without_overlaps(notes)
}

/// Keys that are down at each of these times, which do not decrease, if those of `down` are down
/// before the first event. An event counts from its own time on.
pub fn keys_at(mut down: KeySet, events: &[KeyEvent], times: impl IntoIterator<Item = f64>) -> Vec<KeySet> {
    let mut events: Vec<&KeyEvent> = events.iter().filter(|event| event.secs.is_finite()).collect();
    events.sort_by(|a, b| a.secs.total_cmp(&b.secs));
    let mut events = events.into_iter().peekable();
    let down_at = |secs| {
        while let Some(event) = events.next_if(|event| event.secs <= secs + TIME_TOLERANCE_SECS) {
            match event.velocity {
                0 => down.remove(event.key),
                _ => down.insert(event.key),
            };
        }
        down
    };
    times.into_iter().map(down_at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CONTROL_HZ;

    fn note(pitch: u8, start_secs: f64, end_secs: f64) -> Note {
        Note { pitch, velocity: 64, start_secs, end_secs }
    }

    fn keys(frames: &[KeySet]) -> Vec<String> {
        frames.iter().map(KeySet::to_string).collect()
    }

    #[test]
    fn keys_are_down_from_their_strike_to_their_release() {
        let event = |secs, key, velocity| KeyEvent { secs, key, velocity };
        // Not in order; at 0.4 s key 0 is released and struck again.
        let events =
            [event(0.4, 0, 0), event(0.4, 0, 9), event(0.1, 0, 9), event(0.2, 2, 0), event(f64::NAN, 5, 9)];
        let held: KeySet = KeySet::from_pitches([LOWEST_PITCH + 2]);
        let times = [0.0, 0.1, 0.1999, 0.2, 0.4, 9.0];
        let down = |time: usize| keys_at(held, &events, times)[time].iter().collect::<Vec<_>>();
        let expected: [&[usize]; 6] = [&[2], &[0, 2], &[0, 2], &[0], &[0], &[0]];
        for (time, expected) in expected.iter().enumerate() {
            assert_eq!(down(time), *expected, "at {} s", times[time]);
        }
    }

    #[test]
    fn a_repeated_note_gets_a_gap_and_a_short_one_a_frame() {
        let notes = vec![note(60, 0.0, 0.1), note(60, 0.1, 0.2), note(62, 0.2, 0.2)];
        let song = Song::new("", notes, 0.0).unwrap();
        assert_eq!(keys(&song.frames(CONTROL_HZ).unwrap()), ["60", "60", "", "60", "62"]);
    }

    #[test]
    fn notes_between_borders_cover_every_frame_they_touch() {
        let song = Song::new("", vec![note(60, 0.04, 0.11)], 0.25).unwrap();
        assert_eq!(keys(&song.frames(CONTROL_HZ).unwrap()), ["60", "60", "60", "", "", ""]);
    }

    #[test]
    fn rates_out_of_range_are_refused() {
        let song = Song::new("", vec![note(60, 0.0, 1.0)], 0.0).unwrap();
        for rate in [0.0, -20.0, f64::NAN, f64::INFINITY, 1e9] {
            assert!(song.frames(rate).unwrap_err().to_string().contains("control_hz is "), "{rate}");
        }
        assert!(song.episode_frames(CONTROL_HZ, f64::INFINITY).is_err());
    }

    #[test]
    fn key_events_come_back_as_notes() {
        let event = |secs, key, velocity| KeyEvent { secs, key, velocity };
        let events = [
            event(0.5, 24, 64),
            event(1.0, 24, 0),
            event(1.1, 24, 0),
            event(1.2, 26, 64),
            event(1.4, 26, 64),
            event(0.0, 999, 64),
            event(f64::NAN, 24, 64),
        ];
        assert_eq!(
            notes_from_key_events(&events, 2.0),
            [note(60, 0.5, 1.0), note(62, 1.2, 1.4), note(62, 1.4, 2.0)]
        );
    }
}
