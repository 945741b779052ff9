//! The files of an earlier performance in the folder of a new one: a performance replaces all of them, or none.
//!
//! ```text
//! DIR/run-1.mcap …         the performance
//! DIR/earlier/             the one before, while a new one is played, or after a fault in the new one's first run
//! DIR/cut-short/           what was recorded of one that failed or was interrupted before a run ended, where an earlier one is kept
//! ```

use std::ffi::OsString;
use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::bail;
use serde_json::Value;

use crate::errors::{Interrupted, unusable};
use crate::folder::{lock, make_folder};
use crate::kept::Kept;
use crate::play::{Files, PAGE, RECORDING, REFERENCE, REPORT, write_report};
use crate::robot::{RUN_FILES, run_file};

/// Name of the folder in which the earlier performance is while a new one is played.
const EARLIER: &str = "earlier";
/// Name of the folder with what was recorded of a performance that does not replace the earlier one.
const CUT_SHORT: &str = "cut-short";

/// Whether a folder in that of a performance holds files of another one.
pub fn is_of_another_performance(folder: &Path) -> bool {
    folder.file_name().is_some_and(|name| name == EARLIER || name == CUT_SHORT)
}

/// Where the earlier performance is if the one in `folder` has ended by a fault before a run was complete.
pub fn earlier_of(folder: &Path) -> Option<PathBuf> {
    Some(folder.join(EARLIER)).filter(|earlier| files(earlier).is_ok_and(|names| !names.is_empty()))
}

/// Calls `play`, which writes the files of a performance on a robot into `folder`. Those of an earlier one are moved aside before. If `play`
/// fails or is interrupted before a run has ended they are moved back; if what was played does not count, they stay aside. An earlier one
/// that is not of `song` by `player` is moved to a folder of its own, and stays there.
pub(crate) fn replacing<T>(
    folder: &Path,
    [song, player]: [&str; 2],
    counts: impl FnOnce(&T) -> bool,
    play: impl FnOnce() -> anyhow::Result<T>,
) -> anyhow::Result<(T, Option<Kept>)> {
    make_folder(folder)?;
    let open = File::open(folder).map_err(|error| unusable(folder, error))?;
    let _lock = lock(open, "perform", folder)?;
    if folder.join(RECORDING).is_file() {
        bail!("{} holds what `etude play` has written: choose another folder with -o", folder.display());
    }
    let aside = folder.join(EARLIER);
    if !files(&aside)?.is_empty() {
        // The last performance has ended by a fault, or its process was killed.
        restore(folder, &aside)?;
    }
    let kept = Kept::moved_from(folder, song, player)?;
    let aside = kept.as_ref().map_or(aside, |kept| kept.folder.clone());
    let has_earlier = kept.is_some() || move_performance(folder, &aside)?;
    match play() {
        Ok(played) => {
            if kept.is_none() && counts(&played) {
                // If they cannot be removed, they only take up space. Videos of the earlier runs are not ours to remove.
                let _ = remove_files(&aside).and_then(|()| move_back(&aside, folder));
            }
            Ok((played, kept))
        }
        Err(error) if has_earlier => match restore(folder, &aside) {
            Ok(()) => Err(with_recording(error, &folder.join(CUT_SHORT))),
            Err(why) => {
                Err(error.context(format!("the earlier performance is in {}: {why}", aside.display())))
            }
        },
        Err(error) => {
            if !folder.join(run_file(0, "mcap")).is_file() {
                // What is there without a recording is of no use.
                let _ = remove_performance(folder);
            }
            Err(with_recording(error, folder))
        }
    }
}

/// Moves the earlier performance back from `aside`, and what has been recorded since then into the folder for that.
fn restore(folder: &Path, aside: &Path) -> anyhow::Result<()> {
    let cut_short = folder.join(CUT_SHORT);
    if folder.join(run_file(0, "mcap")).is_file() {
        remove_performance(&cut_short)?;
        move_performance(folder, &cut_short)?;
    } else {
        remove_files(folder)?;
    }
    move_back(aside, folder)
}

/// Moves what is left of a performance from `aside` back to `folder`, over what is there.
pub(crate) fn move_back(aside: &Path, folder: &Path) -> anyhow::Result<()> {
    move_performance(aside, folder)?;
    // What else is in it stays.
    let _ = std::fs::remove_dir(aside);
    Ok(())
}

/// The error of a performance that was interrupted, with the recording in `folder`, if there is one.
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

