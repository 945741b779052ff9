//! Robustness: how well a policy plays in a fixed set of worlds, where the simulator's parameters
//! are off.
//!
//! A policy plays best in the nominal world, since it was trained in it. The worlds are a Latin
//! hypercube over the widths of the policy's own randomisation
//! ([`etude_task::Randomisation::grid`]), the same for the same seed, so that policies are compared
//! in the same worlds; their worst tenth says more about a robot than their mean (a judgement).

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use etude_music::Song;
use etude_perform::stats::{mean, sorted};
use etude_perform::{PerformError, Performance, Scores, SimRig, perform, write_file};
use etude_stage::PhysicalParams;
use etude_task::{Randomisation, TaskError};
use rayon::prelude::*;
use serde::Serialize;

use crate::loaded_player::LoadedPlayer;
use crate::results::in_new_result;
use crate::song_planner::SongPlanner;

/// The table of the worlds in its folder.
const WORLDS: &str = "worlds.csv";

/// Which worlds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RobustnessConfig {
    /// Number of worlds beside the nominal one.
    pub worlds: usize,
    /// The paper's C_dr: how far the worlds are from the nominal one.
    pub intensity: f64,
    /// Seed of the set of worlds.
    pub seed: u64,
}

/// How a song went in one world.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct WorldScores {
    /// Scores by control step and by note.
    #[serde(flatten)]
    pub scores: Scores,
    /// Fraction of control steps without a collision.
    pub collision_free: f64,
}

/// The scores of one world, or the mean of several.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ScoreSummary {
    /// Notes of the song that were played in time.
    pub notes_right: f64,
    /// Strokes that play no note of the song.
    pub notes_wrong: f64,
    /// Median of how late the right notes are, s; none without one.
    pub onset_error_secs: Option<f64>,
    /// F1 by control step.
    pub f1: f64,
}

/// Mean F1 where one number is low, in the middle or high among the worlds, which are split in
/// thirds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Marginal {
    /// Path of the number.
    pub path: String,
    /// Its nominal value.
    pub nominal: f64,
    /// Its least and its greatest value in the worlds.
    pub range: [f64; 2],
    /// Mean F1 in the worlds of its low, middle and high third.
    pub f1: [f64; 3],
}

/// How a song went in all worlds. Its keys are those of `etude evaluate --json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RobustnessReport {
    /// Title of the song.
    pub song: String,
    /// The policy file, or `scripted`.
    pub player: String,
    /// Which worlds.
    #[serde(flatten)]
    pub config: RobustnessConfig,
    /// Notes of the song.
    pub notes_due: usize,
    /// In the nominal world.
    pub nominal: ScoreSummary,
    /// Means over the worlds.
    pub mean: ScoreSummary,
    /// Means over the tenth of the worlds (at least one) that is worst by each score.
    pub worst_decile: ScoreSummary,
    /// The worst score of any world.
    pub worst: ScoreSummary,
    /// F1 by third of each number that varies; none for fewer than three worlds.
    pub marginals: Vec<Marginal>,
    /// Scores in each world, in the order of `worlds.csv`.
    pub scores: Vec<WorldScores>,
    /// The numbers of each world that vary, in the order of `paths`.
    #[serde(skip)]
    pub values: Vec<Vec<f64>>,
    /// Paths of the numbers that vary.
    #[serde(skip)]
    pub paths: Vec<String>,
    /// The table that was written, if one was.
    pub csv: Option<PathBuf>,
}

