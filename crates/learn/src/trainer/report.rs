//! What a training tells about itself at intervals: rows of metrics and evaluations.

use std::time::Instant;

use super::{
    BEST_POLICY, Best, EvaluationRow, LogRow, TrainError, Trainer, TrainingObserver, metrics::ELAPSED,
};

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
        let first = scores.first().map_or(f64::NAN, |score| score.value);
        let record = self
            .best
            .as_ref()
            .and_then(|best| best.scores.first())
            .map_or(f64::NEG_INFINITY, |best| best.value);
        let best = first > record;
        if best {
            self.policy_with(&scores).save(&self.folder.join(BEST_POLICY))?;
            // JSON, and so the checkpoint, has no word for a score that is not finite.
            let finite = scores.iter().filter(|score| score.value.is_finite()).cloned().collect();
            self.best = Some(Best { step: self.step, scores: finite });
        }
        observer.on_evaluation(&EvaluationRow { step: self.step, scores, best });
        Ok(())
    }
}
