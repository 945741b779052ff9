//! The world: MuJoCo's model and data, the joint controllers, and the keys that sound.
//!
//! Names are resolved to ids once, at construction. [`World::step`] neither allocates nor fails: it runs the physics
//! steps of one control step, drives every joint by its controller, watches the keys and classifies contacts.
#![allow(unsafe_code)] // MuJoCo's model is changed in place (parameters) and its sleep state restored; see each use.

use etude_music::{CONTROL_HZ, KEYS, KeyEvent, KeySet};
use mujoco_rs::prelude::{MjData, MjModel, MjtObjBase};

use crate::config::{ModelOptions, PHYSICS_STEPS, StageConfig};
use crate::contacts::Part;
use crate::controller::{Controller, Gains};
use crate::geometry::{HALF_WIDTH, KeyShape, WHITE};
use crate::hand::{
    FINGER_JOINTS, FINGER_NAMES, FINGER_RANGE, FINGERS, JOINT_NAMES, JOINTS, RAIL, TIP_RADIUS, root_lateral,
};
use crate::kinematics;
use crate::mjcf::{key_place, keyboard_place, mjcf_with, on_keyboard, passive_damping};
use crate::params::{Joint, PhysicalParams, World as Quantity};

/// The version of the MuJoCo library that is loaded.
pub fn mujoco_version() -> &'static str {
    mujoco_rs::mujoco_version()
}

/// A world could not be built.
#[derive(Debug, thiserror::Error)]
pub enum StageError {
    /// MuJoCo refused the model.
    #[error("MuJoCo refuses the model: {0}")]
    Model(String),
    /// The model has no object of this name: a bug in the model's text.
    #[error("the model has no {0}")]
    Missing(String),
}

/// Speed of a key at the threshold that sounds with the greatest MIDI velocity, rad/s: a finger at about 0.3 m/s.
const LOUDEST_RAD_PER_SEC: f64 = 2.0;
/// Room for key events of one control step.
const EVENTS: usize = KEYS * PHYSICS_STEPS;
/// How far the resting fingertips hover over the white keys at the start, m.
const HOVER: f64 = 0.018;

/// What happened during one control step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepOutcome {
    /// Mean over the physics steps of the summed power |torque · velocity| of the finger joints, W.
    pub finger_power: f64,
    /// The same of the rail, W.
    pub rail_power: f64,
    /// Whether anything but fingertips on the keyboard touched at any physics step.
    pub collided: bool,
    /// Whether these physical numbers ask for motion that the physics steps cannot follow: MuJoCo has met a position, velocity or
    /// acceleration beyond its bounds and started over with every joint at 0. What came of the step means nothing.
    pub unstable: bool,
}

/// Ids and addresses in the MuJoCo model.
#[derive(Clone)]
struct Layout {
    keyboard: usize,
    key_dof: [usize; KEYS],
    key_tree: [usize; KEYS],
    key_body: [usize; KEYS],
    key_geom: [usize; KEYS],
    joint_dof: [usize; JOINTS],
    tip_site: [usize; FINGERS],
    pad_site: [usize; FINGERS],
    geom_part: Vec<Part>,
}

/// A world that can be stepped.
pub struct World {
    pub(crate) data: MjData<Box<MjModel>>,
    layout: Layout,
    config: StageConfig,
    options: ModelOptions,
    params: PhysicalParams,
    gains: [Gains; JOINTS],
    threshold: [f64; KEYS],
    pub(crate) controllers: [Controller; JOINTS],
    pub(crate) pressed: KeySet,
    pub(crate) physics_steps: u64,
    /// Angles of the keys from which MuJoCo last computed what depends on them; see `snapshot`.
    pub(crate) derived_at: [f64; KEYS],
    torques: [f64; JOINTS],
    events: Vec<KeyEvent>,
}

/// What a joint's controller makes of a target, a measured position and a velocity: a torque.
type Law = fn(&mut Controller, &Gains, f64, f64, f64) -> f64;

fn id(model: &MjModel, kind: MjtObjBase, name: &str) -> Result<usize, StageError> {
    model.name_to_id(kind, name).ok_or_else(|| StageError::Missing(name.to_string()))
}

