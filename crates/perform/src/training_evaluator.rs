//! Evaluation during a training: the whole song, or each held-out piece of a corpus, in the nominal
//! world, without exploration.

use std::sync::atomic::AtomicBool;

use etude_learn::{Evaluator, Score};
use etude_task::{ACTION_LEN, Corpus, Piece, TaskConfig, TaskError};

use crate::{Performance, SimRig, perform};

/// Names of the scores of [`TrainingEvaluator`]. `overall` is the mean of the paper's F1 and the F1
/// of the notes' onsets.
pub const SCORES: [&str; 12] = [
    "f1",
    "precision",
    "recall",
    "pooled_f1",
    "notes_right",
    "notes_missed",
    "notes_wrong",
    "onset_f1",
    "onset_offset_f1",
    "overall",
    "collision_free",
    "return",
];

/// Name of the F1 on learned pieces of a corpus.
pub const LEARNED_F1: &str = "training_f1";
/// The scores that are also taken on learned pieces: their names there, and elsewhere.
const OF_LEARNED: [(&str, &str); 2] = [(LEARNED_F1, "f1"), ("training_onset_f1", "onset_f1")];

/// Plays the song once for each evaluation, always in the nominal world, and scores it. Of several
/// pieces the scores are the means, and the counts of notes the sums.
pub struct TrainingEvaluator {
    pieces: Vec<(SimRig, Piece)>,
    learned: Vec<(SimRig, Piece)>,
    task: TaskConfig,
}

impl TrainingEvaluator {
    /// An evaluator for `piece`.
    ///
    /// # Errors
    /// If the configuration is not valid.
    pub fn new(task: &TaskConfig, piece: &Piece) -> Result<Self, TaskError> {
        Self::of_pieces(task, std::slice::from_ref(piece), &[])
    }

    /// An evaluator that plays the validation pieces of a corpus and, of a folder, some of the
    /// learned ones.
    ///
    /// # Errors
    /// If the configuration is not valid.
    pub fn of_corpus(task: &TaskConfig, corpus: &Corpus) -> Result<Self, TaskError> {
        Self::of_pieces(task, corpus.validation(), &corpus.learned_sample())
    }

    fn of_pieces(task: &TaskConfig, pieces: &[Piece], learned: &[Piece]) -> Result<Self, TaskError> {
        let with_rig = |piece: &Piece| Ok((SimRig::nominal(task, piece)?, piece.clone()));
        let with_rigs = |pieces: &[Piece]| pieces.iter().map(with_rig).collect::<Result<_, TaskError>>();
        Ok(Self { pieces: with_rigs(pieces)?, learned: with_rigs(learned)?, task: task.clone() })
    }
}

impl Evaluator for TrainingEvaluator {
    fn evaluate(&mut self, act: &mut (dyn FnMut(&[f32], &mut [f32]) + Send)) -> Vec<Score> {
        let mut player =
            |_: usize, observation: &[f32], action: &mut [f32; ACTION_LEN]| act(observation, action);
        let never = AtomicBool::new(false);
        let mut means = |pieces: &mut [(SimRig, Piece)]| -> Vec<Score> {
            let mut sums = [0.0; SCORES.len()];
            for (rig, piece) in pieces.iter_mut() {
                let performance = perform(rig, &mut player, &self.task, piece, None, &never)
                    .expect("a simulation has no recording here that could fail");
                for (sum, value) in sums.iter_mut().zip(values(&performance)) {
                    *sum += value;
                }
            }
            let mean = |(name, sum): (&str, f64)| {
                let pieces = if name.starts_with("notes_") { 1.0 } else { pieces.len() as f64 };
                Score { name: name.to_string(), value: sum / pieces }
            };
            SCORES.into_iter().zip(sums).map(mean).collect()
        };
        let mut scores = means(&mut self.pieces);
        if !self.learned.is_empty() {
            let all = means(&mut self.learned);
            let named = |(name, other): (&str, &str)| {
                let score = all.iter().find(|score| score.name == other)?;
                Some(Score { name: name.to_string(), value: score.value })
            };
            scores.extend(OF_LEARNED.into_iter().filter_map(named));
        }
        scores
    }
}

/// The values of [`SCORES`].
fn values(performance: &Performance) -> [f64; SCORES.len()] {
    let (scores, simulated) = (performance.scores(), performance.simulation.unwrap_or_default());
    [
        scores.frame.f1,
        scores.frame.precision,
        scores.frame.recall,
        scores.frame.pooled_f1,
        scores.note.matched as f64,
        scores.note.missed as f64,
        scores.note.wrong as f64,
        scores.note.onset_f1,
        scores.note.onset_offset_f1,
        (scores.frame.f1 + scores.note.onset_f1) / 2.0,
        simulated.collision_free,
        simulated.reward,
    ]
}
