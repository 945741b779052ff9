//! A replica of the world that is built only from public parts: the exported model in plain MuJoCo,
//! driven by the public controllers. The tests of `etude-task` include this file too.
//!
//! Where it and [`World`] agree bit for bit, nothing hidden happens in `World::step`, and what
//! holds for its torques and positions at each *physics* step (which `World` does not show) holds
//! for the world.
#![allow(dead_code)] // Not every test needs all of it.

use etude_music::{KEY_COUNT, KeySet};
use etude_stage::controller::{Controller, ControllerConstants};
use etude_stage::geometry::KeyShape;
use etude_stage::params::{JointRow, WorldRow};
use etude_stage::{DRIVEN_JOINTS, PHYSICS_STEPS, World, joint_range, mjcf};
use mujoco_rs::prelude::{MjData, MjModel, MjtObjBase};

/// Physics step, s (design: 200 Hz).
pub const STEP_SECS: f64 = 0.005;

/// The exported model in plain MuJoCo, driven by the public controllers.
pub struct Replica {
    /// The data of the model.
    pub data: MjData<Box<MjModel>>,
    /// Degrees of freedom of the joints, and of the keys.
    pub dofs: [usize; DRIVEN_JOINTS],
    keys: [usize; KEY_COUNT],
    threshold: f64,
    gains: [ControllerConstants; DRIVEN_JOINTS],
    controllers: [Controller; DRIVEN_JOINTS],
}

impl Replica {
    /// A replica of `world` in its starting pose; `edit` may change the text of the model.
    pub fn of(world: &World, edit: impl FnOnce(String) -> String) -> Self {
        let model = MjModel::from_xml_string(&edit(mjcf(world.config(), world.params()))).unwrap();
        let dof = |name: &str| model.name_to_id(MjtObjBase::mjOBJ_JOINT, name).unwrap();
        let dofs = etude_stage::JOINT_NAMES.map(dof);
        let keys = std::array::from_fn(|key| dof(&format!("key_{key}")));
        let threshold = world.params().world(WorldRow::KeyThreshold);
        let mut data = MjData::try_new(Box::new(model)).unwrap();
        let actuation = world.config().actuation;
        let gains = std::array::from_fn(|joint| {
            ControllerConstants::new(world.params(), joint, actuation, STEP_SECS)
        });
        let readings = world.start_pose();
        for (joint, dof) in dofs.into_iter().enumerate() {
            let bias = world.params().joint(JointRow::EncoderBias, joint);
            data.qpos_mut()[dof] = readings[joint] - bias;
        }
        data.forward();
        Self { data, dofs, keys, threshold, gains, controllers: readings.map(Controller::at_rest) }
    }

    /// The torques that the controllers ask for now. Advances the controllers.
    pub fn torques(&mut self, targets: &[f64; DRIVEN_JOINTS]) -> [f64; DRIVEN_JOINTS] {
        std::array::from_fn(|joint| {
            let dof = self.dofs[joint];
            let [low, high] = joint_range(joint);
            let (position, velocity) = (self.data.qpos()[dof], self.data.qvel()[dof]);
            let gains = &self.gains[joint];
            self.controllers[joint].step(
                gains,
                targets[joint].clamp(low, high),
                gains.measured(position),
                velocity,
            )
        })
    }

    /// One physics step under these torques.
    pub fn physics_step(&mut self, torques: &[f64; DRIVEN_JOINTS]) {
        self.data.ctrl_mut().copy_from_slice(torques);
        self.data.step();
    }

    /// Plays all targets and keeps torques and positions of each physics step.
    pub fn record(&mut self, targets: &[[f64; DRIVEN_JOINTS]]) -> Vec<Moment> {
        let mut moments = Vec::with_capacity(targets.len() * PHYSICS_STEPS);
        for targets in targets {
            for _ in 0..PHYSICS_STEPS {
                let torques = self.torques(targets);
                self.physics_step(&torques);
                moments.push(Moment { torques, positions: self.data.qpos().to_vec() });
            }
        }
        moments
    }

    /// Where the joints are.
    pub fn joints(&self) -> [f64; DRIVEN_JOINTS] {
        self.dofs.map(|dof| self.data.qpos()[dof])
    }

    /// References of the joints' controllers.
    pub fn references(&self) -> [f64; DRIVEN_JOINTS] {
        std::array::from_fn(|joint| self.controllers[joint].reference())
    }

    /// Keys past the threshold at these positions of the model.
    pub fn down(&self, positions: &[f64]) -> KeySet {
        self.sounding(positions, KeySet::EMPTY, 0.0)
    }

    /// Keys that sound at these positions if those of `before` did, and a key is silent
    /// `hysteresis` of the threshold above it.
    pub fn sounding(&self, positions: &[f64], before: KeySet, hysteresis: f64) -> KeySet {
        let sounds = |key: &usize| {
            let share = if before.contains(*key) { 1.0 - hysteresis } else { 1.0 };
            positions[self.keys[*key]] >= share * self.threshold * KeyShape::of(*key).max_angle()
        };
        (0..KEY_COUNT).filter(sounds).collect()
    }

    /// Degree of freedom of the joint called `name`.
    pub fn dof(&self, name: &str) -> usize {
        self.data.model().name_to_id(MjtObjBase::mjOBJ_JOINT, name).unwrap()
    }

    /// Kinetic energy and the energy of the springs, J.
    pub fn energy(&mut self) -> f64 {
        self.data.energy_pos();
        self.data.energy_vel();
        self.data.energy().iter().sum()
    }
}

/// One physics step of a recording.
pub struct Moment {
    /// Torques in joint order.
    pub torques: [f64; DRIVEN_JOINTS],
    /// All positions of the model after the step.
    pub positions: Vec<f64>,
}

/// `xml` with `to` for every `from`, of which there must be one.
pub fn swap(xml: String, from: &str, to: &str) -> String {
    assert!(xml.contains(from), "{from}");
    xml.replace(from, to)
}