/// Names of the files of a performance in a folder, those included that `etude render` has made of its runs; none if there is no folder.
fn files(folder: &Path) -> anyhow::Result<Vec<OsString>> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let of_play = folder.join(RECORDING).is_file();
    let entries = std::fs::read_dir(folder).map_err(|error| unusable(folder, error))?;
    Ok(entries
        .flatten()
        .filter(|entry| entry.path().is_file())
        .map(|entry| entry.file_name())
        .filter(|name| is_of_a_performance(&name.to_string_lossy(), of_play))
        .collect())
}

/// Moves the files of a performance, and says whether there were some.
pub(crate) fn move_performance(from: &Path, to: &Path) -> anyhow::Result<bool> {
    let names = files(from)?;
    if names.is_empty() {
        return Ok(false);
    }
    make_folder(to)?;
    for name in &names {
        std::fs::rename(from.join(name), to.join(name)).map_err(|error| unusable(from, error))?;
    }
    // If it cannot be written, its scores are right all the same.
    let _ = rename_in_report(from, to, &names);
    Ok(true)
}

/// Names these files in the report of a performance as they are in `to`, where they have been moved.
fn rename_in_report(from: &Path, to: &Path, names: &[OsString]) -> anyhow::Result<()> {
    fn rename(value: &mut Value, moved: &impl Fn(&str) -> Option<PathBuf>) {
        match value {
            Value::String(text) => {
                if let Some(file) = moved(text) {
                    *text = file.display().to_string();
                }
            }
            Value::Array(values) => values.iter_mut().for_each(|value| rename(value, moved)),
            Value::Object(fields) => fields.values_mut().for_each(|value| rename(value, moved)),
            _ => {}
        }
    }
    let mut report: Value = serde_json::from_slice(&std::fs::read(to.join(REPORT))?)?;
    rename(&mut report, &|text| {
        let name = Path::new(text).strip_prefix(from).ok()?;
        names.iter().any(|moved| moved == name.as_os_str()).then(|| to.join(name))
    });
    write_report(to, &report)
}

/// Removes the files that a performance has written, and the pages made of them.
pub(crate) fn remove_files(folder: &Path) -> anyhow::Result<()> {
    let is_ours = |name: &OsString| {
        let kind = Path::new(name).extension().unwrap_or_default();
        !name.to_string_lossy().starts_with("run-")
            || kind == "html"
            || RUN_FILES.iter().any(|ours| kind == *ours)
    };
    for name in files(folder)?.into_iter().filter(is_ours) {
        std::fs::remove_file(folder.join(name)).map_err(|error| unusable(folder, error))?;
    }
    Ok(())
}

/// The same, and the folder if it holds nothing else.
fn remove_performance(folder: &Path) -> anyhow::Result<()> {
    remove_files(folder)?;
    let _ = std::fs::remove_dir(folder);
    Ok(())
}

