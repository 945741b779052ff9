//! The Slurm launcher: a job array over the lines of a plan. It contains nothing specific to a
//! site: partition, account and memory are given as options of `sbatch`.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{anyhow, bail};
use etude_lab::slug;
use etude_perform::{shell_word, write_file};

use crate::outcome::{RESULT, TrialState};
use crate::trial::Trial;

/// How a plan goes through Slurm.
#[derive(Clone, Debug)]
pub struct SlurmConfig {
    /// The `etude` program, as the nodes see it.
    pub program: PathBuf,
    /// Trials that run at once at most.
    pub throttle: Option<usize>,
    /// Time limit of a trial, as Slurm writes it.
    pub time: String,
    /// Cores of a trial.
    pub cpus: usize,
    /// More options of `sbatch`, as they stand.
    pub options: Vec<String>,
}

/// Seconds before the time limit at which a trial receives the signal to save its state.
const GRACE_SECS: u32 = 120;

/// The lines of the plan whose trials are not done, each work once.
pub fn open_trials(trials: &[Trial], runs: &Path) -> Vec<usize> {
    let mut seen = std::collections::BTreeSet::new();
    let open = |trial: &Trial| !runs.join(&trial.id).join(RESULT).is_file();
    let waiting = |trial: &Trial| open(trial) && TrialState::of(trial, runs) != TrialState::Running;
    let numbered = trials.iter().enumerate();
    numbered
        .filter(|(_, trial)| seen.insert(trial.id.as_str()) && waiting(trial))
        .map(|(index, _)| index)
        .collect()
}

/// The batch script for these lines of a plan. Paths are absolute; `folder` is where it runs.
pub fn slurm_script(
    name: &str,
    plan: &Path,
    runs: &Path,
    folder: &Path,
    indices: &[usize],
    config: &SlurmConfig,
) -> String {
    let throttle = config.throttle.map_or_else(String::new, |most| format!("%{most}"));
    let options: String = config.options.iter().map(|option| format!("#SBATCH {option}\n")).collect();
    format!(
        r#"#!/bin/bash
#SBATCH --job-name=etude-{name}
#SBATCH --array={array}{throttle}
#SBATCH --cpus-per-task={cpus}
#SBATCH --time={time}
#SBATCH --signal=B:USR1@{GRACE_SECS}
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --output={logs}
#SBATCH --chdir={folder}
{options}
# {GRACE_SECS} s before the time limit Slurm sends USR1: the trial saves its state, ends with 3 and is requeued. After TERM the trial saves its
# state and is not requeued; the same command of `etude experiment run` submits it again.
again=
trap 'again=1; kill -TERM "$trial"' USR1
trap 'kill -TERM "$trial"' TERM
export RAYON_NUM_THREADS="$SLURM_CPUS_PER_TASK"
{program} experiment trial {plan} "$SLURM_ARRAY_TASK_ID" --runs-dir {runs} --threads "$SLURM_CPUS_PER_TASK" &
trial=$!
wait "$trial"
code=$?
# A signal ends `wait`, not the trial.
while kill -0 "$trial" 2>/dev/null; do
    wait "$trial"
    code=$?
done
if [ -n "$again" ] && [ "$code" -ne 0 ]; then
    scontrol requeue "${{SLURM_ARRAY_JOB_ID}}_$SLURM_ARRAY_TASK_ID"
fi
exit "$code"
"#,
        name = slug(name),
        array = ranges(indices),
        cpus = config.cpus,
        time = config.time,
        logs = shell_word(escaped(&plan.with_extension("slurm")).join("%A_%a.log").display()),
        folder = shell_word(folder.display()),
        program = shell_word(config.program.display()),
        plan = shell_word(plan.display()),
        runs = shell_word(runs.display()),
    )
}

/// Writes the script beside the plan and submits it; returns the id of the job.
///
/// # Errors
/// If a file cannot be written, there is no Slurm, or it refuses.
pub fn submit(script: &str, plan: &Path) -> anyhow::Result<String> {
    let file = plan.with_extension("sbatch");
    std::fs::create_dir_all(plan.with_extension("slurm"))?;
    write_file(&file, script)?;
    let output = Command::new("sbatch").arg("--parsable").arg(&file).output().map_err(|error| {
        anyhow!(
            "cannot run sbatch: {error}; is this a node of a cluster? `--launcher local` runs the trials here, `--dry-run` shows the script"
        )
    })?;
    if !output.status.success() {
        bail!(
            "sbatch refused the job: {}; correct the options with --sbatch, or look at the script with --dry-run",
            String::from_utf8_lossy(&output.stderr).trim()
        );
    }
    Ok(String::from_utf8_lossy(&output.stdout).trim().to_string())
}

/// `0-3,5` for 0, 1, 2, 3 and 5.
fn ranges(indices: &[usize]) -> String {
    let range = |run: &[usize]| match run {
        [first, .., last] => format!("{first}-{last}"),
        _ => run[0].to_string(),
    };
    indices.chunk_by(|a, b| a + 1 == *b).map(range).collect::<Vec<_>>().join(",")
}

/// The path with each `%` doubled, because Slurm replaces patterns that begin with `%`.
fn escaped(path: &Path) -> PathBuf {
    PathBuf::from(path.display().to_string().replace('%', "%%"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_told_in_ranges() {
        assert_eq!(ranges(&[0, 1, 2, 3, 5, 7, 8]), "0-3,5,7-8");
        assert_eq!(ranges(&[4]), "4");
    }

    #[test]
    fn a_script_asks_for_what_it_is_told_and_takes_any_path() {
        let config = SlurmConfig {
            program: PathBuf::from("/opt/my tools/etude"),
            throttle: Some(4),
            time: "02:00:00".to_string(),
            cpus: 2,
            options: vec!["--partition=short".to_string()],
        };
        let text = slurm_script(
            "songs",
            Path::new("/data/runs/songs.plan.jsonl"),
            Path::new("/data/runs"),
            Path::new("/data"),
            &[0, 1, 4],
            &config,
        );
        for line in [
            "#SBATCH --array=0-1,4%4",
            "#SBATCH --cpus-per-task=2",
            "#SBATCH --time=02:00:00",
            "#SBATCH --signal=B:USR1@120",
            "#SBATCH --requeue",
            "#SBATCH --partition=short",
            "#SBATCH --chdir=/data",
        ] {
            assert!(text.lines().any(|other| other == line), "{line} is missing in\n{text}");
        }
        assert!(
            text.contains("'/opt/my tools/etude' experiment trial /data/runs/songs.plan.jsonl"),
            "{text}"
        );
    }
}
