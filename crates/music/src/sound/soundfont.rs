//! Recorded instruments: a SoundFont played by `rustysynth`.
//!
//! The synthesizer does not check the cross-references within a SoundFont and panics if they are
//! damaged. Such panics are caught here and reported as a damaged file.

use std::fs::File;
use std::io::BufReader;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rustysynth::{SoundFontError, Synthesizer, SynthesizerSettings};

use super::error::SoundError;
use super::samples::{SAMPLE_RATE_HZ, sample_at};
use crate::note::Note;

/// The first program of General MIDI, the grand piano, is chosen on any channel but percussion.
const CHANNEL: i32 = 0;

/// A SoundFont (SF2) in memory; cheap to clone.
#[derive(Clone, Debug)]
pub struct SoundFont {
    font: Arc<rustysynth::SoundFont>,
    path: PathBuf,
}

impl SoundFont {
    /// Reads a SoundFont from disk.
    ///
    /// # Errors
    /// If the file cannot be read, is compressed (SF3), or is no SoundFont.
    pub fn load(path: impl AsRef<Path>) -> Result<SoundFont, SoundError> {
        let path = path.as_ref();
        let unreadable = |source| SoundError::Read { path: path.into(), source };
        let file = File::open(path).map_err(unreadable)?;
        if file.metadata().map_err(unreadable)?.is_dir() {
            return Err(unreadable(std::io::ErrorKind::IsADirectory.into()));
        }
        let mut reader = BufReader::new(file);
        let read = unless_damaged(path, || rustysynth::SoundFont::new(&mut reader))?;
        let font = read.map_err(|error| match error {
            SoundFontError::UnsupportedSampleFormat => SoundError::Compressed { path: path.into() },
            SoundFontError::IoError(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => {
                SoundError::Read { path: path.into(), source }
            }
            SoundFontError::IoError(_) => {
                SoundError::NotASoundFont { path: path.into(), why: "the file is truncated".into() }
            }
            other => SoundError::NotASoundFont { path: path.into(), why: other.to_string() },
        })?;
        Ok(SoundFont { font: Arc::new(font), path: path.into() })
    }

    /// Plays the notes into the samples.
    pub(super) fn render(&self, notes: &[Note], samples: &mut [f32]) -> Result<(), SoundError> {
        unless_damaged(&self.path, || self.play(notes, samples))?;
        if samples.iter().all(|sample| sample.is_finite()) { Ok(()) } else { Err(damaged(&self.path)) }
    }

    fn play(&self, notes: &[Note], samples: &mut [f32]) {
        let settings = SynthesizerSettings::new(SAMPLE_RATE_HZ as i32);
        let mut synthesizer =
            Synthesizer::new(&self.font, &settings).expect("the settings are the synthesizer's defaults");
        // Releases come before strokes at the same sample, so that a repeated key sounds twice.
        let mut events: Vec<(usize, bool, &Note)> = Vec::with_capacity(notes.len() * 2);
        for note in notes {
            let (on, off) = (sample_at(note.start_secs), sample_at(note.end_secs));
            events.push((on, true, note));
            events.push((off.max(on + 1), false, note));
        }
        events.sort_by_key(|(at, stroke, _)| (*at, *stroke));

        let mut right = vec![0.0; samples.len()];
        let mut done = 0;
        for (at, stroke, note) in events {
            let at = at.min(samples.len());
            synthesizer.render(&mut samples[done..at], &mut right[done..at]);
            done = at;
            let key = i32::from(note.pitch.min(127));
            if stroke {
                synthesizer.note_on(CHANNEL, key, i32::from(note.velocity.min(127)));
            } else {
                synthesizer.note_off(CHANNEL, key);
            }
        }
        synthesizer.render(&mut samples[done..], &mut right[done..]);
        for (left, right) in samples.iter_mut().zip(right) {
            *left = (*left + right) / 2.0;
        }
    }
}

/// Runs the synthesizer's code on a user's file.
fn unless_damaged<T>(path: &Path, run: impl FnOnce() -> T) -> Result<T, SoundError> {
    // After a panic everything that `run` has changed is dropped with the error.
    catch_unwind(AssertUnwindSafe(run)).map_err(|_| damaged(path))
}

fn damaged(path: &Path) -> SoundError {
    SoundError::NotASoundFont { path: path.into(), why: "it is damaged inside".into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_soundfonts_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let missing = SoundFont::load(folder.path().join("no.sf2")).unwrap_err();
        assert!(matches!(missing, SoundError::Read { .. }), "{missing}");
        let directory = SoundFont::load(folder.path()).unwrap_err();
        assert!(matches!(directory, SoundError::Read { .. }), "{directory}");
        for content in [&b""[..], b"RIFF", b"not a soundfont at all", b"RIFF\x10\0\0\0WAVEfmt "] {
            let path = folder.path().join("bad.sf2");
            std::fs::write(&path, content).unwrap();
            let bad = SoundFont::load(&path).unwrap_err();
            assert!(matches!(bad, SoundError::NotASoundFont { .. }), "{bad}");
            assert!(bad.to_string().contains("bad.sf2"), "{bad}");
        }
    }
}