/// Whether a file has the name of one that a performance, in simulation or on a robot, or the page made of it, is written to.
fn is_of_a_performance(name: &str, of_play: bool) -> bool {
    let is_of_a_run = |rest: &str| {
        let number = rest.split('.').next().unwrap_or_default();
        !number.is_empty() && number.bytes().all(|digit| digit.is_ascii_digit())
    };
    let is_of_all = [REPORT, REFERENCE, PAGE].contains(&name);
    if of_play {
        return is_of_all || Files::of_play(Path::new("")).all().any(|file| file.as_os_str() == name);
    }
    is_of_all || name.strip_prefix("run-").is_some_and(is_of_a_run)
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use anyhow::anyhow;

    use super::*;

    fn replaced<T>(folder: &Path, play: impl FnOnce() -> anyhow::Result<T>) -> anyhow::Result<T> {
        replacing(folder, ["Song", "player"], |_| true, play).map(|(played, _)| played)
    }

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

    fn text(file: PathBuf) -> String {
        std::fs::read_to_string(file).unwrap()
    }

    const OLD: [&str; 7] =
        ["mine.txt", "replay.html", "report.json", "run-1.mcap", "run-1.mp4", "run-2.mcap", "run-2.wav"];

    fn folder_with_a_performance() -> (tempfile::TempDir, PathBuf) {
        let there = tempfile::tempdir().unwrap();
        let folder = there.path().join("song");
        std::fs::create_dir(&folder).unwrap();
        write(&folder, &OLD, "old");
        (there, folder)
    }

    fn interrupted<T>() -> anyhow::Result<T> {
        Err(Interrupted("interrupted".to_string()).into())
    }

    #[test]
    fn a_performance_that_ends_replaces_all_of_an_earlier_one_and_nothing_else() {
        let (_there, folder) = folder_with_a_performance();
        replaced(&folder, || {
            write(&folder, &["run-1.mcap", "report.json"], "new");
            Ok(())
        })
        .unwrap();
        assert_eq!(names(&folder), ["mine.txt", "report.json", "run-1.mcap", "run-1.mp4"]);
        assert_eq!(text(folder.join("run-1.mcap")), "new");
    }

    #[test]
    fn one_that_is_cut_short_leaves_the_earlier_one_and_is_found_in_a_folder_of_its_own() {
        let (_there, folder) = folder_with_a_performance();
        let cut_short = folder.join("cut-short");
        std::fs::create_dir(&cut_short).unwrap();
        write(&cut_short, &["mine.txt"], "mine");
        for reason in ["first", "second"] {
            let error = replaced(&folder, || -> anyhow::Result<()> {
                write(&folder, &["run-1.mcap", "reference.wav"], reason);
                interrupted()
            })
            .unwrap_err();
            assert!(Interrupted::is_cause_of(&error));
            assert!(error.to_string().ends_with("cut-short/run-1.mcap holds what was played"), "{error}");
            assert_eq!(names(&cut_short), ["mine.txt", "reference.wav", "run-1.mcap"]);
            assert_eq!(text(cut_short.join("run-1.mcap")), reason);
            assert_eq!(text(folder.join("run-1.mcap")), "old");
        }
        // Without a recording there is nothing to keep.
        let error = replaced(&folder, || -> anyhow::Result<()> {
            write(&folder, &["reference.wav"], "third");
            interrupted()
        });
        assert!(error.is_err());
        assert_eq!(text(cut_short.join("reference.wav")), "second");
        assert_eq!(names(&folder), [&["cut-short"][..], &OLD].concat());
    }

    #[test]
    fn a_file_of_another_kind_beside_the_earlier_one_changes_nothing() {
        let (_there, folder) = folder_with_a_performance();
        std::fs::create_dir(folder.join(EARLIER)).unwrap();
        write(&folder.join(EARLIER), &["mine.html"], "mine");
        for _ in 0..2 {
            assert!(replaced(&folder, || -> anyhow::Result<()> { interrupted() }).is_err());
            assert_eq!(text(folder.join("run-1.mcap")), "old");
        }
        assert_eq!(text(folder.join("earlier/mine.html")), "mine");
    }

    #[test]
    fn two_performances_do_not_write_into_one_folder() {
        let (_there, folder) = folder_with_a_performance();
        replaced(&folder, || {
            let error = replaced(&folder, || Ok(())).unwrap_err();
            assert!(error.to_string().contains("another `etude perform` is at work"), "{error}");
            Ok(())
        })
        .unwrap();
        write(&folder, &["recording.mcap"], "of `etude play`");
        assert!(replaced(&folder, || Ok(())).unwrap_err().to_string().contains("etude play"));
    }

    #[test]
    fn after_a_kill_the_earlier_one_is_restored_and_not_mixed_with_another() {
        let (_there, folder) = folder_with_a_performance();
        move_performance(&folder, &folder.join(EARLIER)).unwrap();
        write(&folder, &["run-1.mcap"], "killed");
        let error = replaced(&folder, || -> anyhow::Result<()> {
            assert_eq!(text(folder.join("earlier/run-1.mcap")), "old");
            assert_eq!(text(folder.join("cut-short/run-1.mcap")), "killed");
            interrupted()
        });
        assert!(error.is_err());
        assert_eq!(text(folder.join("run-1.mcap")), "old");
        assert_eq!(names(&folder), [&["cut-short"][..], &OLD].concat());
    }

    /// What the robot says comes first, whatever happens to files.
    #[test]
    fn an_error_is_not_hidden_by_one_of_the_files() {
        let (_there, folder) = folder_with_a_performance();
        write(&folder, &["cut-short"], "a file");
        let error = replaced(&folder, || -> anyhow::Result<()> {
            write(&folder, &["run-1.mcap"], "new");
            Err(Interrupted("use the hardware stop".to_string()).into())
        })
        .unwrap_err();
        assert!(Interrupted::is_cause_of(&error));
        assert!(format!("{error:#}").ends_with("use the hardware stop"), "{error:#}");
        assert!(error.to_string().contains("the earlier performance is in "), "{error:#}");
        assert_eq!(text(folder.join("earlier/run-1.mcap")), "old");
    }

    #[test]
    fn without_an_earlier_one_everything_stays_where_it_was_written() {
        let there = tempfile::tempdir().unwrap();
        let folder = there.path().join("song");
        let error = replaced(&folder, || -> anyhow::Result<()> {
            write(&folder, &["run-1.mcap"], "new");
            Err(anyhow!("the hand does not answer"))
        })
        .unwrap_err();
        assert_eq!(error.to_string(), "the hand does not answer");
        assert_eq!((names(&folder), names(there.path())), (vec!["run-1.mcap".into()], vec!["song".into()]));
    }
}
