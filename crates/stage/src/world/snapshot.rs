//! Snapshots: the state of a world as plain numbers. A world that is restored from one continues
//! bit for bit.
#![allow(unsafe_code)] // Restores which key trees sleep; see the use.

use etude_music::{KEY_COUNT, KeySet};
use mujoco_rs::mujoco_c::{mjData, mjModel, mjtState};
use serde::{Deserialize, Serialize};

use super::World;
use crate::controller::Controller;
use crate::hand::DRIVEN_JOINTS;

/// The state of a [`World`], without its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    physics: Vec<f64>,
    asleep: Vec<i32>,
    derived_at: Vec<f64>,
    controllers: Vec<Controller>,
    pressed: KeySet,
    physics_steps: u64,
}

/// The snapshot was taken of another kind of world, or is damaged.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the snapshot does not fit this world: {0}")]
pub struct SnapshotError(&'static str);

const STATE: u32 = mjtState::mjSTATE_INTEGRATION as u32;

unsafe extern "C" {
    /// Updates which bodies and degrees of freedom are awake from which trees are. The library
    /// exports it, but its headers do not declare it; MuJoCo's version is pinned.
    fn mj_updateSleep(model: *const mjModel, data: *mut mjData);
}

/// Whether the links that are not negative form closed cycles. MuJoCo ends the process if they do
/// not.
fn are_cycles(asleep: &[i32]) -> bool {
    let mut reached = vec![false; asleep.len()];
    let mut links = asleep.iter().filter_map(|link| usize::try_from(*link).ok());
    // Each sleeping tree is pointed to exactly once, and only sleeping ones are.
    links.all(|next| next < asleep.len() && asleep[next] >= 0 && !std::mem::replace(&mut reached[next], true))
}

impl World {
    /// The current state.
    pub fn snapshot(&self) -> Snapshot {
        Snapshot {
            physics: self.data.state(STATE).into_vec(),
            asleep: self.data.tree_asleep().to_vec(),
            derived_at: self.derived_at.to_vec(),
            controllers: self.controllers.to_vec(),
            pressed: self.pressed,
            physics_steps: self.physics_steps,
        }
    }

    /// Continues from a snapshot of a world of the same kind. The physical numbers are not part of
    /// it.
    ///
    /// # Errors
    /// If the snapshot does not fit; the world has not changed then, except where the number of
    /// physical values is wrong.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<(), SnapshotError> {
        let trees = self.data.tree_asleep().len();
        if snapshot.asleep.len() != trees {
            return Err(SnapshotError("another number of kinematic trees"));
        }
        if snapshot.physics_steps > u64::from(u32::MAX) {
            return Err(SnapshotError("a clock that is too large"));
        }
        if !are_cycles(&snapshot.asleep) {
            return Err(SnapshotError("sleeping trees that form no cycles"));
        }
        let controllers: &[Controller; DRIVEN_JOINTS] = snapshot
            .controllers
            .as_slice()
            .try_into()
            .map_err(|_| SnapshotError("another number of joints"))?;
        if !controllers.iter().all(Controller::is_sound) {
            return Err(SnapshotError("a controller with a damaged queue"));
        }
        let derived_at: &[f64; KEY_COUNT] =
            snapshot.derived_at.as_slice().try_into().map_err(|_| SnapshotError("another number of keys"))?;
        // MuJoCo computes nothing for a sleeping tree. Its derived quantities, except its place,
        // stay as they were at the beginning of the step in which it fell asleep, and are used once
        // more in the step in which it wakes. So they are computed here with all trees awake, and
        // then the sleeping trees are put to sleep again.
        let wrong_size = |_| SnapshotError("another number of physical state values");
        self.data.reset();
        self.data.set_state(&snapshot.physics, STATE).map_err(wrong_size)?;
        self.put_keys(derived_at);
        self.data.forward();
        self.data.set_state(&snapshot.physics, STATE).map_err(wrong_size)?;
        self.data.kinematics();
        self.derived_at = *derived_at;
        // SAFETY: the length is checked above, the links are cycles, and the lists that the engine
        // keeps beside them are brought up to date at once: it would wake a sleeping tree that
        // those call awake.
        unsafe {
            self.data.tree_asleep_mut().copy_from_slice(&snapshot.asleep);
            let model = std::ptr::from_ref(self.data.model().ffi());
            mj_updateSleep(model, std::ptr::from_mut(self.data.ffi_mut()));
        }
        self.controllers.clone_from_slice(controllers);
        self.pressed = snapshot.pressed;
        self.physics_steps = snapshot.physics_steps;
        self.forget_last_step();
        Ok(())
    }
}
