//! Snapshots: everything that a world needs to continue bit for bit, as plain numbers that can be stored.
#![allow(unsafe_code)] // Restores which key trees sleep; see the use.

use etude_music::KeySet;
use mujoco_rs::mujoco_c::mjtState;
use serde::{Deserialize, Serialize};

use crate::controller::Controller;
use crate::hand::JOINTS;
use crate::world::World;

/// The state of a [`World`], without its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    physics: Vec<f64>,
    asleep: Vec<i32>,
    controllers: Vec<Controller>,
    pressed: KeySet,
    physics_steps: u64,
}

/// The snapshot is of another kind of world.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the snapshot does not fit this world: {0}")]
pub struct SnapshotError(&'static str);

const STATE: u32 = mjtState::mjSTATE_INTEGRATION as u32;

impl World {
    /// The current state.
    pub fn snapshot(&self) -> Snapshot {
        Snapshot {
            physics: self.data.state(STATE).into_vec(),
            asleep: self.data.tree_asleep().to_vec(),
            controllers: self.controllers.to_vec(),
            pressed: self.pressed,
            physics_steps: self.physics_steps,
        }
    }

    /// Continues from a snapshot of a world of the same kind. The parameters stay as they are.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<(), SnapshotError> {
        let trees = self.data.tree_asleep().len();
        if snapshot.asleep.len() != trees {
            return Err(SnapshotError("another number of kinematic trees"));
        }
        if snapshot.asleep.iter().any(|next| *next >= trees as i32) {
            return Err(SnapshotError("a sleeping tree that does not exist"));
        }
        let controllers: &[Controller; JOINTS] =
            snapshot.controllers.as_slice().try_into().map_err(|_| SnapshotError("another number of joints"))?;
        if !controllers.iter().all(Controller::is_sound) {
            return Err(SnapshotError("a controller with a damaged queue"));
        }
        // Everything derived is computed while all trees are awake, then those that slept are put to sleep again:
        // the engine does not compute anything for a sleeping tree.
        self.data.reset();
        self.data
            .set_state(&snapshot.physics, STATE)
            .map_err(|_| SnapshotError("another number of physical state values"))?;
        self.data.forward();
        self.data
            .set_state(&snapshot.physics, STATE)
            .map_err(|_| SnapshotError("another number of physical state values"))?;
        // SAFETY: the length is checked above and every link of a sleep cycle points to an existing tree.
        unsafe { self.data.tree_asleep_mut() }.copy_from_slice(&snapshot.asleep);
        self.controllers.clone_from_slice(controllers);
        self.pressed = snapshot.pressed;
        self.physics_steps = snapshot.physics_steps;
        Ok(())
    }
}
