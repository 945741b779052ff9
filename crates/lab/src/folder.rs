//! Folders: those that a user chooses, and the files in a run's folder.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use etude_music::Song;

/// Name of the resolved configuration in a run's folder.
pub const CONFIG: &str = "config.toml";
/// Name of the song in the folder of a run or of a performance. To resume or play the run, no other
/// song file is needed.
pub const SONG: &str = "song.mid";
/// Name of the description of who made the run and how.
pub const META: &str = "meta.json";

/// How many notes the song of the run or the performance in `folder` has, if they are not those of
/// `song`.
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

/// Longest readable part of a name, characters: a folder's name has at most 255 bytes.
const MAX_SLUG_CHARS: usize = 60;

/// `text` as part of a file's name: letters and digits in lower case, `.` and `_`, and one `-` for
/// all that is between them.
pub fn readable(text: &str) -> String {
    // Two of them are between the parts of a run's name.
    let lower = text.to_lowercase().replace("__", " ");
    let words = lower.split(|c: char| !c.is_alphanumeric() && !"._".contains(c));
    let words: Vec<&str> = words.map(|word| word.trim_matches('.')).filter(|word| !word.is_empty()).collect();
    words.join("-").chars().take(MAX_SLUG_CHARS).collect()
}

/// The same of a name that a user has chosen. A text that is changed by this gets a mark of its own
/// at the end, so that different texts have different names.
pub fn slug(text: &str) -> String {
    let mut name = readable(text);
    if name != text || name.is_empty() {
        let between = if name.is_empty() { "" } else { "-" };
        name = format!("{name}{between}{:06x}", crc32c::crc32c(text.as_bytes()) & 0xFF_FFFF);
    }
    name
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
    let name = named.file_stem().unwrap_or_default().to_string_lossy();
    name.split("__").map(slug).collect::<Vec<_>>().join("__")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn players_are_named_after_their_run_or_their_file() {
        let name = |player: &str| player_slug(Path::new(player));
        assert_eq!(name("runs/twinkle__fast__0/policy-best.safetensors"), "twinkle__fast__0");
        assert_eq!(name("policies/sight-reader.safetensors"), "sight-reader");
        assert_eq!(name("runs/twinkle__fast__0"), "twinkle__fast__0");
        assert_eq!(name("scripted"), "scripted");
        assert_eq!(name("песня.safetensors"), "песня");
    }

    #[test]
    fn different_texts_have_different_names() {
        for same in ["twinkle", "c-major-scale", "月光", "für-elise", "0.025", "op.27-no.2", "latency_secs"]
        {
            assert_eq!(slug(same), same);
        }
        let texts = [
            "Für Elise",
            "für elise",
            "für-elise",
            "Fur Elise",
            "!",
            "?",
            "",
            ".",
            "a/b",
            "a b",
            "a__b",
            "a_b",
            "हिन्दी",
            "हनद",
            &"long ".repeat(100),
            &"long ".repeat(101),
        ];
        let names: std::collections::BTreeSet<String> = texts.iter().map(|text| slug(text)).collect();
        assert_eq!(names.len(), texts.len(), "{names:?}");
        for name in names {
            assert!(!name.is_empty() && !name.starts_with('.') && name.len() < 255, "{name}");
            assert!(!name.contains(['/', ' ']) && !name.contains("__"), "{name}");
        }
    }
}
