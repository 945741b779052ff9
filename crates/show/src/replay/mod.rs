//! Replays: recordings as one self-contained page that shows the hand, the score and the keys, and
//! plays the sound.
//!
//! [`Take`] is the page's data of a recording; `viewer/` draws it.

mod arm;
mod judged;
mod marks;
mod matching;
mod page;
mod rewards;
mod roll;
mod take;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use etude_lab::{is_other_result, numbered};
use etude_perform::Recording;
use walkdir::{DirEntry, WalkDir};

pub use arm::Arm;
pub(crate) use judged::{DUE_COLOUR, FILL_OF_OUT_OF_TIME, NoteJudgement};
pub use marks::{Mark, MarkKind};
pub use matching::NoteMatch;
pub use page::replay_page;
pub(crate) use roll::roll_svg;
pub use take::{Take, TakeNote};

/// The recordings that a path means: itself, or those below it if it is a folder, sorted. Of
/// numbered results, the latest is taken.
///
/// # Errors
/// If a folder cannot be read, or none is there.
pub fn recordings(path: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let path = &numbered(path);
    if !path.is_dir() {
        let played = Path::new("out").join(path);
        if !path.exists() && played.is_dir() {
            bail!("there is no recording {}; did you mean {}?", path.display(), played.display());
        }
        return Ok(vec![path.to_path_buf()]);
    }
    let mut found = Vec::new();
    // Links are not followed: they may form a circle.
    let is_shown = |entry: &DirEntry| entry.depth() == 0 || !is_other_result(entry.path());
    for entry in WalkDir::new(path).into_iter().filter_entry(is_shown) {
        let entry = entry.with_context(|| format!("cannot look into {}", path.display()))?;
        if !entry.file_type().is_dir() && entry.path().extension().is_some_and(|ending| ending == "mcap") {
            found.push(entry.into_path());
        }
    }
    found.sort();
    if found.is_empty() {
        bail!(
            "no recording in {}: `etude play`, `perform`, `rehearse` and `record` make them (*.mcap); name one, or a folder that \
             holds some",
            path.display()
        );
    }
    Ok(found)
}

/// The recording that a path means, as [`recordings`].
///
/// # Errors
/// As that, and if there are several.
pub fn recording(path: &Path) -> anyhow::Result<PathBuf> {
    let found = recordings(path)?;
    let [recording] = found.as_slice() else {
        let names: Vec<String> = found.iter().map(|path| path.display().to_string()).collect();
        bail!("{} holds {} recordings; name one of them: {}", path.display(), found.len(), names.join(", "));
    };
    Ok(recording.clone())
}

/// Reads a recording as the page needs it.
///
/// # Errors
/// If it cannot be read at all. A damaged or unfinished one is read as far as it goes, which its
/// [`Take`] says.
pub fn read_take(path: &Path) -> anyhow::Result<Take> {
    Take::new(&Recording::read(path)?, path.display().to_string())
}
