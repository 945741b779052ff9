//! Checks of the files that a command writes.

use std::io::Read as _;
use std::path::{Path, PathBuf};

use anyhow::Context as _;

/// The output file `out` with its folder created; an error without the extension `ending`.
pub fn output_file(out: PathBuf, ending: &str, hint: &str) -> anyhow::Result<PathBuf> {
    if out.extension().is_none_or(|given| given != ending) {
        anyhow::bail!("cannot write {}: {hint}", out.display());
    }
    if let Some(folder) = out.parent() {
        etude_lab::make_folder(folder)?;
    }
    Ok(out)
}

/// Refuses to replace a file without this `mark` in its first bytes: this command has not written
/// it.
pub fn check_replaceable(out: &Path, mark: &str) -> anyhow::Result<()> {
    let unreadable = || format!("cannot check whether {} may be replaced", out.display());
    let mut head = Vec::new();
    match out.metadata() {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(error).with_context(unreadable),
        // A device or a pipe has no content.
        Ok(metadata) if !metadata.is_file() => return Ok(()),
        Ok(_) => {
            let file = std::fs::File::open(out).with_context(unreadable)?;
            file.take(4096).read_to_end(&mut head).with_context(unreadable)?;
        }
    }
    if !head.is_empty() && !head.windows(mark.len()).any(|bytes| bytes == mark.as_bytes()) {
        anyhow::bail!(
            "{} exists, and this command has not written it: choose another name, or remove the file",
            out.display()
        );
    }
    Ok(())
}
