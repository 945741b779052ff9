//! Results folders: a performance never replaces another one.
//!
//! ```text
//! out/twinkle/1/        the first performance
//! out/twinkle/2/        the second one
//! out/twinkle/latest    a link to the last complete one
//! ```

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use etude_music::Song;

use crate::errors::unusable;
use crate::folder::{make_folder, other_notes};

/// Name of the link to the last complete result.
pub const LATEST: &str = "latest";

/// Makes a numbered folder in `results` and calls `work` with it. If what it returns `is_complete`,
/// `latest` links to the folder from then on. After an error, a folder without a recording is
/// removed.
///
/// # Errors
/// If the folder cannot be made or linked, and as `work`.
pub(crate) fn in_new_result<T>(
    results: &Path,
    is_complete: impl FnOnce(&T) -> bool,
    work: impl FnOnce(&Path) -> anyhow::Result<T>,
) -> anyhow::Result<T> {
    let folder = new_result(results)?;
    let done = work(&folder).inspect_err(|_| {
        if !holds_recording(&folder) {
            let _ = std::fs::remove_dir_all(&folder);
            // Fails, and changes nothing, if there is something in it.
            let _ = std::fs::remove_dir(results);
        }
    })?;
    if is_complete(&done) {
        set_latest(&folder)?;
    }
    Ok(done)
}

/// Makes the folder of a new result: its number is one more than the largest in `results`.
fn new_result(results: &Path) -> anyhow::Result<PathBuf> {
    make_folder(results)?;
    let entries = std::fs::read_dir(results).map_err(|error| unusable(results, error))?;
    let numbers = entries.flatten().filter_map(|entry| number(&entry.path()));
    let mut next = numbers.max().unwrap_or(0).saturating_add(1);
    loop {
        let folder = results.join(next.to_string());
        match std::fs::create_dir(&folder) {
            Ok(()) => return Ok(folder),
            // Another process was faster.
            Err(error) if error.kind() == ErrorKind::AlreadyExists => next += 1,
            Err(error) => return Err(unusable(&folder, error)),
        }
    }
}

/// Links `latest` to a result. There is a link at every moment, if there was one before.
fn set_latest(result: &Path) -> anyhow::Result<()> {
    let name = result.file_name().expect("a numbered folder has a name");
    let link = result.with_file_name(LATEST);
    let new = result.with_file_name(format!(".{LATEST}-{}", name.to_string_lossy()));
    std::os::unix::fs::symlink(name, &new)
        .and_then(|()| std::fs::rename(&new, &link))
        .map_err(|error| unusable(&link, error))
}

/// The last complete result in `folder`; `folder` itself if it holds no results.
pub fn latest_result(folder: &Path) -> PathBuf {
    linked(folder).unwrap_or_else(|| folder.to_path_buf())
}

fn linked(folder: &Path) -> Option<PathBuf> {
    let link = folder.join(LATEST);
    Some(folder.join(std::fs::read_link(&link).ok().filter(|_| link.is_dir())?))
}

/// `path` with the number of a result in place of `latest`, which will link to another one.
pub fn numbered(path: &Path) -> PathBuf {
    path.iter().fold(PathBuf::new(), |folder, part| {
        linked(&folder).filter(|_| part == LATEST).unwrap_or_else(|| folder.join(part))
    })
}

/// Whether `folder` is a numbered result beside a `latest` link to another one.
pub fn is_other_result(folder: &Path) -> bool {
    number(folder).is_some() && folder.parent().and_then(linked).is_some_and(|latest| latest != folder)
}

/// The results in `folder`; `folder` itself if it holds none.
pub fn all_results(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut found: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    found.retain(|path| number(path).is_some() && path.is_dir());
    if found.is_empty() { vec![folder.to_path_buf()] } else { found }
}

/// `folder`, or the first of `folder-2`, `folder-3` … that is not of another song: files in several
/// folders may have one name. A run's folder and each result have the song.
pub fn folder_of_song(folder: &Path, song: &Song) -> PathBuf {
    let mut own = folder.to_path_buf();
    let mut number = 1;
    while all_results(&own).iter().any(|result| other_notes(result, song).is_some()) {
        number += 1;
        own = folder
            .with_file_name(format!("{}-{number}", folder.file_name().unwrap_or_default().to_string_lossy()));
    }
    own
}

