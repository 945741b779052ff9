//! The files of an earlier performance in the folder of a new one: a performance replaces all of them, or none.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use crate::errors::{Interrupted, unusable};
use crate::folder::make_folder;
use crate::play::{PAGE, REFERENCE, REPORT};
use crate::robot::run_file;

/// Calls `play`, which writes the files of a performance on a robot into `folder`. Those of an earlier one are moved aside before. If `play`
/// fails or is interrupted they are moved back, and what it has recorded is moved into a folder beside `folder`.
pub(crate) fn replacing<T>(folder: &Path, play: impl FnOnce() -> anyhow::Result<T>) -> anyhow::Result<T> {
    make_folder(folder)?;
    // It is seen: if the process is killed, the earlier performance is found there.
    let aside = folder.join(format!("earlier-{}", std::process::id()));
    let has_earlier = move_performance(folder, &aside)?;
    match play() {
        Ok(played) => {
            if has_earlier {
                std::fs::remove_dir_all(&aside).map_err(|error| unusable(&aside, error))?;
            }
            Ok(played)
        }
        Err(error) if has_earlier => {
            let beside = beside(folder);
            // One that was cut short before is replaced, also by one of which there is nothing to hear.
            let _ = std::fs::remove_dir_all(&beside);
            let is_recorded = folder.join(run_file(0, "mcap")).is_file();
            move_performance(folder, &beside)?;
            if !is_recorded {
                let _ = std::fs::remove_dir_all(&beside);
            }
            move_performance(&aside, folder)?;
            std::fs::remove_dir(&aside).map_err(|error| unusable(&aside, error))?;
            Err(with_recording(error, &beside))
        }
        Err(error) => Err(with_recording(error, folder)),
    }
}

/// The folder beside `folder` for a performance that was cut short.
fn beside(folder: &Path) -> PathBuf {
    let mut name = folder.file_name().map_or_else(|| OsString::from("performance"), OsString::from);
    name.push("-cut-short");
    folder.with_file_name(name)
}

/// The error of a performance, with the recording in `folder`, if there is one.
fn with_recording(error: anyhow::Error, folder: &Path) -> anyhow::Error {
    let recording = folder.join(run_file(0, "mcap"));
    match error.downcast::<Interrupted>() {
        Ok(Interrupted(why)) if recording.is_file() => {
            Interrupted(format!("{why}; {} holds what was played", recording.display())).into()
        }
        Ok(interrupted) => interrupted.into(),
        Err(error) => error,
    }
}

/// Moves the files of a performance, and says whether there were some.
fn move_performance(from: &Path, to: &Path) -> anyhow::Result<bool> {
    let entries = std::fs::read_dir(from).map_err(|error| unusable(from, error))?;
    let names: Vec<OsString> = entries
        .flatten()
        .filter(|entry| entry.path().is_file())
        .map(|entry| entry.file_name())
        .filter(|name| is_of_a_performance(&name.to_string_lossy()))
        .collect();
    if names.is_empty() {
        return Ok(false);
    }
    make_folder(to)?;
    for name in &names {
        std::fs::rename(from.join(name), to.join(name)).map_err(|error| unusable(from, error))?;
    }
    Ok(true)
}

/// Whether a file has the name of one that a performance, or the page made of it, is written to.
fn is_of_a_performance(name: &str) -> bool {
    let is_of_a_run = |rest: &str| {
        let number = rest.split('.').next().unwrap_or_default();
        !number.is_empty() && number.bytes().all(|digit| digit.is_ascii_digit())
    };
    [REPORT, REFERENCE, PAGE].contains(&name) || name.strip_prefix("run-").is_some_and(is_of_a_run)
}

#[cfg(test)]
mod tests {
    use anyhow::anyhow;

    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let mut names: Vec<String> = entries.map(|entry| entry.file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    fn write(folder: &Path, names: &[&str], text: &str) {
        for name in names {
            std::fs::write(folder.join(name), text).unwrap();
        }
    }

    fn folder_with_a_performance() -> (tempfile::TempDir, PathBuf) {
        let there = tempfile::tempdir().unwrap();
        let folder = there.path().join("song");
        std::fs::create_dir(&folder).unwrap();
        write(
            &folder,
            &["run-1.mcap", "run-2.mcap", "run-2.wav", "report.json", "replay.html", "mine.txt"],
            "old",
        );
        (there, folder)
    }

    #[test]
    fn a_performance_that_ends_replaces_all_of_an_earlier_one_and_nothing_else() {
        let (_there, folder) = folder_with_a_performance();
        replacing(&folder, || {
            write(&folder, &["run-1.mcap", "report.json"], "new");
            Ok(())
        })
        .unwrap();
        assert_eq!(names(&folder), ["mine.txt", "report.json", "run-1.mcap"]);
        assert_eq!(std::fs::read_to_string(folder.join("run-1.mcap")).unwrap(), "new");
    }

    #[test]
    fn one_that_is_cut_short_leaves_the_earlier_one_and_is_found_beside_it() {
        let (_there, folder) = folder_with_a_performance();
        let before = names(&folder);
        for reason in ["first", "second"] {
            let error = replacing(&folder, || -> anyhow::Result<()> {
                write(&folder, &["run-1.mcap", "reference.wav"], reason);
                Err(Interrupted("interrupted".to_string()).into())
            })
            .unwrap_err();
            assert!(Interrupted::is_cause_of(&error));
            assert!(
                error.to_string().ends_with("song-cut-short/run-1.mcap holds what was played"),
                "{error}"
            );
            assert_eq!(names(&folder), before);
            assert_eq!(std::fs::read_to_string(folder.join("run-1.mcap")).unwrap(), "old");
            let beside = folder.with_file_name("song-cut-short");
            assert_eq!(names(&beside), ["reference.wav", "run-1.mcap"]);
            assert_eq!(std::fs::read_to_string(beside.join("run-1.mcap")).unwrap(), reason);
        }
        let error = replacing(&folder, || -> anyhow::Result<()> {
            write(&folder, &["reference.wav"], "new");
            Err(Interrupted("interrupted".to_string()).into())
        });
        assert_eq!(error.unwrap_err().to_string(), "interrupted");
        assert_eq!((names(&folder), names(folder.parent().unwrap())), (before, vec!["song".into()]));
    }

    #[test]
    fn without_an_earlier_one_everything_stays_where_it_was_written() {
        let there = tempfile::tempdir().unwrap();
        let folder = there.path().join("song");
        let error = replacing(&folder, || -> anyhow::Result<()> {
            write(&folder, &["run-1.mcap"], "new");
            Err(anyhow!("the hand does not answer"))
        })
        .unwrap_err();
        assert_eq!(error.to_string(), "the hand does not answer");
        assert_eq!((names(&folder), names(there.path())), (vec!["run-1.mcap".into()], vec!["song".into()]));
    }
}
