//! The world: MuJoCo's model and data, with the joint controllers and the keys.
//!
//! Read in this order: this file builds a world, changes its physical numbers and puts it into a
//! pose; `step` advances it; `readings` reads it; `snapshot` saves and restores it; `layout` has
//! the ids of everything in the MuJoCo model.
#![allow(unsafe_code)] // MuJoCo's model is changed in place (physical numbers); see the use.

mod interlock;
mod layout;
mod readings;
mod snapshot;
mod step;
#[cfg(test)]
mod tests;

use etude_music::{CONTROL_HZ, KEY_COUNT, KeyEvent, KeySet};
use mujoco_rs::prelude::{MjData, MjModel};

use crate::config::{ModelOptions, PHYSICS_STEPS, StageConfig};
use crate::controller::{Controller, ControllerConstants};
use crate::error::StageError;
use crate::geometry::{HALF_WIDTH, WHITE};
use crate::hand::{DRIVEN_JOINTS, FINGERS, JOINTS_PER_FINGER, RAIL, TIP_RADIUS, joint_range, root_lateral};
use crate::kinematics;
use crate::mjcf::{
    key_colour, key_place, key_range, key_spring_rest, keyboard_place, mjcf_with, passive_damping,
};
use crate::params::{JointRow, PhysicalParams, WorldRow};
use crate::strike::Strike;
pub use interlock::{MAX_AHEAD_M, drag_ways_m};
use layout::Layout;
pub use snapshot::{Snapshot, SnapshotError};
pub use step::StepOutcome;

// The physics and control rates must divide: ten physics steps make one control step.
const _: () = assert!(CONTROL_HZ * PHYSICS_STEPS as f64 == 200.0);

/// Room for the key events of one control step.
const EVENTS: usize = KEY_COUNT * PHYSICS_STEPS;
/// Height of the fingertips over the white keys in the starting pose, m.
const HOVER: f64 = 0.018;

/// A world that can be stepped.
pub struct World {
    /// Also used by `picture`, which draws it.
    pub(crate) data: MjData<Box<MjModel>>,
    layout: Layout,
    config: StageConfig,
    options: ModelOptions,
    params: PhysicalParams,
    constants: [ControllerConstants; DRIVEN_JOINTS],
    /// Whether a joint's dry friction is greater at rest.
    sticks: bool,
    /// Angle of each key from which on it sounds, rad.
    threshold: [f64; KEY_COUNT],
    /// Angle of each key below which it is silent again, rad; at most its threshold.
    release: [f64; KEY_COUNT],
    controllers: [Controller; DRIVEN_JOINTS],
    pressed: KeySet,
    /// Physics steps since the last reset.
    physics_steps: u64,
    /// Key angles at which MuJoCo last computed the quantities that depend on them; see `snapshot`.
    derived_at: [f64; KEY_COUNT],
    /// Torques of the last physics step, N·m, the rail's in N.
    torques: [f64; DRIVEN_JOINTS],
    /// Key events of the last control step.
    events: Vec<KeyEvent>,
    /// Strikes of the last control step.
    strikes: Vec<Strike>,
    /// Greatest angle of each key since the last control step began, rad.
    deepest: [f64; KEY_COUNT],
}

impl World {
    /// Builds the world of the simulator and puts it into its starting pose.
    ///
    /// # Errors
    /// If MuJoCo refuses the model.
    pub fn new(config: &StageConfig, params: &PhysicalParams) -> Result<Self, StageError> {
        Self::with_options(config, params, &ModelOptions::default())
    }

