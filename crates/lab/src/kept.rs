//! A performance by another player, or of another song, in the folder of a new one: it is not replaced, but moved to a folder of its own.
//!
//! ```text
//! out/twinkle/             the new performance
//! out/twinkle-my-run/      the one that was there before, by the policy of runs/my-run
//! ```

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::Value;

use crate::earlier::{files, move_performance, remove_files};
use crate::errors::unusable;
use crate::folder::slug;
use crate::play::REPORT;

/// A performance that a new one has not replaced.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Kept {
    /// Title of its song.
    pub song: String,
    /// Its player.
    pub player: String,
    /// Where it is now.
    pub folder: PathBuf,
}

impl Kept {
    /// Song and player that the report in `folder` names, if there is one.
    fn in_folder(folder: &Path) -> Option<Self> {
        let report: Value = serde_json::from_slice(&std::fs::read(folder.join(REPORT)).ok()?).ok()?;
        let text = |key: &str| report.get(key)?.as_str().map(str::to_string);
        Some(Self { song: text("song")?, player: text("player")?, folder: folder.to_path_buf() })
    }

    fn is_by(&self, song: &str, player: &str) -> bool {
        self.song == song && self.player == player
    }
}

/// Moves the performance in `held` to a folder that is called after `folder` and its player, if it is not of `song` by `player`. One of
/// the same song by the same player that is there already is replaced.
///
/// # Errors
/// If a file cannot be moved.
pub(crate) fn keep_another(
    held: &Path,
    folder: &Path,
    song: &str,
    player: &str,
) -> anyhow::Result<Option<Kept>> {
    let Some(found) = Kept::in_folder(held).filter(|found| !found.is_by(song, player)) else {
        return Ok(None);
    };
    let is_free = |to: &PathBuf| match Kept::in_folder(to) {
        Some(there) => there.is_by(&found.song, &found.player),
        None => files(to).is_ok_and(|names| names.is_empty()),
    };
    let named = folder.file_name().unwrap_or_default().to_string_lossy();
    let named = format!("{named}-{}", player_slug(Path::new(&found.player)));
    let numbered = (2..).map(|number| format!("{named}-{number}"));
    let to = std::iter::once(named.clone())
        .chain(numbered)
        .map(|name| folder.with_file_name(name))
        .find(is_free)
        .expect("there is no end of numbers");
    remove_files(&to)?;
    move_performance(held, &to)?;
    rename_in_report(&to.join(REPORT), folder, &to).map_err(|error| unusable(&to, error))?;
    Ok(Some(Kept { folder: to, ..found }))
}

/// A player in the name of a folder: a policy of a run by the run's folder, another one by its file.
pub fn player_slug(player: &Path) -> String {
    let is_of_run = player.file_name().is_some_and(|file| file.to_string_lossy().starts_with("policy-"));
    let named = player.parent().filter(|_| is_of_run).unwrap_or(player);
    slug(&named.file_stem().unwrap_or_default().to_string_lossy())
}

/// Gives the files in a report the folder in which they are now.
fn rename_in_report(report: &Path, from: &Path, to: &Path) -> std::io::Result<()> {
    fn rename(value: &mut Value, from: &Path, to: &Path) {
        match value {
            Value::String(text) => {
                if let Ok(name) = Path::new(text.as_str()).strip_prefix(from) {
                    *text = to.join(name).display().to_string();
                }
            }
            Value::Array(values) => values.iter_mut().for_each(|value| rename(value, from, to)),
            Value::Object(values) => values.values_mut().for_each(|value| rename(value, from, to)),
            _ => {}
        }
    }
    let mut value: Value = serde_json::from_slice(&std::fs::read(report)?)?;
    rename(&mut value, from, to);
    let text = serde_json::to_string_pretty(&value)? + "\n";
    etude_perform::write_file(report, &text).map_err(std::io::Error::other)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(folder: &Path, song: &str, player: &str) {
        std::fs::create_dir_all(folder).unwrap();
        let wav = folder.join("performance.wav");
        std::fs::write(&wav, player).unwrap();
        std::fs::write(folder.join("worlds.csv"), "of the user").unwrap();
        let report = serde_json::json!({ "song": song, "player": player, "files": { "wav": wav } });
        std::fs::write(folder.join(REPORT), report.to_string()).unwrap();
    }

    fn player_in(folder: &Path) -> Option<String> {
        Kept::in_folder(folder).map(|kept| kept.player)
    }

    #[test]
    fn another_players_performance_is_moved_and_ones_own_is_not() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("twinkle");
        write(&folder, "Twinkle", "runs/mine/policy-best.safetensors");
        let keep = |song: &str, player: &str| keep_another(&folder, &folder, song, player).unwrap();
        assert_eq!(keep("Twinkle", "runs/mine/policy-best.safetensors"), None);
        assert!(player_in(&folder).is_some());

        let kept = keep("Twinkle", "policies/twinkle.safetensors").unwrap();
        assert_eq!(kept.folder, root.path().join("twinkle-mine"));
        assert_eq!(player_in(&kept.folder).as_deref(), Some("runs/mine/policy-best.safetensors"));
        let report = std::fs::read_to_string(kept.folder.join(REPORT)).unwrap();
        assert!(report.contains("twinkle-mine/performance.wav"), "{report}");
        assert_eq!(player_in(&folder), None);
        assert!(folder.join("worlds.csv").is_file(), "not of a performance");
        assert_eq!(keep("Twinkle", "scripted"), None);

        // Another song of the same name: `Bach 1.mid` and `Bach_1.mid`.
        write(&folder, "Twinkle 2", "runs/mine/policy-best.safetensors");
        let kept = keep("Twinkle", "policies/twinkle.safetensors").unwrap();
        assert_eq!(kept.folder, root.path().join("twinkle-mine-2"));
        write(&folder, "Twinkle", "runs/mine/policy-best.safetensors");
        let kept = keep("Twinkle", "scripted").unwrap();
        assert_eq!(kept.folder, root.path().join("twinkle-mine"), "the same once more");
    }

    #[test]
    fn players_are_called_after_their_run_or_their_file() {
        let name = |player: &str| player_slug(Path::new(player));
        assert_eq!(name("runs/twinkle__fast__0/policy-best.safetensors"), "twinkle-fast-0");
        assert_eq!(name("policies/sight-reader.safetensors"), "sight-reader");
        assert_eq!(name("runs/twinkle__fast__0"), "twinkle-fast-0");
        assert_eq!(name("scripted"), "scripted");
    }
}