fn number(path: &Path) -> Option<u64> {
    path.file_name()?.to_str()?.parse().ok()
}

fn holds_recording(folder: &Path) -> bool {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).any(|path| path.extension().is_some_and(|kind| kind == "mcap"))
}

#[cfg(test)]
mod tests {
    use anyhow::anyhow;

    use super::*;

    fn write(folder: &Path, text: &str) -> anyhow::Result<()> {
        Ok(std::fs::write(folder.join("run-1.mcap"), text)?)
    }

    fn read(folder: &Path) -> String {
        std::fs::read_to_string(latest_result(folder).join("run-1.mcap")).unwrap()
    }

    #[test]
    fn each_result_has_the_next_number_and_the_last_complete_one_is_the_latest() {
        let there = tempfile::tempdir().unwrap();
        let results = there.path().join("song");
        assert_eq!(latest_result(&results), results);
        for text in ["first", "second"] {
            in_new_result(&results, |()| true, |folder| write(folder, text)).unwrap();
        }
        assert_eq!((latest_result(&results), read(&results)), (results.join("2"), "second".to_string()));
        // An incomplete one and one that failed after it recorded are kept, and are not the latest.
        in_new_result(&results, |()| false, |folder| write(folder, "incomplete")).unwrap();
        let failed = in_new_result(
            &results,
            |()| true,
            |folder| {
                write(folder, "failed")?;
                Err(anyhow!("the hand does not answer"))
            },
        );
        assert_eq!(failed.unwrap_err().to_string(), "the hand does not answer");
        assert_eq!(latest_result(&results), results.join("2"));
        assert!(results.join("3/run-1.mcap").is_file() && results.join("4/run-1.mcap").is_file());
        // Numbers are not used twice, whatever was removed by hand.
        std::fs::remove_dir_all(results.join("2")).unwrap();
        in_new_result(&results, |()| true, |folder| write(folder, "new")).unwrap();
        assert_eq!(latest_result(&results), results.join("5"));
        assert_eq!(
            [1, 3, 4, 5].map(|n| is_other_result(&results.join(n.to_string()))),
            [true, true, true, false]
        );
        assert!(!is_other_result(&there.path().join("7")), "without a link there is no latest");
        assert_eq!(numbered(&results.join("latest/run-1.mcap")), results.join("5/run-1.mcap"));
        let mut all = all_results(&results);
        all.sort();
        assert_eq!(all, [1, 3, 4, 5].map(|n| results.join(n.to_string())));
    }

    #[test]
    fn a_result_without_a_recording_leaves_nothing_after_an_error() {
        let there = tempfile::tempdir().unwrap();
        let results = there.path().join("song");
        let fail = || {
            let failed: anyhow::Result<()> = in_new_result(
                &results,
                |()| true,
                |folder| {
                    std::fs::write(folder.join("reference.wav"), "sound")?;
                    Err(anyhow!("no robot"))
                },
            );
            assert!(failed.is_err());
        };
        fail();
        assert!(!results.exists());
        in_new_result(&results, |()| true, |folder| write(folder, "first")).unwrap();
        fail();
        assert_eq!(all_results(&results), [results.join("1")]);
    }

    #[test]
    fn several_processes_get_different_folders() {
        let there = tempfile::tempdir().unwrap();
        let make = || new_result(there.path()).unwrap();
        let mut made: Vec<PathBuf> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..8).map(|_| scope.spawn(make)).collect();
            threads.into_iter().map(|thread| thread.join().unwrap()).collect()
        });
        made.sort();
        made.dedup();
        assert_eq!(made.len(), 8);
    }

    #[test]
    fn a_folder_of_the_users_is_not_replaced_by_the_link() {
        let there = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(there.path().join("latest/mine")).unwrap();
        let error = in_new_result(there.path(), |()| true, |folder| write(folder, "new")).unwrap_err();
        assert!(error.to_string().contains("latest"), "{error}");
        assert_eq!(numbered(&there.path().join("latest/mine")), there.path().join("latest/mine"));
        assert!(there.path().join("latest/mine").is_dir() && there.path().join("1/run-1.mcap").is_file());
    }
}
