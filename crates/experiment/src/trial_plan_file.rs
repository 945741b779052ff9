//! A plan as a file: one trial a line, as JSON.

use std::io::BufRead as _;
use std::path::{Path, PathBuf};

use anyhow::anyhow;
use etude_lab::slug;
use etude_learn::seed::fnv;
use etude_perform::write_file;

use crate::trial::{Trial, json};

/// Characters of a plan's name at most: a plan of all experiments would have a long one.
const MAX_NAME_LEN: usize = 64;

/// Where a plan lies. Its name ends with a fingerprint: another plan of the experiment never
/// replaces one whose lines are being worked on.
pub fn plan_file(runs: &Path, name: &str, trials: &[Trial]) -> PathBuf {
    let name: String = slug(name).chars().take(MAX_NAME_LEN).collect();
    runs.join(format!("{name}-{:08x}.plan.jsonl", fnv(plan_text(trials).as_bytes()) as u32))
}

/// The text of a plan.
pub fn plan_text(trials: &[Trial]) -> String {
    trials.iter().map(|trial| json(trial) + "\n").collect()
}

/// Writes a plan into its folder, which is made.
///
/// # Errors
/// If the folder cannot be made or the file not written.
pub fn write_plan(path: &Path, trials: &[Trial]) -> anyhow::Result<()> {
    let runs = path.parent().unwrap_or(Path::new(""));
    std::fs::create_dir_all(runs).map_err(|error| {
        anyhow!("cannot create {}: {error}; choose another folder with --runs-dir", runs.display())
    })?;
    Ok(write_file(path, &plan_text(trials))?)
}

/// Reads a plan.
///
/// # Errors
/// If the file is missing or is not a plan.
pub fn read_plan(path: &Path) -> anyhow::Result<Vec<Trial>> {
    let fail = |why: String| {
        anyhow!("cannot read the plan {}: {why}; make it again with `etude experiment run`", path.display())
    };
    let file = std::fs::File::open(path).map_err(|error| fail(error.to_string()))?;
    let lines = std::io::BufReader::new(file).lines().enumerate();
    lines
        .map(|(index, line)| {
            let line = line.map_err(|error| fail(error.to_string()))?;
            serde_json::from_str(&line).map_err(|error| fail(format!("line {}: {error}", index + 1)))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trial_plan::ExperimentConfig;
    use crate::trial_plan::tests::{MINE, plan};

    #[test]
    fn another_plan_has_another_file() {
        let trials = plan(MINE, &ExperimentConfig::default());
        let file = |trials: &[Trial]| plan_file(Path::new("runs"), "my plan", trials);
        assert_eq!(file(&trials), file(&trials));
        assert_ne!(file(&trials), file(&trials[1..]));
        assert!(file(&trials).display().to_string().starts_with("runs/my-plan-"));
    }

    #[test]
    fn a_plan_comes_back_from_its_file_and_a_damaged_one_says_where() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plan.jsonl");
        let trials = plan(MINE, &ExperimentConfig::default());
        write_plan(&path, &trials).unwrap();
        assert_eq!(read_plan(&path).unwrap(), trials);
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, text.replacen("labels", "lables", 2)).unwrap();
        assert!(read_plan(&path).unwrap_err().to_string().contains("line 1"));
    }
}