impl Layout {
    fn new(model: &MjModel) -> Result<Self, StageError> {
        // Every joint has one degree of freedom, so joint id, position and velocity address are one number.
        let dof = |name: &str| id(model, MjtObjBase::mjOBJ_JOINT, name);
        let mut layout = Self {
            keyboard: id(model, MjtObjBase::mjOBJ_BODY, "keyboard")?,
            key_dof: [0; KEYS],
            key_tree: [0; KEYS],
            key_body: [0; KEYS],
            key_geom: [0; KEYS],
            joint_dof: [0; JOINTS],
            tip_site: [0; FINGERS],
            pad_site: [0; FINGERS],
            geom_part: vec![Part::OtherLink; model.geom_friction().len()],
        };
        for key in 0..KEYS {
            layout.key_dof[key] = dof(&format!("key_{key}"))?;
            // A key is never fixed, so it has a tree.
            layout.key_tree[key] = model.dof_treeid()[layout.key_dof[key]] as usize;
            layout.key_body[key] = id(model, MjtObjBase::mjOBJ_BODY, &format!("key_{key}"))?;
            layout.key_geom[key] = id(model, MjtObjBase::mjOBJ_GEOM, &format!("key_{key}"))?;
        }
        for (slot, name) in layout.joint_dof.iter_mut().zip(JOINT_NAMES) {
            *slot = dof(name)?;
        }
        for (finger, name) in FINGER_NAMES.iter().enumerate() {
            layout.tip_site[finger] = id(model, MjtObjBase::mjOBJ_SITE, &format!("{name}_tip"))?;
            layout.pad_site[finger] = id(model, MjtObjBase::mjOBJ_SITE, &format!("{name}_pad"))?;
        }
        for geom in 0..layout.geom_part.len() {
            let name = model.id_to_name(MjtObjBase::mjOBJ_GEOM, geom).unwrap_or_default();
            layout.geom_part[geom] = Part::of(name);
        }
        Ok(layout)
    }
}

impl World {
    /// Builds the world and puts it into its starting pose.
    pub fn new(config: &StageConfig, params: &PhysicalParams) -> Result<Self, StageError> {
        Self::with_options(config, params, &ModelOptions::default())
    }

