//! A rig: a hand at a keyboard, simulated or real. It shows joints and keys, and it moves for one
//! control step at a time.
//!
//! An execution mode (paper, appendix "Execution Modes") is a way to put a rig together:
//! [`Mode::rig`](crate::Mode::rig).

use etude_task::{Command, RigState};

use crate::performance::{Ending, Performance, PlayedStep};
use crate::{PerformError, Recorder};

/// The fault of a simulation that became unstable.
pub(crate) const UNSTABLE: &str = "the simulation became unstable; give its physical parameters values closer to \
     the defaults (`etude model params`)";

/// A control step as it was played, or how the performance ended in it.
pub type StepEnd = Result<PlayedStep, Ending>;

/// Moves to joint targets at a keyboard. [`perform`](crate::perform) calls it.
pub trait Rig {
    /// Begins a performance: time zero, in the starting pose. A simulation is put there; a robot
    /// must be there already ([`prepare`](crate::prepare())).
    ///
    /// # Errors
    /// If a recording cannot be written.
    fn begin(&mut self) -> Result<(), PerformError>;

    /// The joints and keys now.
    fn state(&self) -> RigState;

    /// Does `work`, such as the player's computation. A robot is controlled meanwhile.
    fn run_while(&mut self, work: &mut (dyn FnMut() + Send)) {
        work();
    }

    /// Moves to the targets of `command` for one control step, and passes every key event and
    /// measurement to `recorder`. The player chose the action from `observation`.
    ///
    /// # Errors
    /// If a robot refuses the command, or the recording cannot be written.
    fn step(
        &mut self,
        command: &Command<'_>,
        observation: &[f32],
        recorder: &mut Recorder<'_>,
    ) -> Result<StepEnd, PerformError>;

    /// Comes to rest. Called after the last control step, however the performance ended.
    fn rest(&mut self);

    /// Adds to `performance` what only this kind of rig measures, and passes to `recorder` what is
    /// not yet recorded. A robot holds its pose until what it played last is heard.
    ///
    /// # Errors
    /// If the recording cannot be written.
    fn finish(
        &mut self,
        performance: &mut Performance,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), PerformError>;
}
