//! Rows of metrics and evaluations.

use std::{fs, path::Path, time::Instant};

use super::{
    BEST_POLICY, Best, EvaluationRow, LogRow, TrainError, Trainer, TrainingObserver, metrics::ELAPSED,
};
use crate::{env::Score, files::FileError, policy::Policy};

impl Trainer {
    pub(super) fn log(&mut self, observer: &mut dyn TrainingObserver) -> Result<(), TrainError> {
        let mut values = self.sums.take(&self.term_names);
        let secs = self.clock.last_row.elapsed().as_secs_f64().max(1e-9);
        let mut add = |name: &str, value: f64| values.push((name.to_owned(), value));
        add("charts/temperature", self.droq.temperature());
        add("charts/updates", self.droq.updates() as f64);
        add("charts/replay", self.replay.len() as f64);
        add("perf/steps_per_sec", (self.step - self.clock.last_step) as f64 / secs);
        add("perf/updates_per_sec", (self.droq.updates() - self.clock.last_updates) as f64 / secs);
        add(ELAPSED, self.elapsed_secs());
        self.clock.last_row = Instant::now();
        self.clock.last_step = self.step;
        self.clock.last_updates = self.droq.updates();
        let row = LogRow { step: self.step, values };
        self.metrics.write(row.step, &row.values)?;
        observer.on_log(&row);
        Ok(())
    }

    pub(super) fn evaluate(&mut self, observer: &mut dyn TrainingObserver) -> Result<(), TrainError> {
        self.check_finite()?;
        let mut policy = self.policy();
        let scores =
            self.parts.evaluator.evaluate(&mut |observations, actions| policy.act(observations, actions));
        self.last_evaluation = Some(self.step);
        let values: Vec<_> =
            scores.iter().map(|score| (format!("eval/{}", score.name), score.value)).collect();
        self.metrics.write(self.step, &values)?;
        let best_by = &self.config.best_by;
        let deciding = deciding(best_by, &scores)?;
        let record = self.best.as_ref().and_then(|best| deciding_in(best_by, &best.scores));
        let record = record.map_or(f64::NEG_INFINITY, |best| best.value);
        let best = deciding.is_some_and(|score| score.value > record);
        if best {
            let path = self.folder.join(BEST_POLICY);
            set_aside(&path, deciding)?;
            self.policy_with(&scores).save(&path)?;
            // JSON, and so the checkpoint, cannot express a score that is not finite.
            let finite = scores.iter().filter(|score| score.value.is_finite()).cloned().collect();
            self.best = Some(Best { step: self.step, scores: finite });
        }
        observer.on_evaluation(&EvaluationRow { step: self.step, scores, best });
        Ok(())
    }
}

/// The score called `best_by`, or the first if that is empty.
fn deciding_in<'a>(best_by: &str, scores: &'a [Score]) -> Option<&'a Score> {
    scores.iter().find(|score| best_by.is_empty() || score.name == best_by)
}

/// As [`deciding_in`]; none only where there are no scores.
fn deciding<'a>(best_by: &str, scores: &'a [Score]) -> Result<Option<&'a Score>, TrainError> {
    let found = deciding_in(best_by, scores);
    if found.is_none() && !scores.is_empty() {
        let known: Vec<_> = scores.iter().map(|score| score.name.as_str()).collect();
        return Err(TrainError::Refused(format!(
            "no score is called `{best_by}` (trainer.best_by); there are: {}",
            known.join(", ")
        )));
    }
    Ok(found)
}

/// Before a policy with `score` replaces the one at `path`: renames the old one after its step if it was better. That happens only if a
/// training was killed after an evaluation and resumed from an earlier checkpoint with other intervals or on another kind of
/// processor; otherwise the same evaluation is repeated.
fn set_aside(path: &Path, score: Option<&Score>) -> Result<(), FileError> {
    let (Ok(policy), Some(score)) = (Policy::load(path), score) else { return Ok(()) };
    let notes = &policy.header().notes;
    let (was, step) = (notes["scores"][&score.name].as_f64(), notes["step"].as_u64());
    match (was, step) {
        (Some(was), Some(step)) if was > score.value => {
            let aside = path.with_file_name(format!("policy-best-{step}.safetensors"));
            fs::rename(path, &aside).map_err(FileError::io("rename", path))
        }
        _ => Ok(()),
    }
}
