//! Evaluations, and the file of the best policy.

use std::{
    fs,
    path::{Path, PathBuf},
};

use super::{checkpoint::Best, error::TrainError, logger::Logger, observer::EvaluationRow};
use crate::{
    env::{Evaluator, Score},
    files::FileError,
    policy::Policy,
};

pub(super) const BEST_POLICY: &str = "policy-best.safetensors";

/// The evaluator and the best of its results.
pub(super) struct Evaluation {
    evaluator: Box<dyn Evaluator>,
    /// Name of the deciding score; the first score if it is empty.
    best_by: String,
    best_policy: PathBuf,
    pub best: Option<Best>,
    /// Environment step of the last evaluation.
    pub last_step: Option<u64>,
}

impl Evaluation {
    pub(super) fn new(evaluator: Box<dyn Evaluator>, best_by: &str, folder: &Path) -> Self {
        let (best_by, best_policy) = (best_by.to_owned(), folder.join(BEST_POLICY));
        Self { evaluator, best_by, best_policy, best: None, last_step: None }
    }

    /// Evaluates a policy, logs its scores, and saves it if it is the best. `policy_with` gives the
    /// policy with scores in its notes.
    pub(super) fn evaluate(
        &mut self,
        step: u64,
        policy_with: impl Fn(&[Score]) -> Policy,
        logger: &mut Logger,
    ) -> Result<EvaluationRow, TrainError> {
        let mut policy = policy_with(&[]);
        let scores = self.evaluator.evaluate(&mut |observations, actions| policy.act(observations, actions));
        self.last_step = Some(step);
        logger.write_evaluation(step, &scores)?;
        let deciding = self.deciding(&scores);
        if deciding.is_none() && !scores.is_empty() {
            let known: Vec<_> = scores.iter().map(|score| score.name.as_str()).collect();
            return Err(TrainError::Refused(format!(
                "no score is called `{}` (trainer.best_by); there are: {}",
                self.best_by,
                known.join(", ")
            )));
        }
        let record = self.best.as_ref().and_then(|best| self.deciding(&best.scores));
        let record = record.map_or(f64::NEG_INFINITY, |best| best.value);
        let best = deciding.is_some_and(|score| score.value > record);
        if best {
            keep_better_policy(&self.best_policy, deciding)?;
            policy_with(&scores).save(&self.best_policy)?;
            // JSON, and so the checkpoint, cannot express a score that is not finite.
            let finite = scores.iter().filter(|score| score.value.is_finite()).cloned().collect();
            self.best = Some(Best { step, scores: finite });
        }
        Ok(EvaluationRow { step, scores, best })
    }

    fn deciding<'a>(&self, scores: &'a [Score]) -> Option<&'a Score> {
        scores.iter().find(|score| self.best_by.is_empty() || score.name == self.best_by)
    }
}

/// Before a policy with `score` replaces the one at `path`: renames the old one after its step if
/// it was better. That happens only if a training was killed after an evaluation and resumed from
/// an earlier checkpoint with other intervals or on another kind of processor; otherwise the same
/// evaluation is repeated.
fn keep_better_policy(path: &Path, score: Option<&Score>) -> Result<(), FileError> {
    let (Ok(policy), Some(score)) = (Policy::load(path), score) else { return Ok(()) };
    let notes = &policy.header().notes;
    let (was, step) = (notes["scores"][&score.name].as_f64(), notes["step"].as_u64());
    match (was, step) {
        (Some(was), Some(step)) if was > score.value => {
            let new_path = path.with_file_name(format!("policy-best-{step}.safetensors"));
            fs::rename(path, &new_path).map_err(FileError::io("rename", path))
        }
        _ => Ok(()),
    }
}