    /// Builds a world with model options other than the simulator's, as the twin does.
    ///
    /// # Errors
    /// If MuJoCo refuses the model.
    pub fn with_options(
        config: &StageConfig,
        params: &PhysicalParams,
        options: &ModelOptions,
    ) -> Result<Self, StageError> {
        let xml = mjcf_with(config, params, options);
        let model = MjModel::from_xml_string(&xml).map_err(|e| StageError::Model(e.to_string()))?;
        let layout = Layout::new(&model)?;
        let data = MjData::try_new(Box::new(model)).map_err(|e| StageError::Model(e.to_string()))?;
        let mut world = Self {
            data,
            layout,
            config: config.clone(),
            options: options.clone(),
            params: params.clone(),
            constants: std::array::from_fn(|joint| {
                ControllerConstants::new(params, joint, config.actuation, options.step_secs)
            }),
            sticks: false,
            threshold: [0.0; KEY_COUNT],
            release: [0.0; KEY_COUNT],
            controllers: std::array::from_fn(|_| Controller::at_rest(0.0)),
            pressed: KeySet::EMPTY,
            physics_steps: 0,
            derived_at: [0.0; KEY_COUNT],
            torques: [0.0; DRIVEN_JOINTS],
            events: Vec::with_capacity(EVENTS),
            strikes: Vec::with_capacity(EVENTS),
            deepest: [0.0; KEY_COUNT],
        };
        world.set_params(params);
        world.reset();
        Ok(world)
    }

    /// Changes the physical numbers without rebuilding the model. They take full effect with the
    /// next [`reset`](Self::reset).
    pub fn set_params(&mut self, params: &PhysicalParams) {
        let step = self.options.step_secs;
        let value = |quantity| params.world(quantity);
        for key in 0..KEY_COUNT {
            self.threshold[key] = value(WorldRow::KeyThreshold) * self.lower_stop(key);
            self.release[key] = self.threshold[key] * (1.0 - value(WorldRow::KeyHysteresis));
        }
        for joint in 0..DRIVEN_JOINTS {
            self.constants[joint] = ControllerConstants::new(params, joint, self.config.actuation, step);
        }
        let of_joint = |row, joint| params.joint(row, joint);
        self.sticks = (0..DRIVEN_JOINTS).any(|joint| {
            of_joint(JointRow::Friction, joint) > 0.0 && of_joint(JointRow::FrictionAtRest, joint) > 1.0
        });
        // SAFETY: only values change; no size, address or id table is touched.
        let model = unsafe { self.data.model_mut() };
        model.body_pos_mut()[self.layout.keyboard] = keyboard_place(params);
        for key in 0..KEY_COUNT {
            let dof = self.layout.key_dof[key];
            model.body_pos_mut()[self.layout.key_body[key]] =
                key_place(params, self.options.keyboard_yaw_rad, key);
            model.jnt_stiffness_mut()[dof] = value(WorldRow::KeyStiffness) * self.options.keys[key].stiffness;
            model.qpos_spring_mut()[dof] = key_spring_rest(params, &self.options, key);
            model.jnt_range_mut()[dof] = key_range(params, &self.options, key);
            model.dof_damping_mut()[dof] = value(WorldRow::KeyDamping);
            model.dof_armature_mut()[dof] = value(WorldRow::KeyArmature);
            model.geom_friction_mut()[self.layout.key_geom[key]][0] = value(WorldRow::KeyFriction);
        }
        for joint in 0..DRIVEN_JOINTS {
            let dof = self.layout.joint_dof[joint];
            model.dof_damping_mut()[dof] = passive_damping(&self.config, params, joint);
            model.dof_frictionloss_mut()[dof] = params.joint(JointRow::Friction, joint);
            model.dof_armature_mut()[dof] = params.joint(JointRow::Armature, joint);
        }
        // MuJoCo derives constants from the inertias, such as the scaling of contacts: compute them
        // again.
        self.data.set_const();
        self.params = params.clone();
    }

    /// Resets to the starting pose: keys at rest, the hand over the keyboard, its fingers bent
    /// above the white keys.
    pub fn reset(&mut self) {
        let pose = self.start_pose_true();
        self.reset_to(&pose);
    }