    /// A world with options of its own, for whoever drives its joints by torques ([`drive`](Self::drive)).
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
            gains: std::array::from_fn(|joint| {
                Gains::new(params, joint, config.actuation, options.step_secs)
            }),
            threshold: [0.0; KEYS],
            controllers: std::array::from_fn(|_| Controller::at_rest(0.0)),
            pressed: KeySet::EMPTY,
            physics_steps: 0,
            derived_at: [0.0; KEYS],
            torques: [0.0; JOINTS],
            events: Vec::with_capacity(EVENTS),
        };
        world.set_params(params);
        world.reset();
        Ok(world)
    }

    /// Changes the physical numbers without building the model anew. Takes full effect with the next [`reset`](Self::reset).
    pub fn set_params(&mut self, params: &PhysicalParams) {
        let step = self.options.step_secs;
        let value = |quantity| params.world(quantity);
        for key in 0..KEYS {
            self.threshold[key] = value(Quantity::KeyThreshold) * self.lower_stop(key);
        }
        for joint in 0..JOINTS {
            self.gains[joint] = Gains::new(params, joint, self.config.actuation, step);
        }
        // SAFETY: only values change; no size, address or id table is touched.
        let model = unsafe { self.data.model_mut() };
        model.body_pos_mut()[self.layout.keyboard] = keyboard_place(params);
        for key in 0..KEYS {
            let dof = self.layout.key_dof[key];
            model.body_pos_mut()[self.layout.key_body[key]] =
                key_place(params, self.options.keyboard_yaw_rad, key);
            model.jnt_stiffness_mut()[dof] = value(Quantity::KeyStiffness) * self.options.keys[key].stiffness;
            model.dof_damping_mut()[dof] = value(Quantity::KeyDamping);
            model.dof_armature_mut()[dof] = value(Quantity::KeyArmature);
            model.geom_friction_mut()[self.layout.key_geom[key]][0] = value(Quantity::KeyFriction);
        }
        for joint in 0..JOINTS {
            let dof = self.layout.joint_dof[joint];
            model.dof_damping_mut()[dof] = passive_damping(&self.config, params, joint);
            model.dof_frictionloss_mut()[dof] = params.joint(Joint::Friction, joint);
            model.dof_armature_mut()[dof] = params.joint(Joint::Armature, joint);
        }
        // What MuJoCo derives from inertias, and scales contacts by, is for the new ones too.
        self.data.set_const();
        self.params = params.clone();
    }

    /// Back to the starting pose: keys at rest, the hand over the keyboard with its fingers bent above the white keys.
    pub fn reset(&mut self) {
        let pose = self.start_pose_true();
        self.reset_to(&pose);
    }

    /// Back to rest with the joints at `pose` (true angles; clamped to the joints' ranges) and the keys up.
    pub fn reset_to(&mut self, pose: &[f64; JOINTS]) {
        self.data.reset();
        for (joint, position) in pose.iter().enumerate() {
            let [low, high] = joint_range(joint);
            let position = position.clamp(low, high);
            self.data.qpos_mut()[self.layout.joint_dof[joint]] = position;
            self.controllers[joint].rest(self.gains[joint].measured(position));
        }
        self.pressed = KeySet::EMPTY;
        self.physics_steps = 0;
        self.derived_at = [0.0; KEYS];
        self.data.forward();
        self.forget_last_step();
    }

    /// Nothing has happened since this moment; the torques are those that the state holds.
    pub(crate) fn forget_last_step(&mut self) {
        self.torques.copy_from_slice(self.data.ctrl());
        self.events.clear();
    }

    /// Puts the world into a pose in which nothing moves: joints at these encoder readings, the keys of `down` at their
    /// lower stops and sounding, the others at rest. For whoever shows or judges a moment of a recording.
    pub fn pose(&mut self, readings: &[f64; JOINTS], down: KeySet) {
        let bias = |joint: usize| self.gains[joint].measured(0.0);
        let pose: [f64; JOINTS] = std::array::from_fn(|joint| readings[joint] - bias(joint));
        self.reset_to(&pose);
        let angles = std::array::from_fn(|key| if down.contains(key) { self.lower_stop(key) } else { 0.0 });
        self.put_keys(&angles);
        self.pressed = down;
        self.data.forward();
    }

    /// Moves the keys to these angles.
    pub(crate) fn put_keys(&mut self, angles: &[f64; KEYS]) {
        let positions = self.data.qpos_mut();
        for (dof, angle) in self.layout.key_dof.iter().zip(angles) {
            positions[*dof] = *angle;
        }
    }

    fn start_pose_true(&self) -> [f64; JOINTS] {
        let mut pose = [0.0; JOINTS];
        pose[RAIL] = self.params.world(Quantity::HandStart).clamp(-HALF_WIDTH, HALF_WIDTH);
        let (x, z) = (WHITE.target()[0], WHITE.top() + TIP_RADIUS + HOVER);
        for finger in 0..FINGERS {
            let y = root_lateral(self.config.side, finger) + pose[RAIL];
            let angles = kinematics::reach(self.config.side, finger, [x, y, z], pose[RAIL]);
            pose[finger * FINGER_JOINTS..][..FINGER_JOINTS]
                .copy_from_slice(&angles.unwrap_or([0.0; FINGER_JOINTS]));
        }
        pose
    }

    /// The starting pose as the encoders read it: targets that hold the hand still.
    pub fn start_pose(&self) -> [f64; JOINTS] {
        let pose = self.start_pose_true();
        std::array::from_fn(|joint| self.gains[joint].measured(pose[joint]))
    }

    /// One control step toward `targets` (encoder readings: rad, the rail in m). Targets beyond a joint's range are
    /// clamped to what the encoder reads at its ends.
    pub fn step(&mut self, targets: &[f64; JOINTS]) -> StepOutcome {
        self.step_watched(targets, |_| {})
    }

    /// As [`step`](Self::step), calling `watch` after each physics step.
    pub fn step_watched(&mut self, targets: &[f64; JOINTS], watch: impl FnMut(&Self)) -> StepOutcome {
        self.control_step(|_| targets, Controller::torque, watch)
    }

    /// One control step in which the joints follow `waypoints`, one a physics step, as they come: what a robot does with
    /// set-points that were shaped already. Calls `watch` after each physics step.
    pub fn track_watched(
        &mut self,
        waypoints: &[[f64; JOINTS]; PHYSICS_STEPS],
        watch: impl FnMut(&Self),
    ) -> StepOutcome {
        self.control_step(|step| &waypoints[step], Controller::track, watch)
    }

    fn control_step<'a>(
        &mut self,
        wanted: impl Fn(usize) -> &'a [f64; JOINTS],
        law: Law,
        mut watch: impl FnMut(&Self),
    ) -> StepOutcome {
        let mut outcome = StepOutcome::default();
        self.events.clear();
        let begun = self.data.ffi().time;
        for step in 0..PHYSICS_STEPS {
            self.physics_step(wanted(step), law, &mut outcome);
            watch(self);
        }
        // Where MuJoCo starts over, its clock does too.
        let due = begun + (PHYSICS_STEPS as f64 - 0.5) * self.options.step_secs;
        outcome.unstable = self.data.ffi().time < due;
        outcome.finger_power /= PHYSICS_STEPS as f64;
        outcome.rail_power /= PHYSICS_STEPS as f64;
        outcome
    }

    fn physics_step(&mut self, targets: &[f64; JOINTS], law: Law, outcome: &mut StepOutcome) {
        for (joint, target) in targets.iter().enumerate() {
            let dof = self.layout.joint_dof[joint];
            let [low, high] = joint_range(joint);
            let (position, velocity) = (self.data.qpos()[dof], self.data.qvel()[dof]);
            let gains = &self.gains[joint];
            let target = target.clamp(gains.measured(low), gains.measured(high));
            let torque = law(&mut self.controllers[joint], gains, target, gains.measured(position), velocity);
            let power = (torque * velocity).abs();
            if joint == RAIL {
                outcome.rail_power += power
            } else {
                outcome.finger_power += power
            }
            self.torques[joint] = torque;
        }
        outcome.collided |= self.advance();
    }

    /// One physics step under these torques (N·m, the rail in N) instead of the joint controllers', for a robot that is
    /// emulated with drives of its own. Events are those of this step. Returns whether anything but fingertips on the
    /// keyboard touched.
    pub fn drive(&mut self, torques: &[f64; JOINTS]) -> bool {
        self.events.clear();
        self.torques = *torques;
        self.advance()
    }

    /// Changes the dry friction of the joints from now on, N·m, the rail's in N: for joints that hold faster at rest than
    /// on their way. Values below zero and none at all count as zero.
    pub fn set_joint_friction(&mut self, friction: &[f64; JOINTS]) {
        // SAFETY: only values change; no size, address or id table is touched.
        let model = unsafe { self.data.model_mut() };
        for (dof, friction) in self.layout.joint_dof.iter().zip(friction) {
            model.dof_frictionloss_mut()[*dof] = friction.max(0.0);
        }
    }

    /// One physics step under the torques that are set; whether there was a collision.
    fn advance(&mut self) -> bool {
        self.data.ctrl_mut().copy_from_slice(&self.torques);
        for key in 0..KEYS {
            if self.data.tree_asleep()[self.layout.key_tree[key]] < 0 {
                self.derived_at[key] = self.data.qpos()[self.layout.key_dof[key]];
            }
        }
        self.data.step();
        self.physics_steps += 1;
        self.watch_keys();
        self.collision()
    }

    fn watch_keys(&mut self) {
        let secs = self.physics_steps as f64 * self.options.step_secs;
        let angles = self.data.qpos();
        let velocities = self.data.qvel();
        let mut now = KeySet::EMPTY;
        for key in 0..KEYS {
            if angles[self.layout.key_dof[key]] >= self.threshold[key] {
                now.insert(key);
            }
        }
        if now == self.pressed {
            return;
        }
        for key in now.difference(self.pressed).iter() {
            let speed = velocities[self.layout.key_dof[key]] / LOUDEST_RAD_PER_SEC;
            let velocity = (speed.clamp(0.0, 1.0) * 126.0).round() as u8 + 1;
            self.events.push(KeyEvent { secs, key, velocity });
        }
        for key in self.pressed.difference(now).iter() {
            self.events.push(KeyEvent { secs, key, velocity: 0 });
        }
        self.pressed = now;
    }

    fn collision(&self) -> bool {
        self.data.contact().iter().any(|contact| {
            // A geom id is negative only for a flex element, and this model has none.
            let part = |geom: i32| self.layout.geom_part[geom as usize];
            part(contact.geom[0]).collide(part(contact.geom[1]))
        })
    }

    /// Joint positions as the encoders read them: rad, the rail in m.
    pub fn joints(&self) -> [f64; JOINTS] {
        let places = self.joints_true();
        std::array::from_fn(|joint| self.gains[joint].measured(places[joint]))
    }

    /// Joint positions as they are, whatever the encoders read: rad, the rail in m.
    pub fn joints_true(&self) -> [f64; JOINTS] {
        self.layout.joint_dof.map(|dof| self.data.qpos()[dof])
    }

    /// Joint velocities, rad/s, the rail in m/s.
    pub fn joint_velocities(&self) -> [f64; JOINTS] {
        std::array::from_fn(|j| self.data.qvel()[self.layout.joint_dof[j]])
    }

    /// Torques of the last physics step, N·m, the rail in N.
    pub fn torques(&self) -> &[f64; JOINTS] {
        &self.torques
    }

    /// Keys that are past their threshold.
    pub fn pressed(&self) -> KeySet {
        self.pressed
    }

    /// How far a key is down: 0 at rest, 1 at the lower stop (below 0 while it rebounds).
    pub fn key_travel(&self, key: usize) -> f64 {
        self.data.qpos()[self.layout.key_dof[key]] / self.lower_stop(key)
    }

    /// Angle of a key at its lower stop, rad.
    fn lower_stop(&self, key: usize) -> f64 {
        KeyShape::of(key).max_angle() * self.options.keys[key].travel
    }

    /// Strikes and releases of the last control step, in order, at the time of their physics step.
    pub fn events(&self) -> &[KeyEvent] {
        &self.events
    }

    /// Centre of a finger's rounded tip in the world, m. After a step it is where the tip was before the last physics step: MuJoCo
    /// places sites before it integrates.
    pub fn fingertip(&self, finger: usize) -> [f64; 3] {
        self.data.site_xpos()[self.layout.tip_site[finger]]
    }

    /// A finger's pad in the world, m: what the rewards measure from. As old as [`fingertip`](Self::fingertip).
    pub fn finger_pad(&self, finger: usize) -> [f64; 3] {
        self.data.site_xpos()[self.layout.pad_site[finger]]
    }

    /// Point of key `key` (at rest) that a fingertip should aim for, in the world, m.
    pub fn key_target(&self, key: usize) -> [f64; 3] {
        let target = crate::geometry::key_target(key);
        on_keyboard(&self.params, self.options.keyboard_yaw_rad, target)
    }

    /// Time since the last reset, s.
    pub fn time_secs(&self) -> f64 {
        self.physics_steps as f64 * self.options.step_secs
    }

    /// Kinetic and potential energy of the world, J, as MuJoCo computes it.
    pub fn energy(&mut self) -> f64 {
        self.data.energy_pos();
        self.data.energy_vel();
        self.data.energy().iter().sum()
    }

    /// What kind of world this is.
    pub fn config(&self) -> &StageConfig {
        &self.config
    }

    /// The physical numbers in force.
    pub fn params(&self) -> &PhysicalParams {
        &self.params
    }

    /// MuJoCo's data, for measurements and pictures.
    pub fn data(&self) -> &MjData<Box<MjModel>> {
        &self.data
    }

    /// One bare `mj_step` under `torques`, without controllers, keys or contacts being looked at: what a benchmark
    /// compares [`step`](Self::step) with.
    pub fn bare_physics_step(&mut self, torques: &[f64; JOINTS]) {
        self.data.ctrl_mut().copy_from_slice(torques);
        self.data.step();
    }
}

