//! The simulator as a rig.

use etude_stage::{FINGERS, PhysicalParams, World};
use etude_task::{Command, Piece, RigState, Simulation, TaskConfig, TaskError};

use crate::messages::{RewardMessage, StepMessage};
use crate::performance::{Ending, Performance, SimulationResult};
use crate::rig::{Rig, StepEnd, UNSTABLE};
use crate::{PerformError, PlayedStep, Recorder};

/// A [`Simulation`] that begins with the same random stream in each performance, and sums up the
/// reward.
pub struct SimRig {
    simulation: Simulation,
    piece: Piece,
    seed: u64,
    /// Weighted reward terms of the last control step.
    terms: Vec<f32>,
    result: SimulationResult,
}

impl SimRig {
    /// A simulation of `piece` in the nominal world or, if `task` randomises, in the world that
    /// `seed` draws.
    ///
    /// # Errors
    /// If the configuration is not valid.
    pub fn new(task: &TaskConfig, piece: &Piece, seed: u64) -> Result<Self, TaskError> {
        let simulation = Simulation::new(task, seed)?;
        let terms = vec![0.0; simulation.reward().names().len()];
        Ok(Self { simulation, piece: piece.clone(), seed, terms, result: SimulationResult::default() })
    }

    /// A simulation of `piece` in the nominal world, even if `task` randomises.
    ///
    /// # Errors
    /// If the configuration is not valid.
    pub fn nominal(task: &TaskConfig, piece: &Piece) -> Result<Self, TaskError> {
        Self::new(&task.without_randomness(), piece, 0)
    }

    /// A simulation of `piece` in the world `params`.
    ///
    /// # Errors
    /// If the configuration is not valid.
    pub fn in_world(task: &TaskConfig, piece: &Piece, params: &PhysicalParams) -> Result<Self, TaskError> {
        let mut rig = Self::nominal(task, piece)?;
        rig.simulation.set_params(params);
        Ok(rig)
    }

    /// The simulated world.
    pub fn world(&self) -> &World {
        self.simulation.world()
    }

    fn record(&self, command: &Command<'_>, recorder: &mut Recorder<'_>) -> Result<(), PerformError> {
        let (world, step) = (self.world(), command.step as u64);
        for event in world.events() {
            recorder.key(*event)?;
        }
        recorder.write(world.time_secs(), || StepMessage {
            step,
            targets: command.targets.to_vec(),
            positions: world.joints().to_vec(),
            velocities: world.joint_velocities().to_vec(),
            torques: world.torques().to_vec(),
            fingertips: (0..FINGERS).map(|finger| world.fingertip(finger)).collect(),
            pressed: world.pressed().pitches().collect(),
        })?;
        recorder.write(world.time_secs(), || {
            let terms = self.simulation.reward().names().zip(&self.terms);
            let terms = terms.map(|(name, value)| (name.to_string(), f64::from(*value))).collect();
            RewardMessage { step, terms }
        })?;
        Ok(())
    }
}

impl Rig for SimRig {
    fn begin(&mut self) -> Result<(), PerformError> {
        self.simulation.restart(self.seed);
        self.result = SimulationResult::default();
        Ok(())
    }

    fn state(&self) -> RigState {
        self.simulation.state()
    }

    fn step(
        &mut self,
        command: &Command<'_>,
        _: &[f32],
        recorder: &mut Recorder<'_>,
    ) -> Result<StepEnd, PerformError> {
        let result = self.simulation.step(&self.piece, command, &mut self.terms);
        if result.reward.is_nan() {
            return Ok(Err(Ending::Fault(UNSTABLE.to_string())));
        }
        self.result.reward += result.reward;
        if !result.collided {
            self.result.collision_free += 1.0 / self.piece.steps() as f64;
        }
        self.record(command, recorder)?;
        Ok(Ok(PlayedStep { pressed: result.pressed, simulated: None }))
    }

    fn rest(&mut self) {}

    fn finish(&mut self, performance: &mut Performance, _: &mut Recorder<'_>) -> Result<(), PerformError> {
        performance.simulation = Some(self.result);
        Ok(())
    }
}
