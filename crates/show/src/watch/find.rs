//! The runs in the folders that the user names.

use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use anyhow::bail;
use etude_lab::{CONFIG, SONG};
use etude_perform::shell_word;
use walkdir::WalkDir;

use super::METRICS;

/// Older runs in a folder are left out.
const RECENT: Duration = Duration::from_secs(24 * 3600);
/// Folders between one that is named and a run in it: `runs/TASK/rehearsal/iteration-1/training`,
/// and one more.
const DEPTH: usize = 5;

/// The runs in `folders`. One that is a run itself, or an experiment's task with a `training`,
/// means that run; any other means the runs in it that were written to in the day before `now`, the
/// last one first, at most `most` of them.
///
/// # Errors
/// If a folder is missing, holds no run, or none that is recent.
pub fn find_runs(folders: &[PathBuf], most: usize, now: SystemTime) -> anyhow::Result<Vec<PathBuf>> {
    let mut runs: Vec<PathBuf> = Vec::new();
    for folder in folders {
        if !folder.is_dir() {
            bail!(
                "there is no folder {}; name a run's folder, or start a training with `etude train SONG`",
                folder.display()
            );
        }
        let itself = [folder.clone(), folder.join("training")].into_iter().find(|folder| is_run(folder));
        let found = match itself {
            Some(run) => vec![run],
            None => recent(folder, most, now)?,
        };
        let unknown: Vec<_> = found.into_iter().filter(|run| !runs.contains(run)).collect();
        runs.extend(unknown);
    }
    Ok(runs)
}

/// When the run in `folder` was last written to.
pub(super) fn written(folder: &Path) -> Option<SystemTime> {
    let time = |name: &str| folder.join(name).metadata().and_then(|data| data.modified()).ok();
    time(METRICS).or_else(|| time(CONFIG))
}

fn is_run(folder: &Path) -> bool {
    let is_file = |name: &str| folder.join(name).is_file();
    is_file(CONFIG) && (is_file(METRICS) || is_file(SONG))
}

/// Every run in `folder`, with the time at which it was last written to, the last one first.
pub fn runs_in(folder: &Path) -> Vec<(SystemTime, PathBuf)> {
    let mut runs = Vec::new();
    let mut below = WalkDir::new(folder).min_depth(1).max_depth(DEPTH).into_iter();
    while let Some(entry) = below.next() {
        // A folder that cannot be read holds no run that is being written.
        let Ok(entry) = entry else { continue };
        if entry.file_type().is_dir() && is_run(entry.path()) {
            below.skip_current_dir();
            runs.extend(written(entry.path()).map(|time| (time, entry.into_path())));
        }
    }
    // The path decides between equals, so that the order is always the same.
    runs.sort_by(|a, b| b.cmp(a));
    runs
}

fn recent(folder: &Path, most: usize, now: SystemTime) -> anyhow::Result<Vec<PathBuf>> {
    let mut runs = runs_in(folder);
    let Some((_, latest)) = runs.first().cloned() else {
        bail!(
            "{} holds no run; name a run's folder, or start one there with `etude train SONG -o {}`",
            folder.display(),
            shell_word(folder.join("NAME").display())
        );
    };
    // Where the file system's clock is ahead of ours, times lie in the future; they are recent too.
    runs.retain(|(time, _)| now.duration_since(*time).map_or(true, |age| age <= RECENT));
    runs.truncate(most);
    if runs.is_empty() {
        bail!(
            "none of the runs in {} was written to in the last day; name the one to watch, for example {}",
            folder.display(),
            latest.display()
        );
    }
    Ok(runs.into_iter().map(|(_, run)| run).collect())
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use super::*;

    /// A run whose last row is so many hours old.
    fn write_run(folder: &Path, hours: u64, now: SystemTime) {
        std::fs::create_dir_all(folder).unwrap();
        std::fs::write(folder.join(CONFIG), "").unwrap();
        let file = File::create(folder.join(METRICS)).unwrap();
        file.set_modified(now - Duration::from_secs(hours * 3600)).unwrap();
    }

    #[test]
    fn runs_are_found_where_they_lie() {
        let now = SystemTime::now();
        let folder = tempfile::tempdir().unwrap();
        let runs = folder.path().join("runs");
        let find = |paths: &[&str], most| {
            let folders: Vec<_> = paths.iter().map(|path| folder.path().join(path)).collect();
            let found = find_runs(&folders, most, now)?;
            anyhow::Ok(
                found
                    .iter()
                    .map(|run| run.strip_prefix(folder.path()).unwrap().display().to_string())
                    .collect::<Vec<_>>(),
            )
        };
        let message = |found: anyhow::Result<Vec<String>>| found.unwrap_err().to_string();
        assert!(message(find(&["runs"], 9)).contains("there is no folder"));
        std::fs::create_dir_all(&runs).unwrap();
        assert!(message(find(&["runs"], 9)).contains("holds no run"));
        write_run(&runs.join("old"), 30, now);
        let said = message(find(&["runs"], 9));
        assert!(said.contains("none of the runs in") && said.contains("runs/old"), "{said}");

        write_run(&runs.join("a"), 2, now);
        write_run(&runs.join("task/training"), 1, now);
        write_run(&runs.join("task/training/checkpoints/none"), 0, now);
        write_run(&runs.join("deep/rehearsal/iteration-1/training"), 3, now);
        let all = ["runs/task/training", "runs/a", "runs/deep/rehearsal/iteration-1/training"];
        assert_eq!(find(&["runs"], 9).unwrap(), all);
        assert_eq!(find(&["runs"], 2).unwrap(), all[..2]);
        // A run that is named itself is shown however old it is; no run is shown twice.
        assert_eq!(find(&["runs/old", "runs/task", "runs"], 1).unwrap(), ["runs/old", "runs/task/training"]);
    }
}
