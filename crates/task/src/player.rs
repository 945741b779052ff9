//! The interface of everything that chooses actions: a policy, the scripted baseline, an
//! excitation.

use etude_learn::Policy;

use crate::{ACTION_LEN, ScriptedBaseline};

/// Chooses the action of each control step of a performance.
pub trait Player: Send {
    /// Writes the action of control step `step` into `action`: 13 values, −1 to 1. `observation`
    /// has the [`layout`](crate::layout()) of the task that is played.
    fn act(&mut self, step: usize, observation: &[f32], action: &mut [f32; ACTION_LEN]);
}

/// A policy acts on the observation alone.
impl Player for Policy {
    fn act(&mut self, _: usize, observation: &[f32], action: &mut [f32; ACTION_LEN]) {
        Policy::act(self, observation, action);
    }
}

/// The scripted baseline acts on the time alone.
impl Player for ScriptedBaseline {
    fn act(&mut self, step: usize, _: &[f32], action: &mut [f32; ACTION_LEN]) {
        *action = self.action(step);
    }
}

impl<F: FnMut(usize, &[f32], &mut [f32; ACTION_LEN]) + Send> Player for F {
    fn act(&mut self, step: usize, observation: &[f32], action: &mut [f32; ACTION_LEN]) {
        self(step, observation, action);
    }
}
