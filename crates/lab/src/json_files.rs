//! JSON files of results.

use std::io::ErrorKind;
use std::path::Path;

use anyhow::anyhow;
use etude_perform::write_file;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::errors::unusable;

/// The content of a file; none if there is no file.
pub(crate) fn load<T: DeserializeOwned>(file: &Path) -> anyhow::Result<Option<T>> {
    let bytes = match std::fs::read(file) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(unusable(file, error)),
    };
    serde_json::from_slice(&bytes).map(Some).map_err(|error| {
        anyhow!("{} is damaged ({error}): remove its folder, and this part is made again", file.display())
    })
}

/// Writes it on one line.
pub(crate) fn save(file: &Path, content: &impl Serialize) -> anyhow::Result<()> {
    Ok(write_file(file, &(serde_json::to_string(content)? + "\n"))?)
}

/// Writes it for people to read.
pub(crate) fn save_pretty(file: &Path, content: &impl Serialize) -> anyhow::Result<()> {
    Ok(write_file(file, &(serde_json::to_string_pretty(content)? + "\n"))?)
}
