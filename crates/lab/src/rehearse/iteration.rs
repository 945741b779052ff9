//! What is rehearsed, and the result of an iteration.

use std::path::PathBuf;

use etude_perform::Mode;
use serde::de::IntoDeserializer as _;
use serde::{Deserialize, Serialize};

use super::prediction::Prediction;
use crate::identify::IdentifyMethod;
use crate::robot::RobotScores;

/// Whether these overrides, `path=value`, set the latency compensation. Else it is measured on the
/// robot.
pub fn set_latency_compensation(overrides: &[String]) -> bool {
    overrides.iter().any(|set| set.trim_start().starts_with("task.plan.latency_compensation_secs"))
}

/// How a rehearsal fits the simulator before each training.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RehearsalFit {
    /// Ours: Levenberg–Marquardt on all excitations and slow presses of keys. Later iterations fit
    /// the keyboard alone, to what was played.
    Lm,
    /// The paper's: Bayesian optimisation, first on hand opening and closing, in later iterations
    /// on that and on what was played.
    Bo,
    /// Not at all: as many steps of training in the same simulator, to compare with.
    None,
}

impl RehearsalFit {
    /// The method of identification, if there is one.
    pub(super) fn method(self) -> Option<IdentifyMethod> {
        match self {
            Self::Lm => Some(IdentifyMethod::Lm),
            Self::Bo => Some(IdentifyMethod::Bo),
            Self::None => None,
        }
    }
}

impl std::str::FromStr for RehearsalFit {
    type Err = serde::de::value::Error;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::deserialize(text.into_deserializer())
    }
}

impl std::fmt::Display for RehearsalFit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.method().map_or("none", IdentifyMethod::name))
    }
}

/// What to rehearse, and how.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RehearsalConfig {
    /// The song, as it is named on the command line.
    pub song: String,
    /// The rig.
    pub rig: String,
    /// Name of the twin parameters.
    pub twin_params: Option<String>,
    /// Iterations after the first performance.
    pub iterations: usize,
    /// Performances an iteration.
    pub runs: usize,
    /// How they are played.
    pub mode: Mode,
    /// Preset of the trainings. If it has a corpus they learn that, for all songs, and the song is
    /// what the robot plays.
    pub preset: String,
    /// Overrides of its values, `path=value`.
    pub overrides: Vec<String>,
    /// The policy of iteration 0; without one it is learned first.
    pub policy: Option<PathBuf>,
    /// A simulator whose drives are fitted to this robot already, as `etude identify` and
    /// rehearsals write it: only its keyboard is fitted then, to what was played.
    pub simulator: Option<PathBuf>,
    /// How the simulator is fitted.
    pub fit: RehearsalFit,
    /// Evaluations of each fit at most.
    pub evaluations: Option<u64>,
    /// Seed of identification and performances.
    pub seed: u64,
    /// Threads of the trainings, instead of `trainer.threads`. They do not change the result, so a
    /// rehearsal may be resumed with another number.
    #[serde(skip)]
    pub threads: Option<usize>,
}

/// The result of one iteration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Iteration {
    /// Its number; 0 is before any identification.
    pub iteration: usize,
    /// The scores. Each iteration first plays once to measure the latency compensation.
    #[serde(flatten)]
    pub scores: RobotScores,
    /// Errors of the simulator in the held-out excitation, finger joints, rad: before the fit and
    /// after.
    pub held_out_rad: Option<[f64; 2]>,
    /// How well the fit predicts playing; none in iteration 0.
    pub prediction: Option<Prediction>,
    /// The policy.
    pub policy: PathBuf,
    /// Recordings to listen to.
    pub recordings: Vec<PathBuf>,
    /// The identified numbers, by path.
    pub physics: std::collections::BTreeMap<String, f64>,
}

/// The iteration that has played best on the robot, by the mean of F1 and onset F1; the earlier one
/// of equals. The next iteration begins with its policy: a training that made the playing worse is
/// not continued.
pub fn best_iteration<'a>(iterations: impl IntoIterator<Item = &'a Iteration>) -> Option<&'a Iteration> {
    iterations.into_iter().reduce(|best, iteration| {
        if iteration.scores.overall() > best.scores.overall() { iteration } else { best }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::MeanNotes;

    #[test]
    fn the_best_iteration_is_by_the_steps_and_by_the_notes_and_the_earlier_of_equals() {
        let iteration = |iteration: usize, robot_f1: f64, onset_f1: f64| Iteration {
            iteration,
            scores: RobotScores {
                notes: MeanNotes { onset_f1, ..MeanNotes::default() },
                robot_f1,
                ..RobotScores::default()
            },
            held_out_rad: None,
            prediction: None,
            policy: PathBuf::new(),
            recordings: Vec::new(),
            physics: Default::default(),
        };
        let best = |iterations: &[Iteration]| best_iteration(iterations).map(|best| best.iteration);
        assert_eq!(best(&[]), None);
        let first = iteration(0, 0.94, 0.98);
        assert_eq!(
            best(&[first.clone(), iteration(1, 0.96, 0.90)]),
            Some(0),
            "more of the time, but fewer notes"
        );
        assert_eq!(best(&[first.clone(), iteration(1, 0.94, 0.98)]), Some(0));
        assert_eq!(best(&[first.clone(), iteration(1, 0.91, 0.98), iteration(2, 0.95, 0.99)]), Some(2));
        assert_eq!(best(&[first, iteration(1, 0.96, 1.0), iteration(2, 0.95, 0.99)]), Some(1));
    }
}
