//! Scores by control step: pressed keys compared with due keys.
//!
//! There are two kinds. The paper's are RoboPianist's (github.com/google-research/robopianist,
//! `wrappers/evaluation.py`): the means over the steps of each step's precision, recall and F1. A
//! step without due and pressed keys then scores 1, and pressing nothing always has precision 1.
//! *Pooled* scores count keys over the whole song first, so silence scores nothing.

use serde::{Deserialize, Serialize};

use super::share;
use crate::keys::KeySet;

/// Scores of a performance by control step, each from 0 to 1.
#[derive(Copy, Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameScores {
    /// Mean of the steps' precisions.
    pub precision: f64,
    /// Mean of the steps' recalls.
    pub recall: f64,
    /// Mean of the steps' F1: the paper's F1. It is not the harmonic mean of the two means above.
    pub f1: f64,
    /// Precision over all key-time.
    pub pooled_precision: f64,
    /// Recall over all key-time.
    pub pooled_recall: f64,
    /// F1 over all key-time.
    pub pooled_f1: f64,
}

/// Scores a performance step by step, without storing it.
#[derive(Copy, Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameTally {
    steps: usize,
    precision: f64,
    recall: f64,
    f1: f64,
    due: usize,
    pressed: usize,
    right: usize,
}

impl FrameTally {
    /// Counts one control step (its own scores are scikit-learn's binary ones with
    /// `zero_division=1`).
    pub fn push(&mut self, due: KeySet, pressed: KeySet) {
        let [right, due, pressed] = [due.intersection(pressed), due, pressed].map(KeySet::len);
        self.steps += 1;
        self.precision += share(right, pressed, 1.0);
        self.recall += share(right, due, 1.0);
        self.f1 += share(2 * right, due + pressed, 1.0);
        self.due += due;
        self.pressed += pressed;
        self.right += right;
    }

    /// How many control steps were counted.
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// The scores so far; perfect if nothing was counted.
    pub fn scores(&self) -> FrameScores {
        let mean = |sum: f64| if self.steps == 0 { 1.0 } else { sum / self.steps as f64 };
        FrameScores {
            precision: mean(self.precision),
            recall: mean(self.recall),
            f1: mean(self.f1),
            pooled_precision: share(self.right, self.pressed, 1.0),
            pooled_recall: share(self.right, self.due, 1.0),
            pooled_f1: share(2 * self.right, self.due + self.pressed, 1.0),
        }
    }
}

/// Scores a performance, one set of keys a control step. The shorter list is extended by silence,
/// so that a performance that was interrupted loses the rest.
pub fn frame_scores(due: &[KeySet], pressed: &[KeySet]) -> FrameScores {
    let mut tally = FrameTally::default();
    for step in 0..due.len().max(pressed.len()) {
        tally
            .push(due.get(step).copied().unwrap_or_default(), pressed.get(step).copied().unwrap_or_default());
    }
    tally.scores()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Computed with scikit-learn 1.4.2, `zero_division=1`.
    #[test]
    fn the_table_of_corner_cases() {
        let third = 2.0 / 3.0;
        for (due, pressed, precision, recall, f1) in [
            (&[][..], &[][..], 1.0, 1.0, 1.0),
            (&[], &[60], 0.0, 1.0, 0.0),
            (&[60], &[], 1.0, 0.0, 0.0),
            (&[60], &[60], 1.0, 1.0, 1.0),
            (&[60], &[61], 0.0, 0.0, 0.0),
            (&[60], &[60, 61], 0.5, 1.0, third),
            (&[60, 61], &[60], 1.0, 0.5, third),
            (&[60, 61], &[60, 62], 0.5, 0.5, 0.5),
        ] {
            let set = |pitches: &[u8]| KeySet::from_pitches(pitches.iter().copied());
            let scores = frame_scores(&[set(due)], &[set(pressed)]);
            assert_eq!(
                [scores.precision, scores.recall, scores.f1],
                [precision, recall, f1],
                "{due:?} {pressed:?}"
            );
        }
    }

    #[test]
    fn an_interrupted_performance_loses_the_rest() {
        let due = [KeySet::from_pitches([60]); 4];
        let scores = frame_scores(&due, &due[..1]);
        assert_eq!((scores.f1, scores.precision, scores.pooled_recall), (0.25, 1.0, 0.25));
        assert_eq!(frame_scores(&[], &[]).f1, 1.0);
    }
}
