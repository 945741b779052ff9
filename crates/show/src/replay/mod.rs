//! Replays: recordings as one page that shows the hand, the score and the keys, and sounds; nothing else is needed to open it.
//!
//! [`Take`] is what the page is told of a recording; `viewer/` draws it.

mod page;
mod rewards;
mod roll;
mod take;

use std::path::{Path, PathBuf};

use etude_perform::{FileError, Recording, RecordingError};
use etude_stage::StageError;

pub use page::replay_page;
pub(crate) use roll::roll_svg;
pub use take::{Mark, MarkKind, PlayedNote, Take};

/// A recording could not be shown.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// It cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// Its world cannot be built.
    #[error(transparent)]
    Stage(#[from] StageError),
    /// The page cannot be written.
    #[error(transparent)]
    Write(#[from] FileError),
    /// A folder has nothing to show.
    #[error(
        "no recording in {0}: `etude play`, `perform`, `rehearse` and `record` make them (*.mcap); name one, or a folder that \
         holds some"
    )]
    Nothing(PathBuf),
    /// A folder cannot be read.
    #[error("cannot look into {path}: {source}")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

/// The recordings that a path means: itself, or those below it if it is a folder, sorted.
///
/// # Errors
/// If a folder cannot be read, or none is there.
pub fn recordings(path: &Path) -> Result<Vec<PathBuf>, ReplayError> {
    if !path.is_dir() {
        return Ok(vec![path.to_path_buf()]);
    }
    let mut found = Vec::new();
    look(path, &mut found).map_err(|source| ReplayError::Folder { path: path.to_path_buf(), source })?;
    found.sort();
    if found.is_empty() { Err(ReplayError::Nothing(path.to_path_buf())) } else { Ok(found) }
}

fn look(folder: &Path, found: &mut Vec<PathBuf>) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        // What a link leads to is not below this folder, and may lead in a circle.
        if entry.file_type()?.is_dir() {
            look(&entry.path(), found)?;
        } else if entry.path().extension().is_some_and(|extension| extension == "mcap") {
            found.push(entry.path());
        }
    }
    Ok(())
}

/// Reads a recording as the page needs it.
///
/// # Errors
/// If it cannot be read at all. A damaged or unfinished one is read as far as it goes and says so.
pub fn read_take(path: &Path) -> Result<Take, ReplayError> {
    Take::new(&Recording::read(path)?, path.display().to_string())
}
