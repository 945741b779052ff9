//! Learning from the robot itself: a song is played again and again in joint mirroring or in hybrid
//! execution. What the joints missed in one run corrects their set-points in the next, and keys
//! that sounded too short, or not, or beside the right one, move the targets of the fingers. No
//! simulator is fitted and no policy is trained.
//!
//! ```text
//! DIR/adaptation.json    the configuration
//! DIR/run-NN/N/          a run: run-1.mcap and the scores
//! DIR/run-NN/adapted.json  its result and what the next run plays; written last
//! DIR/performance/N/     the performances with the correction of the best run
//! DIR/correction.json    that correction, for `etude perform --correction`
//! DIR/result.json        the scores; written last
//! ```
//!
//! A complete part is not made again, so the same command resumes an adaptation that was stopped at
//! any point.

mod corrections;

use std::path::{Path, PathBuf};

use anyhow::bail;
use etude_music::Song;
use etude_perform::session::RigChoice;
use etude_perform::stats::mean;
use etude_perform::{Job, Mode};
use etude_stage::RAIL;
use serde::{Deserialize, Serialize};

use crate::correction::{CorrectionFile, OnlyFor};
use crate::folder::make_folder;
use crate::json_files::{load, save};
use crate::loaded_player::{LoadedPlayer, load_player};
use crate::play::REFERENCE;
use crate::results::latest_result;
use crate::robot::{RobotPlay, RobotReport, RobotScores, RobotStep, all_complete, play_on_robot, run_file};
use crate::song_planner::SongPlanner;
use corrections::{MEASURING, Notes, RunCorrections};

/// Name of the file with the result of an adaptation.
const RESULT: &str = "result.json";
/// Name of the file with its configuration.
const CONFIG: &str = "adaptation.json";
/// Version of the files, and of what is learned from a run. An adaptation is not continued by
/// another one.
const VERSION: u32 = 5;
/// An adaptation ends earlier if this many runs in a row were not better than the best before.
const MAX_RUNS_WITHOUT_GAIN: usize = 8;

/// What to adapt, and for how long.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AdaptConfig {
    /// The policy.
    pub policy: PathBuf,
    /// Joint mirroring or hybrid: the robot follows simulated joints.
    pub mode: Mode,
    /// How long is played to learn, min, but at least three runs. Homing and the performances at
    /// the end are not counted. More may be given later.
    pub minutes: f64,
    /// Performances at the end.
    pub runs: usize,
    /// Seed of the twin's noise.
    pub seed: u64,
}

/// The content of `adaptation.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct ConfigFile {
    version: u32,
    config: AdaptConfig,
    only_for: OnlyFor,
}

/// The result of one run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AdaptRun {
    /// Its scores.
    #[serde(flatten)]
    pub scores: RobotScores,
    /// What the finger joints missed of their path, moved by the key corrections, root mean square,
    /// rad.
    pub fingers_missed_rad: f64,
    /// What the rail missed of its path, m.
    pub rail_missed_m: f64,
    /// Set-points that the limiter clamped, counted by joint.
    pub clamped: u64,
}

/// A run as it is stored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct StoredRun {
    #[serde(flatten)]
    run: AdaptRun,
    next: RunCorrections,
}

/// The result of an adaptation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Adapted {
    /// The runs, from before any correction.
    pub adapting: Vec<AdaptRun>,
    /// Which of them was the best with those beside it, from 0.
    pub best: usize,
    /// Scores of the performances with its correction.
    #[serde(flatten)]
    pub scores: RobotScores,
    /// The mode.
    pub mode: Mode,
    /// The correction, for `etude perform --correction`.
    pub correction: PathBuf,
}

/// What an adaptation reports.
#[derive(Clone, Debug)]
pub enum AdaptStep {
    /// A run while learning; its number from 0, and the most that there will be.
    Adapting(usize, usize, AdaptRun),
    /// A run of the performances with the best correction.
    Performing(RobotStep),
}