/// Range of a joint's target: rad, the rail in m.
pub fn joint_range(joint: usize) -> [f64; 2] {
    if joint == RAIL { [-HALF_WIDTH, HALF_WIDTH] } else { FINGER_RANGE[joint % FINGER_JOINTS] }
}

// The physics and control rates must divide: ten physics steps make one control step.
const _: () = assert!(CONTROL_HZ * PHYSICS_STEPS as f64 == 200.0);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::KeyFactors;

    /// A key of half the travel is down, and sounds, half as deep as its neighbours; in a world whose numbers were changed
    /// since, too.
    #[test]
    fn a_keys_travel_is_its_own() {
        let mut keys = ModelOptions::default().keys;
        keys[7] = KeyFactors { stiffness: 1.0, travel: 0.5 };
        let (config, params) = (StageConfig::default(), PhysicalParams::default());
        let options = ModelOptions { keys, ..ModelOptions::default() };
        let mut world = World::with_options(&config, &params, &options).unwrap();
        world.set_params(&params);
        world.put_keys(&std::array::from_fn(|key| 0.3 * KeyShape::of(key).max_angle()));
        assert!((world.key_travel(5) - 0.3).abs() < 1e-12 && (world.key_travel(7) - 0.6).abs() < 1e-12);
        world.watch_keys();
        assert_eq!(world.pressed().iter().collect::<Vec<_>>(), [7]);
    }

    #[test]
    fn friction_of_the_joints_can_change_on_the_way() {
        let mut world = World::new(&StageConfig::default(), &PhysicalParams::default()).unwrap();
        let push = |world: &mut World| {
            let before = world.joints()[4];
            let torques = std::array::from_fn(|joint| if joint == 4 { 0.05 } else { 0.0 });
            for _ in 0..20 {
                world.drive(&torques);
            }
            world.joints()[4] - before
        };
        world.set_joint_friction(&[0.2; JOINTS]);
        let held = push(&mut world);
        world.set_joint_friction(&[f64::NAN; JOINTS]);
        let free = push(&mut world);
        assert!(held.abs() < 0.02 && free > 5.0 * held.abs(), "{held} {free}");
    }
}
