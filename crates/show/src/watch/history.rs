//! The curves of a training, from the rows that its trainer logs.

use std::collections::BTreeMap;

/// Rows over which the speed is averaged: long enough to hold an evaluation or a checkpoint, short
/// enough to follow.
const SPEED_ROWS: usize = 10;

/// A value at a time of a training.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Environment steps made.
    pub step: f64,
    /// Seconds trained.
    pub secs: f64,
    /// The value.
    pub value: f64,
}

/// The log of a training so far.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// F1 of the evaluations.
    pub f1: Vec<Point>,
    /// Notes of the last evaluation: right, missed, wrong; none of a run that has not counted them.
    pub notes: Option<[f64; 3]>,
    /// Reward per step, summed over its terms.
    pub reward: Vec<Point>,
    /// The terms of the reward, by name.
    pub terms: BTreeMap<String, Vec<Point>>,
    /// Environment steps per second.
    pub speed: Vec<Point>,
    step: f64,
    secs: f64,
    rows: usize,
}

impl History {
    /// That of a log.
    pub(super) fn of(log: &[u8]) -> Self {
        let mut history = Self::default();
        log.split(|byte| *byte == b'\n').for_each(|line| history.add(line));
        history
    }

    /// Adds a line of the log. One that is damaged, or not complete yet, is left out.
    fn add(&mut self, line: &[u8]) {
        // A value that is not finite is written as null.
        let Ok(row) = serde_json::from_slice::<BTreeMap<String, Option<f64>>>(line) else { return };
        let get = |key: &str| row.get(key).copied().flatten();
        let Some(step) = get("step") else { return };
        // Evaluations say no time; each comes right after a row that does.
        self.secs = get("perf/elapsed_secs").unwrap_or(self.secs);
        (self.step, self.rows) = (step, self.rows + 1);
        let notes = ["eval/notes_right", "eval/notes_missed", "eval/notes_wrong"].map(get);
        if let [Some(right), Some(missed), Some(wrong)] = notes {
            self.notes = Some([right, missed, wrong]);
        }
        for (key, value) in &row {
            let Some(value) = *value else { continue };
            let series = match (key.as_str(), key.strip_prefix("reward/")) {
                ("eval/f1", _) => &mut self.f1,
                ("charts/reward_per_step", _) => &mut self.reward,
                ("perf/steps_per_sec", _) => &mut self.speed,
                (_, Some(term)) => self.terms.entry(term.to_string()).or_default(),
                _ => continue,
            };
            series.push(Point { step, secs: self.secs, value });
        }
    }

    /// Whether nothing has been logged.
    pub fn is_empty(&self) -> bool {
        self.rows == 0
    }

    /// Environment steps made when the last row was logged.
    pub fn step(&self) -> f64 {
        self.step
    }

    /// Seconds trained when the last row was logged.
    pub fn secs(&self) -> f64 {
        self.secs
    }

    /// The best evaluation, the first of equals.
    pub fn best(&self) -> Option<Point> {
        self.f1.iter().copied().reduce(|best, point| if point.value > best.value { point } else { best })
    }

    /// Environment steps per second of late, evaluations and checkpoints included.
    pub fn steps_per_sec(&self) -> Option<f64> {
        let last = self.speed.last()?;
        let first = &self.speed[self.speed.len().saturating_sub(SPEED_ROWS)];
        let (steps, secs) = (last.step - first.step, last.secs - first.secs);
        Some(if steps > 0.0 && secs > 0.0 { steps / secs } else { last.value })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn history(text: &str) -> History {
        History::of(text.as_bytes())
    }

    #[test]
    fn rows_become_curves() {
        let history = history(
            "{\"step\":100,\"charts/reward_per_step\":0.5,\"reward/energy\":-0.5,\"reward/key_press\":1.0,\
              \"losses/critic\":3.0,\"perf/steps_per_sec\":50.0,\"perf/elapsed_secs\":2.0}\n\
             {\"step\":100,\"eval/f1\":0.5,\"eval/recall\":0.7}\n\
             {\"step\":200,\"charts/reward_per_step\":null,\"perf/steps_per_sec\":100.0,\"perf/elapsed_secs\":4.0}\n\
             {\"step\":200,\"eval/f1\":0.4,\"eval/notes_right\":3.0,\"eval/notes_missed\":2.0,\"eval/notes_wrong\":1.0}\n",
        );
        assert_eq!(history.notes, Some([3.0, 2.0, 1.0]));
        let at = |step, secs, value| Point { step, secs, value };
        assert_eq!(history.f1, [at(100.0, 2.0, 0.5), at(200.0, 4.0, 0.4)]);
        assert_eq!(history.reward, [at(100.0, 2.0, 0.5)]);
        assert_eq!(history.terms.keys().collect::<Vec<_>>(), ["energy", "key_press"]);
        assert_eq!(history.best(), Some(at(100.0, 2.0, 0.5)));
        assert_eq!((history.step(), history.secs()), (200.0, 4.0));
        // 100 steps in two seconds, whatever the last row says of itself.
        assert_eq!(history.steps_per_sec(), Some(50.0));
    }

    #[test]
    fn damaged_lines_are_left_out() {
        let good = "{\"step\":8,\"eval/f1\":0.25}";
        for damaged in
            ["", "{\"step\":8,\"eval/", "\0\0\0", "[1,2]", "{\"eval/f1\":1.0}", "{\"step\":\"x\"}", "8"]
        {
            assert_eq!(history(&format!("{damaged}\n{good}\n{damaged}\n")), history(good), "{damaged:?}");
        }
        let mut broken = history(good);
        broken.add(&[0xff, 0xfe]);
        assert_eq!(broken, history(good));
        assert!(history("").is_empty() && history("").steps_per_sec().is_none());
    }
}