/// Plays `song` once in each world of `config`, over the threads of the current rayon pool. `watch`
/// receives the number of finished worlds after each, on any thread. If it returns `false`, the
/// evaluation stops and there is no report.
///
/// # Errors
/// If the song does not fit the keyboard, or the player's task or `config` is not sound.
pub fn evaluate_robustness(
    song: &Song,
    player: &LoadedPlayer,
    config: &RobustnessConfig,
    planner: &mut SongPlanner<'_>,
    watch: &(dyn Fn(usize) -> bool + Sync),
) -> anyhow::Result<Option<RobustnessReport>> {
    let mut task = player.config.task.clone();
    task.randomisation.intensity = config.intensity;
    task.check()?;
    let piece = planner.plan(song, &task)?;
    let nominal = task.params().map_err(TaskError::from)?;
    let randomisation = Randomisation::new(nominal.clone(), &task.randomisation, task.stage.actuation)?;
    let mut worlds = vec![nominal];
    worlds.extend(randomisation.grid(config.worlds, config.seed));
    let piece_player = player.for_piece(&task, &piece, planner.on_progress())?;
    let never = AtomicBool::new(false);

    let (done, stopped) = (AtomicUsize::new(0), AtomicBool::new(false));
    let played =
        worlds.par_iter().with_max_len(1).map(|params| -> Result<Option<WorldScores>, PerformError> {
            if stopped.load(Ordering::Relaxed) {
                return Ok(None);
            }
            let mut rig = SimRig::in_world(&task, &piece, params)?;
            let scores =
                world_scores(&perform(&mut rig, &mut piece_player.clone(), &task, &piece, None, &never)?);
            if !watch(done.fetch_add(1, Ordering::Relaxed) + 1) {
                stopped.store(true, Ordering::Relaxed);
            }
            Ok(Some(scores))
        });
    let played: Vec<Option<WorldScores>> = played.collect::<Result<_, _>>()?;
    let played: Option<Vec<WorldScores>> = played.into_iter().collect();
    let Some(mut scores) = played.filter(|_| !stopped.load(Ordering::Relaxed)) else { return Ok(None) };

    let nominal = scores.remove(0).scores;
    let nominal = ScoreSummary {
        notes_right: nominal.note.matched as f64,
        notes_wrong: nominal.note.wrong as f64,
        onset_error_secs: nominal.note.onset_error_median_secs,
        f1: nominal.frame.f1,
    };
    let paths: Vec<String> = randomisation.paths().collect();
    let read = |params: &PhysicalParams| paths.iter().map(|path| params.get(path)).collect();
    let mut values =
        worlds.iter().map(read).collect::<Result<Vec<Vec<f64>>, _>>().map_err(TaskError::from)?;
    let middle = values.remove(0);
    let all = |score: fn(&Scores) -> f64| scores.iter().map(move |world| score(&world.scores));
    let f1: Vec<f64> = all(|scores| scores.frame.f1).collect();
    let sorted_f1 = sorted(f1.iter().copied());
    let right = sorted(all(|scores| scores.note.matched as f64));
    let mut wrong = sorted(all(|scores| scores.note.wrong as f64));
    wrong.reverse();
    // Without worlds there is the nominal one alone.
    let worst = |count: usize| match f1.len().min(count) {
        0 => nominal,
        count => {
            let [notes_right, notes_wrong, f1] = [&right, &wrong, &sorted_f1].map(|all| mean(&all[..count]));
            ScoreSummary { notes_right, notes_wrong, onset_error_secs: None, f1 }
        }
    };
    let late: Vec<f64> =
        scores.iter().filter_map(|world| world.scores.note.onset_error_median_secs).collect();
    Ok(Some(RobustnessReport {
        song: song.title().to_string(),
        player: player.name(),
        config: *config,
        notes_due: piece.notes().len(),
        nominal,
        mean: ScoreSummary { onset_error_secs: (!late.is_empty()).then(|| mean(&late)), ..worst(f1.len()) },
        worst_decile: worst(f1.len().div_ceil(10)),
        worst: worst(1),
        marginals: marginals(&paths, &middle, &values, &f1),
        scores,
        values,
        paths,
        csv: None,
    }))
}

fn world_scores(performance: &Performance) -> WorldScores {
    let collision_free = performance.simulation.unwrap_or_default().collision_free;
    WorldScores { scores: performance.scores(), collision_free }
}

