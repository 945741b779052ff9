//! Small files beside a performance. Each is written under another name first and then renamed, so
//! that a full disk or an interruption never replaces a complete file by half of one.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use atomic_write_file::AtomicWriteFile;
use etude_music::KeySet;
use etude_music::sound::write_hint;

/// A file could not be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {path}: {source}; {}", write_hint(.source))]
pub struct FileError {
    path: PathBuf,
    source: std::io::Error,
}

/// Writes `content` to `path`. A device or a pipe is written to, and any other file is replaced by
/// a complete one.
///
/// # Errors
/// If the folder is missing or not writable, or the disk is full.
pub fn write_file(path: &Path, content: &(impl AsRef<[u8]> + ?Sized)) -> Result<(), FileError> {
    let write = || {
        if path.metadata().is_ok_and(|there| !there.is_file()) {
            return std::fs::write(path, content);
        }
        let mut file = AtomicWriteFile::open(path)?;
        file.write_all(content.as_ref())?;
        file.commit()
    };
    write().map_err(|source| FileError { path: path.to_path_buf(), source })
}

/// Writes one line a control step: `step`, then the MIDI numbers of the keys due and, if given, of
/// those pressed, separated by spaces, so that anyone can compute the scores again.
///
/// # Errors
/// As [`write_file`].
pub fn write_frames_csv(path: &Path, due: &[KeySet], pressed: Option<&[KeySet]>) -> Result<(), FileError> {
    let mut text = String::from(if pressed.is_some() { "step,due,pressed\n" } else { "step,due\n" });
    for (step, keys) in due.iter().enumerate() {
        // Writing to a string cannot fail.
        let _ = match pressed.and_then(|pressed| pressed.get(step)) {
            Some(pressed) => writeln!(text, "{step},{keys},{pressed}"),
            None => writeln!(text, "{step},{keys}"),
        };
    }
    write_file(path, &text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pipe_is_written_to_and_stays_a_pipe() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || std::fs::read_to_string(pipe).unwrap()
        });
        write_file(&pipe, "due").unwrap();
        assert_eq!(reader.join().unwrap(), "due");
        assert!(!pipe.metadata().unwrap().is_file());
    }
}
