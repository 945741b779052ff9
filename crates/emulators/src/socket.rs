//! Sockets on which emulators are found.

use std::os::unix::fs::FileTypeExt as _;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;

/// Listens at `path` without blocking. A socket that an emulator which has ended left there is
/// replaced; one that is served, or another kind of file, is not.
///
/// # Errors
/// What is wrong, and what to do.
pub(crate) fn bind_socket(path: &Path) -> Result<UnixListener, String> {
    if UnixStream::connect(path).is_ok() {
        return Err("another emulator listens there: stop it, or choose another path".to_owned());
    }
    if std::fs::symlink_metadata(path).is_ok_and(|file| file.file_type().is_socket()) {
        std::fs::remove_file(path).map_err(|error| format!("{error}: remove this old socket"))?;
    }
    UnixListener::bind(path).and_then(|listener| listener.set_nonblocking(true).map(|()| listener)).map_err(
        |error| format!("{error}: choose a path of at most 100 characters in a folder that you may write"),
    )
}
