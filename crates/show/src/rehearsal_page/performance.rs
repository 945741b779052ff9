//! A performance on the page of a rehearsal: its replay and its sound.

use std::path::{Path, PathBuf};

use etude_perform::NoteCounts;
use maud::{Markup, html};

use crate::replay::{read_take, replay_page};

/// A performance. Paths are relative to the folder of the rehearsal, so that it can be moved.
pub(super) struct Performance {
    /// None if there is no file.
    pub sound: Option<PathBuf>,
    /// The replay page, or why there is none.
    pub replay: Result<PathBuf, String>,
    pub notes: Option<NoteCounts>,
}

/// Writes the replay page of a recording beside it.
pub(super) fn performance(recording: &Path, folder: &Path) -> anyhow::Result<Performance> {
    let sound = recording.with_extension("wav");
    let sound = sound.is_file().then(|| inside(&sound, folder));
    // The page is written in spite of a damaged recording.
    let take = match read_take(recording) {
        Ok(take) => take,
        Err(error) => return Ok(Performance { sound, replay: Err(error.to_string()), notes: None }),
    };
    let replay = recording.with_extension("html");
    replay_page(std::slice::from_ref(&take), &replay)?;
    let notes = take.note_scores.as_ref().map(NoteCounts::from);
    Ok(Performance { sound, replay: Ok(inside(&replay, folder)), notes })
}

/// `path` relative to `folder`.
fn inside(path: &Path, folder: &Path) -> PathBuf {
    path.strip_prefix(folder).unwrap_or(path).to_path_buf()
}

/// The links to the replay and to the sound.
pub(super) fn see_and_hear(name: &str, performance: &Performance) -> Markup {
    html! {
        @match &performance.replay {
            Ok(page) => a href=(page.display()) { "Replay of " (name) },
            Err(why) => { "No replay of " (name) ": " (why) }
        }
        @if let Some(notes) = &performance.notes { " · " (notes) }
        @if let Some(sound) = &performance.sound {
            audio controls preload="none" src=(sound.display()) aria-label={ "Sound of " (name) } {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_that_cannot_be_read_does_not_stop_the_page() {
        let folder = tempfile::tempdir().unwrap();
        let recording = folder.path().join("iteration-0/performance/run-1.mcap");
        let shown = performance(&recording, folder.path()).unwrap();
        assert!(shown.replay.is_err());
        assert_eq!(shown.sound, None);
        std::fs::create_dir_all(recording.parent().unwrap()).unwrap();
        std::fs::write(recording.with_extension("wav"), "").unwrap();
        let shown = performance(&recording, folder.path()).unwrap();
        assert_eq!(shown.sound, Some("iteration-0/performance/run-1.wav".into()));
    }
}
