//! What the tests of the trainer share: a toy problem, its evaluator, an observer, and a run's
//! files.

use std::{collections::BTreeMap, fs, path::Path};

use super::super::*;
use crate::{
    env::{EnvironmentError, ObservationLayout, StepBatch},
    random::Stream,
};

/// Follow a number: the reward is high when the action equals the target that the observation
/// shows. The target is shown twice, as a real column and coarsely as bits, so that both input
/// paths carry it.
pub(super) struct Tracking {
    targets: Vec<(f32, u32)>,
    stream: Stream,
    /// Steps an episode.
    length: u32,
    /// When set, the reward of this step is not a number.
    pub(super) poison_at: Option<u64>,
    made: u64,
}

const BITS: usize = 4;
const LAYOUT: ObservationLayout = ObservationLayout { real: 1, binary: BITS };

impl Tracking {
    pub(super) fn new(num_envs: usize) -> Self {
        let stream = Stream::new(7, "toy");
        Self { targets: vec![(0.0, 0); num_envs], stream, length: 10, poison_at: None, made: 0 }
    }

    fn observe(target: f32, observation: &mut [f32]) {
        observation[0] = target;
        for (bit, value) in observation[1..].iter_mut().enumerate() {
            *value = if target > (bit as f32 - 1.5) / 2.0 { 1.0 } else { 0.0 };
        }
    }

    fn draw(&mut self) -> f32 {
        1.6 * self.stream.uniform() - 0.8
    }
}

impl VectorEnvironment for Tracking {
    fn num_envs(&self) -> usize {
        self.targets.len()
    }

    fn layout(&self) -> ObservationLayout {
        LAYOUT
    }

    fn action_len(&self) -> usize {
        1
    }

    fn reward_term_names(&self) -> Vec<String> {
        vec!["distance".to_owned(), "bonus".to_owned()]
    }

    fn reset(&mut self, observation: &mut [f32]) {
        for index in 0..self.targets.len() {
            self.targets[index] = (self.draw(), 0);
            Self::observe(self.targets[index].0, &mut observation[index * LAYOUT.len()..][..LAYOUT.len()]);
        }
    }

    fn step(&mut self, actions: &[f32], batch: &mut StepBatch) {
        self.made += 1;
        for (index, action) in actions.iter().enumerate() {
            let (target, age) = self.targets[index];
            let distance = (action - target).abs();
            batch.reward_terms[2 * index] = -distance;
            batch.reward_terms[2 * index + 1] = 1.0;
            batch.reward[index] = 1.0 - distance;
            if self.poison_at == Some(self.made) {
                batch.reward[index] = f32::NAN;
            }
            batch.truncated[index] = age + 1 == self.length;
            let next = self.draw();
            let columns = index * LAYOUT.len()..(index + 1) * LAYOUT.len();
            Self::observe(next, &mut batch.next_observation[columns.clone()]);
            self.targets[index] = (next, if batch.truncated[index] { 0 } else { age + 1 });
            if batch.truncated[index] {
                self.targets[index].0 = self.draw();
            }
            Self::observe(self.targets[index].0, &mut batch.observation[columns]);
        }
    }

    fn save_state(&self) -> Vec<u8> {
        serde_json::to_vec(&(&self.targets, &self.stream, self.made)).unwrap()
    }

    fn load_state(&mut self, state: &[u8]) -> Result<(), EnvironmentError> {
        (self.targets, self.stream, self.made) =
            serde_json::from_slice(state).map_err(|error| EnvironmentError::new(error.to_string()))?;
        Ok(())
    }
}

/// One minus the mean distance, over a grid of targets.
pub(super) struct Grid;

impl Evaluator for Grid {
    fn evaluate(&mut self, act: &mut (dyn FnMut(&[f32], &mut [f32]) + Send)) -> Vec<Score> {
        let targets: Vec<f32> = (0..33).map(|i| -0.8 + 0.05 * i as f32).collect();
        let mut observations = vec![0.0; 33 * LAYOUT.len()];
        for (row, &target) in observations.chunks_exact_mut(LAYOUT.len()).zip(&targets) {
            Tracking::observe(target, row);
        }
        let mut actions = vec![0.0; 33];
        act(&observations, &mut actions);
        let distance: f32 = actions.iter().zip(&targets).map(|(a, t)| (a - t).abs()).sum::<f32>() / 33.0;
        vec![
            Score { name: "closeness".to_owned(), value: f64::from(1.0 - distance) },
            Score { name: "undefined".to_owned(), value: f64::NAN },
            Score { name: "distance".to_owned(), value: f64::from(distance) },
        ]
    }
}

pub(super) fn droq() -> DroqConfig {
    DroqConfig {
        hidden: vec![32, 32],
        batch: 64,
        replay_capacity: 700,
        discount: 0.5,
        n_step: 2,
        actor_learning_rate: 3e-3,
        critic_learning_rate: 3e-3,
        temperature_learning_rate: 3e-3,
        initial_temperature: 0.1,
        polyak: 0.02,
        ..DroqConfig::default()
    }
}

pub(super) fn config(total_steps: u64) -> TrainerConfig {
    TrainerConfig {
        seed: 5,
        total_steps,
        num_envs: 4,
        updates_per_vector_step: 2,
        warmup_steps: 100,
        log_every_steps: 150,
        evaluate_every_steps: 400,
        best_by: String::new(),
        checkpoint_every_steps: 400,
        threads: 2,
        overlap: true,
    }
}

pub(super) fn inputs() -> TrainingInputs {
    TrainingInputs {
        environment: Box::new(Tracking::new(4)),
        evaluator: Box::new(Grid),
        notes: serde_json::json!({"toy": 1}),
    }
}

/// Stops after a number of vector steps, and records the rows.
#[derive(Default)]
pub(super) struct Watch {
    pub(super) stop_at: Option<u64>,
    pub(super) steps: u64,
    pub(super) logs: Vec<LogRow>,
    pub(super) evaluations: Vec<EvaluationRow>,
}

impl TrainingObserver for Watch {
    fn on_log(&mut self, row: &LogRow) {
        self.logs.push(row.clone());
    }

    fn on_evaluation(&mut self, row: &EvaluationRow) {
        self.evaluations.push(row.clone());
    }

    fn should_stop(&mut self) -> Option<StopReason> {
        self.steps += 1;
        self.stop_at.filter(|&stop_at| self.steps > stop_at).map(|_| StopReason::Requested)
    }
}

/// Every file of a run.
pub(super) fn raw(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(current) = folders.pop() {
        for entry in fs::read_dir(current).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                files.insert(
                    path.strip_prefix(folder).unwrap().display().to_string(),
                    fs::read(&path).unwrap(),
                );
            }
        }
    }
    files
}

/// Every file of a run, without the times in it.
pub(super) fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = raw(folder);
    for (name, bytes) in &mut files {
        if name == "metrics.jsonl" {
            let rows = std::str::from_utf8(bytes).unwrap().lines().map(|line| {
                let mut row: serde_json::Value = serde_json::from_str(line).unwrap();
                row.as_object_mut().unwrap().retain(|key, _| !key.starts_with("perf/"));
                format!("{row}\n")
            });
            *bytes = rows.collect::<String>().into_bytes();
        }
        if name.starts_with("events") {
            *bytes = bytes.len().to_string().into_bytes();
        }
    }
    files
}

pub(super) fn assert_same_files(a: &Path, b: &Path) {
    let (a, b) = (files(a), files(b));
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>());
    for (name, bytes) in &a {
        assert!(bytes == &b[name], "{name} differs");
    }
}
