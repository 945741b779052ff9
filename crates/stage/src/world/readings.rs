//! What can be read from a world: joints, torques, keys, fingertips.

use etude_music::{KeyEvent, KeySet};

use super::World;
use crate::geometry::KeyShape;
use crate::hand::DRIVEN_JOINTS;
use crate::mjcf::on_keyboard;
use crate::strike::Strike;

impl World {
    /// Joint positions as the encoders read them: rad, the rail in m.
    pub fn joints(&self) -> [f64; DRIVEN_JOINTS] {
        let places = self.joints_true();
        std::array::from_fn(|joint| self.constants[joint].measured(places[joint]))
    }

    /// True joint positions: rad, the rail in m.
    pub fn joints_true(&self) -> [f64; DRIVEN_JOINTS] {
        self.layout.joint_dof.map(|dof| self.data.qpos()[dof])
    }

    /// References of the joints' controllers, before their delays, as encoder readings: rad, the
    /// rail in m.
    pub fn references(&self) -> [f64; DRIVEN_JOINTS] {
        std::array::from_fn(|joint| self.controllers[joint].reference())
    }

    /// Joint velocities, rad/s, the rail in m/s.
    pub fn joint_velocities(&self) -> [f64; DRIVEN_JOINTS] {
        std::array::from_fn(|j| self.data.qvel()[self.layout.joint_dof[j]])
    }

    /// Torques of the last physics step, N·m, the rail in N.
    pub fn torques(&self) -> &[f64; DRIVEN_JOINTS] {
        &self.torques
    }

    /// Keys that sound: down past their threshold, and since then not risen above where they are
    /// silent.
    pub fn pressed(&self) -> KeySet {
        self.pressed
    }

    /// How far a key is down, as a fraction of its travel: 0 at rest, 1 at the lower stop, below 0
    /// while it rebounds.
    pub fn key_travel(&self, key: usize) -> f64 {
        self.data.qpos()[self.layout.key_dof[key]] / self.lower_stop(key)
    }

    /// How far a key was down at most in the last control step, as a fraction of its travel.
    pub fn deepest_travel(&self, key: usize) -> f64 {
        self.deepest[key] / self.lower_stop(key)
    }

    /// Angle of a key at its lower stop, rad.
    pub(super) fn lower_stop(&self, key: usize) -> f64 {
        KeyShape::of(key).max_angle() * self.options.keys[key].travel
    }

    /// Strikes and releases of the last control step in order of time, with the time of their
    /// physics step.
    pub fn events(&self) -> &[KeyEvent] {
        &self.events
    }

    /// Centre of a finger's rounded tip in the world frame, m. It lags by one physics step: MuJoCo
    /// computes sites before it integrates.
    pub fn fingertip(&self, finger: usize) -> [f64; 3] {
        self.data.site_xpos()[self.layout.tip_site[finger]]
    }

    /// A finger's pad in the world frame, m, from which the rewards measure. It lags like
    /// [`fingertip`](Self::fingertip).
    pub fn finger_pad(&self, finger: usize) -> [f64; 3] {
        self.data.site_xpos()[self.layout.pad_site[finger]]
    }

    /// Point of key `key` at rest that a fingertip should aim for, in the world frame, m.
    pub fn key_target(&self, key: usize) -> [f64; 3] {
        let target = crate::geometry::key_target(key);
        on_keyboard(&self.params, self.options.keyboard_yaw_rad, target)
    }

    /// Strikes of the last control step in order of time, with how hard they were.
    pub fn strikes(&self) -> &[Strike] {
        &self.strikes
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
}