/// Adapts the playing of `song` to a robot, in `folder`, or resumes there.
///
/// # Errors
/// If any part fails; what is complete is kept. [`Interrupted`](crate::Interrupted) if the job is
/// interrupted.
pub fn adapt_on_robot(
    song: &Song,
    rig: &RigChoice,
    config: &AdaptConfig,
    folder: &Path,
    job: &mut Job<'_, AdaptStep>,
) -> anyhow::Result<Adapted> {
    let player = load_player(&config.policy)?;
    let only_for = OnlyFor::new(song, rig, &player)?;
    let adaptation = Adaptation { song, rig, config, folder, player, only_for };
    adaptation.open()?;
    if let Some(done) = load::<Adapted>(&folder.join(RESULT))? {
        return Ok(done);
    }
    let mut planner = SongPlanner::default();
    let runs = adaptation.learn(&mut planner, job)?;
    adaptation.finish(&runs, &mut planner, job)
}

/// What an adaptation of this policy in `folder` has learned, if one is complete there.
///
/// # Errors
/// If its files cannot be read.
pub fn adapted_before(folder: &Path, policy: &Path) -> anyhow::Result<Option<Adapted>> {
    let opened = load::<ConfigFile>(&folder.join(CONFIG))?;
    if opened.is_none_or(|opened| opened.version != VERSION || opened.config.policy != policy) {
        return Ok(None);
    }
    load(&folder.join(RESULT))
}

struct Adaptation<'a> {
    song: &'a Song,
    rig: &'a RigChoice,
    config: &'a AdaptConfig,
    folder: &'a Path,
    player: LoadedPlayer,
    only_for: OnlyFor,
}