fn marginals(paths: &[String], nominal: &[f64], values: &[Vec<f64>], f1: &[f64]) -> Vec<Marginal> {
    if f1.len() < 3 {
        return Vec::new();
    }
    let of = |(column, path): (usize, &String)| {
        let mut order: Vec<usize> = (0..f1.len()).collect();
        order.sort_by(|a, b| values[*a][column].total_cmp(&values[*b][column]));
        let third = |index: usize| {
            let worlds = &order[index * f1.len() / 3..(index + 1) * f1.len() / 3];
            mean(&worlds.iter().map(|world| f1[*world]).collect::<Vec<_>>())
        };
        let end = |at: usize| order.get(at).map_or(f64::NAN, |world| values[*world][column]);
        Marginal {
            path: path.clone(),
            nominal: nominal[column],
            range: [end(0), end(f1.len() - 1)],
            f1: [0, 1, 2].map(third),
        }
    };
    paths.iter().enumerate().map(of).collect()
}

impl RobustnessReport {
    /// Writes one line a world into a new numbered folder in `results`: its number, its scores, and
    /// the numbers that vary, under their paths.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_csv(&mut self, results: &Path) -> anyhow::Result<()> {
        let mut text = String::from(
            "world,player,f1,precision,recall,pooled_f1,notes_right,notes_wrong,onset_f1,collision_free",
        );
        let player = quoted(&self.player);
        text.extend(self.paths.iter().map(|path| format!(",{path}")));
        for (index, (world, values)) in self.scores.iter().zip(&self.values).enumerate() {
            let Scores { frame, note, .. } = &world.scores;
            let [right, wrong] = [note.matched, note.wrong].map(|count| count as f64);
            let by_step = [frame.f1, frame.precision, frame.recall, frame.pooled_f1];
            let scores = [by_step, [right, wrong, note.onset_f1, world.collision_free]].concat();
            text.push_str(&format!("\n{index},{player}"));
            text.extend(scores.iter().chain(values).map(|value| format!(",{value}")));
        }
        self.csv = Some(in_new_result(
            results,
            |_| true,
            |folder| {
                let path = folder.join(WORLDS);
                write_file(&path, &(text + "\n"))?;
                Ok(path)
            },
        )?);
        Ok(())
    }
}

