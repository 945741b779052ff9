//! Folders: those that a user chooses, and the files in a run's folder.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use etude_music::Song;

/// Name of the resolved configuration in a run's folder.
pub const CONFIG: &str = "config.toml";
/// Name of the song in a run's folder. To resume or play the run, no other song file is needed.
pub const SONG: &str = "song.mid";
/// Name of the description of who made the run and how.
pub const META: &str = "meta.json";

/// How many notes the song has that the run in `folder` learned, if they are not those of `song`.
pub(crate) fn other_notes(folder: &Path, song: &Song) -> Option<usize> {
    let theirs = Song::load(folder.join(SONG)).ok()?;
    (!theirs.has_the_notes_of(song)).then(|| theirs.notes().len())
}

/// The policy file of the run in `folder` that should be played: the best, or the last while none
/// has been evaluated.
pub(crate) fn policy_in(folder: &Path) -> Option<PathBuf> {
    ["policy-best.safetensors", "policy-last.safetensors"]
        .map(|name| folder.join(name))
        .into_iter()
        .find(|path| path.is_file())
}

/// `text` as part of a file's name: letters and digits of ASCII in lower case, one `-` for all that
/// is between them.
pub fn slug(text: &str) -> String {
    let words = text.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
    words.collect::<Vec<_>>().join("-").to_ascii_lowercase()
}

/// Makes a folder that the user has chosen with `-o`, and those above it.
///
/// # Errors
/// If it cannot be made.
pub fn make_folder(folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder)
        .with_context(|| format!("cannot make the folder {}; choose another with -o", folder.display()))
}

/// A player in the name of a folder: a policy of a run by the run's folder, another one by its
/// file.
pub fn player_slug(player: &Path) -> String {
    let is_of_run = player.file_name().is_some_and(|file| file.to_string_lossy().starts_with("policy-"));
    let named = player.parent().filter(|_| is_of_run).unwrap_or(player);
    let name = slug(&named.file_stem().unwrap_or_default().to_string_lossy());
    // A name may have no letter of ASCII.
    if name.is_empty() { "player".to_string() } else { name }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn players_are_named_after_their_run_or_their_file() {
        let name = |player: &str| player_slug(Path::new(player));
        assert_eq!(name("runs/twinkle__fast__0/policy-best.safetensors"), "twinkle-fast-0");
        assert_eq!(name("policies/sight-reader.safetensors"), "sight-reader");
        assert_eq!(name("runs/twinkle__fast__0"), "twinkle-fast-0");
        assert_eq!(name("scripted"), "scripted");
        assert_eq!(name("песня.safetensors"), "player");
    }
}
