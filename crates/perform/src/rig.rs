//! A rig: a hand at a keyboard, simulated or real. It shows joints and keys, and it moves for one control step at a time.
//!
//! An execution mode (paper, appendix "Execution Modes") is a way to put a rig together: [`Mode::rig`](crate::Mode::rig).

use etude_music::KeySet;
use etude_stage::DRIVEN_JOINTS;
use etude_task::ACTION_LEN;

use crate::performance::{Ending, Performance, Stepped};
use crate::{PerformError, Recorder};

/// What a player may see of a rig.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigState {
    /// Joints as the encoders read them: rad, the rail in m.
    pub joints: [f64; DRIVEN_JOINTS],
    /// Set-points of the joints: rad, the rail in m.
    pub set_points: [f64; DRIVEN_JOINTS],
    /// Keys that sound.
    pub keys: KeySet,
}

/// The action of a player in one control step.
#[derive(Clone, Copy, Debug)]
pub struct Command<'a> {
    /// Index of the control step.
    pub step: usize,
    /// The observation on which the player acted.
    pub observation: &'a [f32],
    /// The action, −1 to 1.
    pub action: &'a [f32; ACTION_LEN],
    /// The joint targets of the action: rad, the rail in m.
    pub targets: [f64; DRIVEN_JOINTS],
}

/// The fault of a simulation that became unstable.
pub(crate) const UNSTABLE: &str = "the simulation became unstable; give its physical parameters values closer to the defaults (`etude model params`)";

/// Moves to joint targets at a keyboard. [`perform`](crate::perform) calls it.
pub trait Rig {
    /// Begins a performance: time zero, in the starting pose. A simulation is put there; a robot must be there already
    /// ([`prepare`](crate::prepare())).
    ///
    /// # Errors
    /// If a recording cannot be written.
    fn begin(&mut self) -> Result<(), PerformError>;

    /// What a player sees now.
    fn state(&self) -> RigState;

    /// Does `work`, such as the player's computation. A robot is controlled meanwhile.
    fn run_while(&mut self, work: &mut (dyn FnMut() + Send)) {
        work();
    }

    /// Moves for one control step, and passes every key event and measurement to `recorder`. Returns an `Ending` if the rig
    /// stopped during the step.
    ///
    /// # Errors
    /// If a robot refuses the command, or the recording cannot be written.
    fn step(
        &mut self,
        command: &Command<'_>,
        recorder: &mut Recorder<'_>,
    ) -> Result<Result<Stepped, Ending>, PerformError>;

    /// Comes to rest. Called after the last control step, however the performance ended.
    fn rest(&mut self);

    /// Adds to `performance` what only this kind of rig measures, and passes to `recorder` what is not yet recorded. A robot holds its pose until
    /// what it played last is heard.
    ///
    /// # Errors
    /// If the recording cannot be written.
    fn finish(
        &mut self,
        performance: &mut Performance,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), PerformError>;
}
