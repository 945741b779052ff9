//! Learns to point at a number: the smallest whole training, and what `scripts/check_tfevents.py`
//! reads.
//!
//! ```text
//! cargo run --release -p etude-learn --example toy_training -- FOLDER
//! ```
//!
//! It can be stopped anywhere; run it again on the same folder to resume.
#![allow(clippy::print_stdout)] // An example may talk.

use std::{error::Error, path::Path};

use etude_learn::{
    DroqConfig, EnvironmentError, EvaluationRow, Evaluator, ObservationLayout, Score, StepBatch, Trainer,
    TrainerConfig, TrainingInputs, TrainingObserver, VectorEnvironment, seed,
};

const LAYOUT: ObservationLayout = ObservationLayout { real: 1, binary: 1 };

/// Shows a target and whether it is positive; pays for an action near it.
struct Pointing {
    targets: Vec<f32>,
    steps: u64,
}

impl Pointing {
    fn show(&mut self, observation: &mut [f32]) {
        for (index, row) in observation.chunks_exact_mut(LAYOUT.len()).enumerate() {
            let draw = seed::split(self.steps * 1000 + index as u64, "target");
            self.targets[index] = (draw >> 40) as f32 / (1u64 << 23) as f32 - 1.0;
            row[0] = self.targets[index];
            row[1] = if self.targets[index] > 0.0 { 1.0 } else { 0.0 };
        }
    }
}

impl VectorEnvironment for Pointing {
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
        vec!["nearness".to_owned()]
    }
    fn reset(&mut self, observation: &mut [f32]) {
        self.show(observation);
    }
    fn step(&mut self, actions: &[f32], batch: &mut StepBatch) {
        self.steps += 1;
        for (index, (action, target)) in actions.iter().zip(&self.targets).enumerate() {
            batch.reward[index] = 1.0 - (action - target).abs();
        }
        batch.reward_terms.copy_from_slice(&batch.reward);
        self.show(&mut batch.next_observation);
        // Episodes end after every twenty steps; the task itself never does.
        batch.truncated.fill(self.steps.is_multiple_of(20));
        batch.observation.copy_from_slice(&batch.next_observation);
    }
    fn save_state(&self) -> Vec<u8> {
        let targets = self.targets.iter().flat_map(|target| target.to_le_bytes());
        self.steps.to_le_bytes().into_iter().chain(targets).collect()
    }
    fn load_state(&mut self, state: &[u8]) -> Result<(), EnvironmentError> {
        let (steps, targets) =
            state.split_first_chunk::<8>().ok_or_else(|| EnvironmentError::new("it is too short"))?;
        let targets = targets.as_chunks::<4>().0;
        if targets.len() != self.targets.len() {
            return Err(EnvironmentError::new("it is of another number of environments"));
        }
        self.steps = u64::from_le_bytes(*steps);
        self.targets = targets.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        Ok(())
    }
}

/// One minus the mean distance over a grid.
struct Grid;

impl Evaluator for Grid {
    fn evaluate(&mut self, act: &mut (dyn FnMut(&[f32], &mut [f32]) + Send)) -> Vec<Score> {
        let targets: Vec<f32> = (-9..=9).map(|i| i as f32 / 10.0).collect();
        let observations: Vec<f32> =
            targets.iter().flat_map(|&t| [t, if t > 0.0 { 1.0 } else { 0.0 }]).collect();
        let mut actions = vec![0.0; targets.len()];
        act(&observations, &mut actions);
        let distance: f32 = actions.iter().zip(&targets).map(|(a, t)| (a - t).abs()).sum();
        vec![Score { name: "nearness".to_owned(), value: 1.0 - f64::from(distance) / targets.len() as f64 }]
    }
}

struct Talk;

impl TrainingObserver for Talk {
    fn on_evaluation(&mut self, row: &EvaluationRow) {
        println!(
            "step {}: nearness {:.3}{}",
            row.step,
            row.scores[0].value,
            if row.best { ", the best so far" } else { "" }
        );
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("usage: toy_training FOLDER")?;
    let folder = Path::new(&folder);
    let droq =
        DroqConfig { hidden: vec![32, 32], batch: 64, initial_temperature: 0.1, ..DroqConfig::default() };
    let config = TrainerConfig {
        total_steps: 20_000,
        num_envs: 4,
        updates_per_vector_step: 2,
        warmup_steps: 500,
        checkpoint_every_steps: 2_000,
        evaluate_every_steps: 2_000,
        ..TrainerConfig::default()
    };
    let inputs = TrainingInputs {
        environment: Box::new(Pointing { targets: vec![0.0; config.num_envs], steps: 0 }),
        evaluator: Box::new(Grid),
        notes: serde_json::json!({"task": "pointing"}),
    };
    let mut trainer = match Trainer::exists(folder) {
        true => Trainer::resume(folder, &droq, &config, inputs)?,
        false => Trainer::start(folder, &droq, &config, inputs, None)?,
    };
    let outcome = trainer.run(&mut Talk)?;
    println!("{} steps, {} updates in {:.1} s", outcome.step, outcome.updates, outcome.elapsed_secs);
    Ok(())
}
