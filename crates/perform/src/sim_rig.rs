//! The simulator as a rig.

use etude_music::KeyEvent;
use etude_stage::{FINGERS, PhysicalParams, World};
use etude_task::{Environment, Piece, TaskConfig, TaskError};

use crate::messages::{RewardMessage, StepMessage};
use crate::performance::{Ending, Performance, Simulated, Stepped};
use crate::rig::{Command, Rig, RigState, UNSTABLE};
use crate::{PerformError, Recorder};

/// An [`Environment`] that plays its piece from the beginning, and sums up the reward.
pub struct SimRig {
    environment: Environment,
    seed: u64,
    /// Weighted reward terms of the last control step.
    terms: Vec<f32>,
    steps: usize,
    simulated: Simulated,
}

impl SimRig {
    /// A simulation of `piece` in the nominal world or, if `task` randomises, in the world that `seed` draws.
    ///
    /// # Errors
    /// If the configuration is not sound.
    pub fn new(task: &TaskConfig, piece: &Piece, seed: u64) -> Result<Self, TaskError> {
        let environment = Environment::new(task, piece, seed)?;
        let terms = vec![0.0; environment.reward().names().len()];
        Ok(Self { environment, seed, terms, steps: piece.steps(), simulated: Simulated::default() })
    }

    /// A simulation of `piece` in the nominal world, even if `task` randomises.
    ///
    /// # Errors
    /// If the configuration is not sound.
    pub fn nominal(task: &TaskConfig, piece: &Piece) -> Result<Self, TaskError> {
        Self::new(&task.without_randomness(), piece, 0)
    }

    /// A simulation of `piece` in the world `params`.
    ///
    /// # Errors
    /// If the configuration is not sound.
    pub fn in_world(task: &TaskConfig, piece: &Piece, params: &PhysicalParams) -> Result<Self, TaskError> {
        let mut rig = Self::nominal(task, piece)?;
        rig.environment.reset_in(params);
        Ok(rig)
    }

    /// The simulated world.
    pub fn world(&self) -> &World {
        self.environment.world()
    }

    fn record(
        &self,
        command: &Command<'_>,
        events: &[KeyEvent],
        recorder: &mut Recorder<'_>,
    ) -> Result<(), PerformError> {
        let world = self.world();
        for event in events {
            recorder.key(*event)?;
        }
        recorder.write(world.time_secs(), || StepMessage {
            step: command.step as u64,
            targets: command.targets.to_vec(),
            positions: world.joints().to_vec(),
            velocities: world.joint_velocities().to_vec(),
            torques: world.torques().to_vec(),
            fingertips: (0..FINGERS).map(|finger| world.fingertip(finger)).collect(),
            pressed: world.pressed().pitches().collect(),
        })?;
        recorder.write(world.time_secs(), || {
            let terms = self.environment.reward().names().zip(&self.terms);
            let terms = terms.map(|(name, value)| (name.to_string(), f64::from(*value))).collect();
            RewardMessage { step: command.step as u64, terms }
        })?;
        Ok(())
    }
}

impl Rig for SimRig {
    fn begin(&mut self) -> Result<(), PerformError> {
        self.environment.restart(self.seed);
        self.simulated = Simulated::default();
        Ok(())
    }

    fn state(&self) -> RigState {
        let world = self.world();
        RigState { joints: world.joints(), set_points: world.set_points(), keys: world.pressed() }
    }

    fn step(
        &mut self,
        command: &Command<'_>,
        recorder: &mut Recorder<'_>,
    ) -> Result<Result<Stepped, Ending>, PerformError> {
        let step = self.environment.step(command.action, &mut self.terms);
        if step.reward.is_nan() {
            return Ok(Err(Ending::Fault(UNSTABLE.to_string())));
        }
        self.simulated.reward += step.reward;
        if !step.collided {
            self.simulated.collision_free += 1.0 / self.steps as f64;
        }
        self.record(command, self.world().events(), recorder)?;
        Ok(Ok(Stepped { pressed: step.pressed, alongside: None }))
    }

    fn rest(&mut self) {}

    fn finish(&mut self, performance: &mut Performance, _: &mut Recorder<'_>) -> Result<(), PerformError> {
        performance.simulation = Some(self.simulated);
        Ok(())
    }
}