    /// Resets with the joints at `pose` and the keys up. `pose` holds true positions (rad, the rail
    /// in m), which are clamped to the joints' ranges.
    pub fn reset_to(&mut self, pose: &[f64; DRIVEN_JOINTS]) {
        self.data.reset();
        for (joint, position) in pose.iter().enumerate() {
            let [low, high] = joint_range(joint);
            let position = position.clamp(low, high);
            let dof = self.layout.joint_dof[joint];
            self.data.qpos_mut()[dof] = position;
            self.data.qfrc_applied_mut()[dof] = self.params.joint(JointRow::Load, joint);
            self.controllers[joint].reset_to_rest(self.constants[joint].measured(position));
        }
        self.pressed = KeySet::EMPTY;
        self.physics_steps = 0;
        self.derived_at = [0.0; KEY_COUNT];
        if self.sticks {
            self.set_friction();
        }
        self.data.forward();
        self.forget_last_step();
    }

    /// Clears the events, and reads the torques from MuJoCo's state.
    fn forget_last_step(&mut self) {
        self.torques.copy_from_slice(self.data.ctrl());
        self.events.clear();
        self.strikes.clear();
    }

    /// Puts the world into a pose in which nothing moves: the joints at these encoder readings
    /// (rad, the rail in m), the keys of `down` pressed to their lower stops, the others at rest.
    /// Used to show or to evaluate a moment of a recording.
    pub fn pose(&mut self, readings: &[f64; DRIVEN_JOINTS], down: KeySet) {
        let bias = |joint: usize| self.constants[joint].measured(0.0);
        let pose: [f64; DRIVEN_JOINTS] = std::array::from_fn(|joint| readings[joint] - bias(joint));
        self.reset_to(&pose);
        let angles = std::array::from_fn(|key| if down.contains(key) { self.lower_stop(key) } else { 0.0 });
        self.put_keys(&angles);
        self.pressed = down;
        self.data.forward();
    }

    /// Gives keys these colours (red, green, blue, 0 to 1) in pictures, the others their own.
    pub fn colour_keys(&mut self, colours: &[Option<[f32; 3]>; KEY_COUNT]) {
        // SAFETY: only values change; no size, address or id table is touched.
        let model = unsafe { self.data.model_mut() };
        for (key, colour) in colours.iter().enumerate() {
            model.geom_rgba_mut()[self.layout.key_geom[key]][..3]
                .copy_from_slice(&colour.unwrap_or_else(|| key_colour(key)));
        }
    }

    /// Moves the keys to these angles, rad.
    fn put_keys(&mut self, angles: &[f64; KEY_COUNT]) {
        let positions = self.data.qpos_mut();
        for (dof, angle) in self.layout.key_dof.iter().zip(angles) {
            positions[*dof] = *angle;
        }
    }

    /// The starting pose in true positions.
    fn start_pose_true(&self) -> [f64; DRIVEN_JOINTS] {
        let mut pose = [0.0; DRIVEN_JOINTS];
        pose[RAIL] = self.params.world(WorldRow::HandStart).clamp(-HALF_WIDTH, HALF_WIDTH);
        let (x, z) = (WHITE.target()[0], WHITE.top() + TIP_RADIUS + HOVER);
        for finger in 0..FINGERS {
            let y = root_lateral(self.config.side, finger) + pose[RAIL];
            let angles = kinematics::reach(self.config.side, finger, [x, y, z], pose[RAIL]);
            pose[finger * JOINTS_PER_FINGER..][..JOINTS_PER_FINGER]
                .copy_from_slice(&angles.unwrap_or([0.0; JOINTS_PER_FINGER]));
        }
        pose
    }

    /// The starting pose in encoder readings (rad, the rail in m). As targets they hold the hand
    /// still.
    pub fn start_pose(&self) -> [f64; DRIVEN_JOINTS] {
        let pose = self.start_pose_true();
        std::array::from_fn(|joint| self.constants[joint].measured(pose[joint]))
    }

    /// The configuration that it was built with.
    pub fn config(&self) -> &StageConfig {
        &self.config
    }

    /// The physical numbers in force.
    pub fn params(&self) -> &PhysicalParams {
        &self.params
    }

    /// MuJoCo's data.
    pub fn data(&self) -> &MjData<Box<MjModel>> {
        &self.data
    }
}
