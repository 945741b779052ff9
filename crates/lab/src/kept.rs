//! A performance by another player, or of another song, in the folder of a new one: it is not replaced, but moved to a folder of its own.
//!
//! ```text
//! out/twinkle/             the new performance
//! out/twinkle-my-run/      the one that was there before, by the policy of runs/my-run
//! ```

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::earlier::{move_back, move_performance};
use crate::errors::unusable;
use crate::folder::slug;
use crate::play::REPORT;

/// A performance that a new one has not replaced.
#[derive(Clone, Debug, PartialEq)]
pub struct Kept {
    /// Title of its song.
    pub song: String,
    /// Its player.
    pub player: String,
    /// Where it is now.
    pub folder: PathBuf,
}

impl Kept {
    /// Moves the performance in `folder` to one of its own, which did not exist, if it is not of `song` by `player`.
    ///
    /// # Errors
    /// If it cannot be moved; it is then where it was.
    pub(crate) fn moved_from(folder: &Path, song: &str, player: &str) -> anyhow::Result<Option<Self>> {
        let Some((of_song, of_player)) = song_and_player(folder) else { return Ok(None) };
        if of_song == song && of_player == player {
            return Ok(None);
        }
        let to = free_folder(folder, &of_player)?;
        if let Err(error) = move_performance(folder, &to) {
            let _ = move_back(&to, folder);
            return Err(error);
        }
        Ok(Some(Self { song: of_song, player: of_player, folder: to }))
    }

    /// Moves it back to `folder`, over what is there.
    pub(crate) fn move_back(&self, folder: &Path) -> anyhow::Result<()> {
        move_back(&self.folder, folder)
    }
}

/// Song and player that the report in `folder` names, if there is one.
fn song_and_player(folder: &Path) -> Option<(String, String)> {
    let report: Value = serde_json::from_slice(&std::fs::read(folder.join(REPORT)).ok()?).ok()?;
    let text = |key: &str| report.get(key)?.as_str().map(str::to_string);
    Some((text("song")?, text("player")?))
}

/// A folder beside `folder` that does not exist, named after it and the player.
fn free_folder(folder: &Path, player: &str) -> anyhow::Result<PathBuf> {
    // `.` has no name.
    let folder = if folder.file_name().is_some() {
        folder.to_path_buf()
    } else {
        folder.canonicalize().map_err(|error| unusable(folder, error))?
    };
    let named = folder.file_name().unwrap_or_default().to_string_lossy();
    let named = format!("{named}-{}", player_slug(Path::new(player)));
    let numbered = (2..).map(|number| format!("{named}-{number}"));
    let mut names = std::iter::once(named.clone()).chain(numbered).map(|name| folder.with_file_name(name));
    Ok(names.find(|to| to.symlink_metadata().is_err()).expect("there is no end of numbers"))
}

/// A player in the name of a folder: a policy of a run by the run's folder, another one by its file.
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

    const MINE: &str = "runs/mine/policy-best.safetensors";

    fn write(folder: &Path, song: &str, player: &str) {
        std::fs::create_dir_all(folder).unwrap();
        std::fs::write(folder.join("recording.mcap"), player).unwrap();
        std::fs::write(folder.join("worlds.csv"), "of the user").unwrap();
        let files = serde_json::json!({ "recording": folder.join("recording.mcap") });
        let report = serde_json::json!({ "song": song, "player": player, "runs": [{ "files": files }] });
        std::fs::write(folder.join(REPORT), report.to_string()).unwrap();
    }

    /// The recording that the report in `folder` names.
    fn recording(folder: &Path) -> String {
        let report: Value = serde_json::from_slice(&std::fs::read(folder.join(REPORT)).unwrap()).unwrap();
        report["runs"][0]["files"]["recording"].as_str().unwrap().to_string()
    }

    fn player_in(folder: &Path) -> Option<String> {
        song_and_player(folder).map(|(_, player)| player)
    }

    #[test]
    fn another_players_performance_is_moved_and_ones_own_is_not() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("twinkle");
        write(&folder, "Twinkle", MINE);
        let moved = |song: &str, player: &str| Kept::moved_from(&folder, song, player).unwrap();
        assert_eq!(moved("Twinkle", MINE), None);
        assert_eq!(player_in(&folder).as_deref(), Some(MINE));

        let kept = moved("Twinkle", "policies/twinkle.safetensors").unwrap();
        assert_eq!(kept.folder, root.path().join("twinkle-mine"));
        assert_eq!(player_in(&kept.folder).as_deref(), Some(MINE));
        assert_eq!(recording(&kept.folder), kept.folder.join("recording.mcap").display().to_string());
        assert_eq!(player_in(&folder), None);
        assert!(folder.join("worlds.csv").is_file(), "not of a performance");
        assert_eq!(moved("Twinkle", "scripted"), None, "nothing is there");

        // A player in this folder has not moved with the performance.
        let inside = folder.join("policy-best.safetensors").display().to_string();
        write(&folder, "Twinkle", &inside);
        let kept = moved("Twinkle", MINE).unwrap();
        assert_eq!(player_in(&kept.folder), Some(inside));

        // Another song of the same name, as of `Bach 1.mid` and `Bach_1.mid`. Nothing is replaced where it goes.
        write(&folder, "Twinkle 2", MINE);
        let other = moved("Twinkle", MINE).unwrap();
        assert_eq!(other.folder, root.path().join("twinkle-mine-2"));
        other.move_back(&folder).unwrap();
        assert!(!other.folder.exists() && player_in(&folder).is_some());
        assert_eq!(recording(&folder), folder.join("recording.mcap").display().to_string());
    }

    #[test]
    fn a_performance_that_cannot_be_moved_stays() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("twinkle");
        write(&folder, "Twinkle", MINE);
        // Files of this name cannot be renamed into the new folder: its name is too long.
        let player = format!("{}.safetensors", "x".repeat(300));
        write(&folder, "Twinkle", &player);
        assert!(Kept::moved_from(&folder, "Twinkle", MINE).is_err());
        assert_eq!(player_in(&folder), Some(player));
    }

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
