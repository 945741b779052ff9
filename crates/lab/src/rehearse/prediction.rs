//! How well a fit predicts what a robot plays.

use std::collections::BTreeMap;
use std::path::Path;

use etude_music::Song;
use etude_task::{RandomisationConfig, Widths};
use serde::{Deserialize, Serialize};

use crate::loaded_player::{LoadedPlayer, load_player};
use crate::play::scores_in_worlds;
use crate::robot::RobotScores;
use crate::song_planner::SongPlanner;

/// Worlds about a simulator in which a prediction plays. A policy outside the world of its training
/// plays on an edge: 1 % more or less of each number moves F1 by 0.04 (standard deviation). So one
/// world predicts little, and their mean does.
const WORLDS: u64 = 20;
/// Half-widths of these worlds, which no fit knows better: of lengths in m, of encoder biases in
/// rad, and of every other number as a share of it.
const LENGTH_M: f64 = 0.000_1;
const BIAS_RAD: f64 = 0.001;
const SHARE: f64 = 0.02;

/// How well a fit predicts playing: F1 of the policy of the iteration before, which was not trained
/// in the fitted simulator, as it was played on the robot. Predictions are means over worlds about
/// the simulator.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Prediction {
    /// In the simulator in which it was trained.
    pub before_fit_f1: f64,
    /// In the fitted simulator.
    pub after_fit_f1: f64,
    /// On the robot.
    pub played_f1: f64,
}

impl Prediction {
    /// Of a policy that a robot played with `scores`, by a fit to `physics`.
    ///
    /// # Errors
    /// If the policy cannot be read, or the song cannot be planned for it.
    pub(super) fn of(
        song: &Song,
        policy: &Path,
        scores: &RobotScores,
        physics: &BTreeMap<String, f64>,
    ) -> anyhow::Result<Self> {
        let mut player = load_player(policy)?;
        player.config.task.key_schedule.latency_compensation_secs = scores.latency_compensation_secs;
        let fitted = player.config.task.physics.clone().into_iter().chain(physics.clone()).collect();
        let before_fit_f1 = mean_f1(&player, song, physics)?;
        player.config.task.physics = fitted;
        Ok(Self { before_fit_f1, after_fit_f1: mean_f1(&player, song, physics)?, played_f1: scores.robot_f1 })
    }
}

/// Mean F1 in worlds about the player's own, which differ in the numbers that `physics` names.
fn mean_f1(player: &LoadedPlayer, song: &Song, physics: &BTreeMap<String, f64>) -> anyhow::Result<f64> {
    let mut player = player.clone();
    let width = |(path, value): (&String, &f64)| {
        let width = match path {
            path if path.starts_with("keyboard.") => LENGTH_M,
            path if path.ends_with(".encoder_bias") => BIAS_RAD,
            _ => SHARE * value.abs(),
        };
        (path.clone(), width)
    };
    player.config.task.randomisation = RandomisationConfig {
        intensity: 1.0,
        widths: Widths::Identified(physics.iter().map(width).collect()),
    };
    let mut planner = SongPlanner::default();
    let piece = planner.plan(song, &player.config.task)?;
    let scores = scores_in_worlds(&player, &piece, &mut planner, WORLDS)?;
    Ok(scores.iter().map(|scores| scores.frame.f1).sum::<f64>() / scores.len() as f64)
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;

    /// Of a fit that finds keys which sound late, on a robot that played what it then predicts.
    #[test]
    fn a_prediction_is_of_the_fitted_simulator_beside_that_of_the_training() {
        let policy = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../policies/twinkle.safetensors");
        let song = etude_music::resolve("twinkle").unwrap();
        let scores = RobotScores { robot_f1: 0.75, ..RobotScores::default() };
        let predicted = |physics: &[(&str, f64)]| {
            let physics = physics.iter().map(|(path, value)| (path.to_string(), *value)).collect();
            Prediction::of(&song, &policy, &scores, &physics).unwrap()
        };
        // No number is fitted: all worlds are that of the training.
        let same = predicted(&[]);
        assert_eq!(same.before_fit_f1, same.after_fit_f1);
        assert!(same.before_fit_f1 > 0.9 && same.played_f1 == 0.75, "{same:?}");
        let late = predicted(&[("key.threshold", 0.95), ("keyboard.height", -0.006)]);
        assert!(late.before_fit_f1 > 0.95 && late.after_fit_f1 < 0.9, "{late:?}");
    }
}