/// A text as a field of a CSV.
fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::change;
    use etude_music::Note;

    fn song() -> Song {
        let note = |(at, pitch): (usize, u8)| {
            let start_secs = 0.3 * at as f64;
            Note { pitch, start_secs, end_secs: start_secs + 0.3, velocity: 80 }
        };
        Song::new("Short", [60, 62, 64].into_iter().enumerate().map(note).collect(), 0.9).unwrap()
    }

    fn player(sets: &[&str]) -> LoadedPlayer {
        let mut player = LoadedPlayer::scripted();
        player.config =
            change(&player.config, &sets.iter().map(ToString::to_string).collect::<Vec<_>>()).unwrap();
        player
    }

    fn on_threads(threads: usize, player: &LoadedPlayer, config: &RobustnessConfig) -> RobustnessReport {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| evaluate_robustness(&song(), player, config, &mut SongPlanner::default(), &|_| true))
            .unwrap()
            .unwrap()
    }

    #[test]
    fn any_number_of_threads_gives_the_same_report() {
        let config = RobustnessConfig { worlds: 11, intensity: 0.5, seed: 0 };
        let one = on_threads(1, &player(&[]), &config);
        for threads in [2, 4] {
            assert_eq!(on_threads(threads, &player(&[]), &config), one);
        }
        assert_ne!(on_threads(2, &player(&[]), &RobustnessConfig { seed: 1, ..config }).scores, one.scores);
        assert_eq!((one.scores.len(), one.marginals.len(), one.paths.len()), (11, 31, 31));
        let wrong: Vec<usize> = one.scores.iter().map(|scores| scores.scores.note.wrong).collect();
        assert_eq!(one.worst.notes_wrong, *wrong.iter().max().unwrap() as f64);
        assert!((wrong.iter().sum::<usize>() as f64 / 11.0 - one.mean.notes_wrong).abs() < 1e-12);
        // The means are those of the scores: two worlds are the worst tenth of eleven.
        let mut f1: Vec<f64> = one.scores.iter().map(|scores| scores.scores.frame.f1).collect();
        assert!((f1.iter().sum::<f64>() / 11.0 - one.mean.f1).abs() < 1e-12);
        f1.sort_by(f64::total_cmp);
        assert!(((f1[0] + f1[1]) / 2.0 - one.worst_decile.f1).abs() < 1e-12 && f1[0] == one.worst.f1);
        assert!(one.nominal.f1 > one.worst_decile.f1, "{one:?}");
        let of_thirds: f64 = one.marginals[3].f1.iter().zip([3.0, 4.0, 4.0]).map(|(f1, n)| f1 * n).sum();
        assert!((of_thirds / 11.0 - one.mean.f1).abs() < 1e-12, "each world is in one third");
    }

    #[test]
    fn without_intensity_every_world_is_the_nominal_one() {
        let report = on_threads(2, &player(&[]), &RobustnessConfig { worlds: 3, intensity: 0.0, seed: 0 });
        assert!(report.scores.iter().all(|scores| scores.scores.frame.f1 == report.nominal.f1));
        assert_eq!((report.mean.f1, report.worst.f1), (report.nominal.f1, report.nominal.f1));
        let report = on_threads(2, &player(&[]), &RobustnessConfig { worlds: 0, intensity: 0.5, seed: 0 });
        assert!(report.marginals.is_empty() && report.worst.f1 == report.nominal.f1);
    }

    #[test]
    fn a_number_that_matters_shows_in_its_thirds() {
        let player = player(&["task.randomisation.widths.key.threshold=0.45"]);
        let report = on_threads(2, &player, &RobustnessConfig { worlds: 12, intensity: 1.0, seed: 0 });
        let [marginal] = &report.marginals[..] else { panic!("{:?}", report.marginals) };
        assert_eq!((marginal.path.as_str(), marginal.nominal), ("key.threshold", 0.5));
        assert!(marginal.range[0] < 0.1 && marginal.range[1] > 0.9, "{marginal:?}");
        let folder = tempfile::tempdir().unwrap();
        let mut report = report;
        report.write_csv(folder.path()).unwrap();
        let text = std::fs::read_to_string(folder.path().join("latest/worlds.csv")).unwrap();
        let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
        assert_eq!((rows.len(), *rows[0].last().unwrap()), (13, "key.threshold"));
        for (row, (scores, values)) in rows[1..].iter().zip(report.scores.iter().zip(&report.values)) {
            assert_eq!(
                (row[2].parse(), row.last().unwrap().parse()),
                (Ok(scores.scores.frame.f1), Ok(values[0]))
            );
        }
    }

    #[test]
    fn stopping_gives_no_report_and_what_cannot_work_an_error() {
        let config = RobustnessConfig { worlds: 20, intensity: 0.5, seed: 0 };
        let played = AtomicUsize::new(0);
        let watch = |done: usize| {
            played.fetch_max(done, Ordering::Relaxed);
            done < 2
        };
        assert_eq!(
            evaluate_robustness(&song(), &player(&[]), &config, &mut SongPlanner::default(), &watch).unwrap(),
            None
        );
        assert!(played.load(Ordering::Relaxed) < 10);
        let fails = |player: &LoadedPlayer, config: &RobustnessConfig| {
            evaluate_robustness(&song(), player, config, &mut SongPlanner::default(), &|_| true)
                .unwrap_err()
                .to_string()
        };
        assert!(
            fails(&player(&[]), &RobustnessConfig { intensity: 1.5, ..config })
                .contains("randomisation.intensity")
        );
        let said = fails(&player(&["task.randomisation.widths.key.colour=1"]), &config);
        assert!(said.contains("`key.colour`") && said.contains("etude model params"), "{said}");
    }
}
