//! The claim on a rig: only one process moves it, and any other can ask that process to stop.

use std::fs::File;
use std::path::{Path, PathBuf};

/// A rig that this process alone may move, by a locked file beside the rig's file.
pub struct Claim {
    _lock: File,
    stop: PathBuf,
}

impl Claim {
    /// Claims a rig and removes earlier requests to stop it.
    ///
    /// # Errors
    /// If another process has it, or the folder cannot be written to.
    pub fn new(rig: &Path) -> std::io::Result<Self> {
        let lock = File::create(beside(rig, "lock"))?;
        lock.try_lock().map_err(|_| {
            std::io::Error::other(
                "another `etude` uses this rig; wait for it, or stop it with `etude robot stop`",
            )
        })?;
        let stop = beside(rig, "stop");
        match std::fs::remove_file(&stop) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error),
            _ => Ok(Self { _lock: lock, stop }),
        }
    }

    pub(super) fn is_told_to_stop(&self) -> bool {
        self.stop.exists()
    }
}

/// Requests the process that has claimed the rig to stop the robot and to end.
///
/// # Errors
/// If the folder cannot be written to.
pub fn tell_to_stop(rig: &Path) -> std::io::Result<()> {
    File::create(beside(rig, "stop")).map(|_| ())
}

fn beside(rig: &Path, extension: &str) -> PathBuf {
    rig.with_extension(extension)
}