impl Adaptation<'_> {
    /// Makes the folder, or checks that it holds the same adaptation.
    fn open(&self) -> anyhow::Result<()> {
        let file = self.folder.join(CONFIG);
        let now =
            ConfigFile { version: VERSION, config: self.config.clone(), only_for: self.only_for.clone() };
        if let Some(before) = load::<ConfigFile>(&file)? {
            // The minutes may change, and then the result is another.
            let has_other_minutes = before.config.minutes != self.config.minutes;
            let config = AdaptConfig { minutes: self.config.minutes, ..before.config.clone() };
            if (ConfigFile { config, ..before }) != now {
                bail!(
                    "{} holds the adaptation of another policy, song, robot or mode, another number of runs or seed, or another \
                     version of Étude: remove it, and learning begins from the start",
                    self.folder.display()
                );
            }
            if has_other_minutes {
                // It may be missing.
                let _ = std::fs::remove_file(self.folder.join(RESULT));
            }
        }
        make_folder(self.folder)?;
        save(&file, &now)
    }

    /// All runs, each with what it played: those that are there already, and the others.
    fn learn(
        &self,
        planner: &mut SongPlanner<'_>,
        job: &mut Job<'_, AdaptStep>,
    ) -> anyhow::Result<Vec<(RunCorrections, AdaptRun)>> {
        let most = (60.0 * self.config.minutes / self.song.duration_secs()).floor() as usize;
        let most = most.max(MEASURING + 1);
        let (mut runs, mut next) = (Vec::new(), RunCorrections::default());
        while runs.len() < most && best(&runs) + MAX_RUNS_WITHOUT_GAIN >= runs.len() {
            let index = runs.len();
            let folder = self.folder.join(format!("run-{:02}", index + 1));
            let stored = match load::<StoredRun>(&folder.join("adapted.json"))? {
                Some(stored) => stored,
                None => self.learn_once(index, &next, &folder, planner, job)?,
            };
            job.report(&AdaptStep::Adapting(index, most, stored.run));
            runs.push((next, stored.run));
            next = stored.next;
            if best(&runs) + 1 == runs.len() {
                // So that it is there if the robot stops itself.
                self.keep(&runs[index].0)?;
            }
        }
        Ok(runs)
    }

    /// Plays once, and learns from it.
    fn learn_once(
        &self,
        index: usize,
        played: &RunCorrections,
        folder: &Path,
        planner: &mut SongPlanner<'_>,
        job: &mut Job<'_, AdaptStep>,
    ) -> anyhow::Result<StoredRun> {
        let seed = 1000 + index as u64;
        let report =
            self.play(played, (1, seed), folder, planner, &mut Job::new(&mut |_| {}, job.interrupt()))?;
        // There are many runs. `etude replay` makes the sound again from a recording.
        for sound in [run_file(0, "wav"), REFERENCE.to_string()] {
            // If it cannot be removed, it only takes up space.
            let _ = std::fs::remove_file(latest_result(folder).join(sound));
        }
        let run = &report.runs[0];
        let notes = Notes {
            strokes: &run.strokes,
            latency_compensation_secs: report.scores.latency_compensation_secs,
            on_time_secs: report.scores.on_time_compensation_secs(),
        };
        let next = played.after(index, &run.tracking, &notes, self.player.config.task.stage.side);
        let common_lag_secs = played.delays.or(next.delays).map_or(0.0, |delays| delays.common_lag_secs);
        let tracking = run.tracking.clone().asked_for(&played.key_offsets);
        let squares: f64 = (0..RAIL).map(|joint| tracking.error(joint, common_lag_secs).powi(2)).sum();
        let run = AdaptRun {
            scores: report.scores,
            fingers_missed_rad: (squares / RAIL as f64).sqrt(),
            rail_missed_m: tracking.error(RAIL, common_lag_secs),
            clamped: run.clamped,
        };
        let stored = StoredRun { run, next };
        save(&folder.join("adapted.json"), &stored)?;
        Ok(stored)
    }

    /// Plays with the correction of the best run as often as was asked for, and writes the result.
    fn finish(
        &self,
        runs: &[(RunCorrections, AdaptRun)],
        planner: &mut SongPlanner<'_>,
        job: &mut Job<'_, AdaptStep>,
    ) -> anyhow::Result<Adapted> {
        let best = best(runs);
        let (played, _) = &runs[best];
        let correction = self.keep(played)?;
        let folder = self.folder.join("performance");
        let runs_and_seed = (self.config.runs, 0);
        let report = job.part(
            |step: &RobotStep| AdaptStep::Performing(step.clone()),
            |job| self.play(played, runs_and_seed, &folder, planner, job),
        )?;
        let done = Adapted {
            adapting: runs.iter().map(|(_, run)| *run).collect(),
            best,
            scores: report.scores,
            mode: report.mode,
            correction,
        };
        save(&self.folder.join(RESULT), &done)?;
        Ok(done)
    }

    /// The latency compensation of a run, s.
    fn latency_compensation_secs(&self, played: &RunCorrections) -> f64 {
        played
            .latency_compensation_secs
            .unwrap_or(self.player.config.task.key_schedule.latency_compensation_secs)
    }

    /// Writes the correction of a run for `etude perform`, and returns its file.
    fn keep(&self, played: &RunCorrections) -> anyhow::Result<PathBuf> {
        let file = self.folder.join("correction.json");
        let content = CorrectionFile {
            song: self.song.title().to_string(),
            only_for: self.only_for.clone(),
            policy: self.config.policy.clone(),
            mode: self.config.mode,
            latency_compensation_secs: self.latency_compensation_secs(played),
            correction: played.added(),
        };
        save(&file, &content)?;
        Ok(file)
    }

    /// Plays this a number of times, with this seed on top of the adaptation's.
    fn play(
        &self,
        played: &RunCorrections,
        (runs, seed): (usize, u64),
        folder: &Path,
        planner: &mut SongPlanner<'_>,
        job: &mut Job<'_, RobotStep>,
    ) -> anyhow::Result<RobotReport> {
        let mut player = self.player.clone();
        player.config.task.key_schedule.latency_compensation_secs = self.latency_compensation_secs(played);
        let play = RobotPlay {
            runs,
            seed: self.config.seed.wrapping_add(seed),
            correction: Some(played.added()),
            ..RobotPlay::new(self.song, &player, self.rig, self.config.mode)
        };
        let report = play_on_robot(&play, Some(folder), planner, job);
        all_complete(report, job.is_interrupted(), "adapting")
    }
}

/// The best run, the earlier one of equals. The score of one run is noisy, so a run is rated by the
/// mean of its score and those beside it.
fn best(runs: &[(RunCorrections, AdaptRun)]) -> usize {
    let scores: Vec<f64> = runs.iter().map(|(_, run)| run.scores.overall()).collect();
    let rated: Vec<f64> = (0..scores.len())
        .map(|index| mean(&scores[index.saturating_sub(1)..scores.len().min(index + 2)]))
        .collect();
    (0..rated.len()).reduce(|best, index| if rated[index] > rated[best] { index } else { best }).unwrap_or(0)
}
