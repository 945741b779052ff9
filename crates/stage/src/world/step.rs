//! Stepping: joint controllers, physics, key events and collisions of one control step.
//!
//! Nothing here allocates or fails.
#![allow(unsafe_code)] // MuJoCo's model is changed in place (dry friction); see the use.

use etude_music::{KEY_COUNT, KeyEvent, KeySet};
use mujoco_rs::mujoco_c::mjtDisableBit;

use super::World;
use crate::config::PHYSICS_STEPS;
use crate::controller::{Controller, ControllerConstants};
use crate::hand::{DRIVEN_JOINTS, RAIL, joint_range};
use crate::mjcf::PALM_PLACE;
use crate::params::JointRow;
use crate::strike::{CONTACTS_APART, LOUDEST_SECS, SOFTEST_SECS, Strike, midi, unrounded_velocity};

/// Speed at which a joint has mostly broken loose from the friction that held it, rad/s, the rail
/// m/s: our choice, slower than any key is struck.
const BROKEN_LOOSE: f64 = 0.05;

/// What happened during one control step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepOutcome {
    /// Mean over the physics steps of the summed power |torque · velocity| of the finger joints, W.
    pub finger_power: f64,
    /// The same of the rail, W.
    pub rail_power: f64,
    /// Whether there was any contact other than a fingertip on the keyboard, at any physics step.
    pub collided: bool,
    /// Whether the simulation diverged: MuJoCo met a position, velocity or acceleration beyond its
    /// bounds and reset itself with every joint at 0. The results of the step are then meaningless.
    pub unstable: bool,
}

/// A control law: torque from controller state, constants, target, measured position and velocity.
type Law = fn(&mut Controller, &ControllerConstants, f64, f64, f64) -> f64;

impl World {
    /// One control step toward `targets` (encoder readings: rad, the rail in m), which are clamped
    /// to the joints' ranges.
    pub fn step(&mut self, targets: &[f64; DRIVEN_JOINTS]) -> StepOutcome {
        self.step_watched(targets, |_| {})
    }

    /// As [`step`](Self::step), calling `watch` after each physics step.
    pub fn step_watched(&mut self, targets: &[f64; DRIVEN_JOINTS], watch: impl FnMut(&Self)) -> StepOutcome {
        self.control_step(|_| targets, Controller::step, self.config.interlock, watch)
    }

    /// One control step that follows `waypoints`, one a physics step, without low-pass and limits:
    /// for set-points that were shaped already. Calls `watch` after each physics step.
    pub fn track_watched(
        &mut self,
        waypoints: &[[f64; DRIVEN_JOINTS]; PHYSICS_STEPS],
        watch: impl FnMut(&Self),
    ) -> StepOutcome {
        self.control_step(|step| &waypoints[step], Controller::step_tracking, false, watch)
    }

    fn control_step<'a>(
        &mut self,
        targets: impl Fn(usize) -> &'a [f64; DRIVEN_JOINTS],
        law: Law,
        interlock: bool,
        mut watch: impl FnMut(&Self),
    ) -> StepOutcome {
        let mut outcome = StepOutcome::default();
        self.events.clear();
        self.strikes.clear();
        self.deepest = [0.0; KEY_COUNT];
        let begun = self.data.ffi().time;
        for step in 0..PHYSICS_STEPS {
            self.physics_step(targets(step), law, interlock, &mut outcome);
            watch(self);
        }
        // When MuJoCo resets itself after diverging, its clock is reset too.
        let due = begun + (PHYSICS_STEPS as f64 - 0.5) * self.options.step_secs;
        outcome.unstable = self.data.ffi().time < due;
        outcome.finger_power /= PHYSICS_STEPS as f64;
        outcome.rail_power /= PHYSICS_STEPS as f64;
        outcome
    }

    fn physics_step(
        &mut self,
        targets: &[f64; DRIVEN_JOINTS],
        law: Law,
        interlock: bool,
        outcome: &mut StepOutcome,
    ) {
        let holds_rail = interlock && self.holds_rail(targets[RAIL]);
        for (joint, target) in targets.iter().enumerate() {
            let dof = self.layout.joint_dof[joint];
            let [low, high] = joint_range(joint);
            let (position, velocity) = (self.data.qpos()[dof], self.data.qvel()[dof]);
            let constants = &self.constants[joint];
            let target = target.clamp(constants.measured(low), constants.measured(high));
            let law = if holds_rail && joint == RAIL { Controller::step_braking } else { law };
            let torque =
                law(&mut self.controllers[joint], constants, target, constants.measured(position), velocity);
            let power = (torque * velocity).abs();
            if joint == RAIL {
                outcome.rail_power += power
            } else {
                outcome.finger_power += power
            }
            self.torques[joint] = torque;
        }
        self.advance();
        outcome.collided |= self.collision();
    }

    /// One physics step under these torques (N·m, the rail in N) instead of those of the joint
    /// controllers: the twin emulates the robot's own drives. The events are then those of this
    /// physics step.
    pub fn drive(&mut self, torques: &[f64; DRIVEN_JOINTS]) {
        self.events.clear();
        self.strikes.clear();
        self.torques = *torques;
        self.advance();
    }

    /// Sets the dry friction of the joints by their speeds: greatest at rest (Stribeck's curve).
    pub(super) fn set_friction(&mut self) {
        for joint in 0..DRIVEN_JOINTS {
            let dof = self.layout.joint_dof[joint];
            let friction = self.params.joint(JointRow::Friction, joint);
            let more = self.params.joint(JointRow::FrictionAtRest, joint) - 1.0;
            let hold = (-(self.data.qvel()[dof] / BROKEN_LOOSE).powi(2)).exp();
            // SAFETY: only a value changes; no size, address or id table is touched.
            let model = unsafe { self.data.model_mut() };
            model.dof_frictionloss_mut()[dof] = friction * (1.0 + more * hold);
        }
    }

    /// Puts the hand off its nominal place on the rail by this, m: an arm sags, and its links are
    /// not as its controller believes. The hand is moved there without a speed, so the offset must
    /// change slowly.
    pub fn set_hand_offset(&mut self, offset: [f64; 3]) {
        // SAFETY: only values change; no size, address or id table is touched.
        let model = unsafe { self.data.model_mut() };
        model.body_pos_mut()[self.layout.palm] = std::array::from_fn(|axis| PALM_PLACE[axis] + offset[axis]);
    }

    /// Whether bodies can touch each other; from the start they can. Half of the time of a step is
    /// spent on finding contacts.
    pub fn set_contacts(&mut self, on: bool) {
        // SAFETY: only a value changes; no size, address or id table is touched.
        let flags = unsafe { &mut self.data.model_mut().opt_mut().disableflags };
        let off = mjtDisableBit::mjDSBL_CONTACT as i32;
        *flags = if on { *flags & !off } else { *flags | off };
    }

    /// One physics step under `self.torques`.
    fn advance(&mut self) {
        self.data.ctrl_mut().copy_from_slice(&self.torques);
        if self.sticks {
            self.set_friction();
        }
        for key in 0..KEY_COUNT {
            if self.data.tree_asleep()[self.layout.key_tree[key]] < 0 {
                self.derived_at[key] = self.data.qpos()[self.layout.key_dof[key]];
            }
        }
        self.data.step();
        self.physics_steps += 1;
        self.watch_keys();
    }

    /// Finds the keys that have begun or ceased to sound since the last physics step, and adds
    /// their events.
    pub(super) fn watch_keys(&mut self) {
        let secs = self.physics_steps as f64 * self.options.step_secs;
        let angles = self.data.qpos();
        let velocities = self.data.qvel();
        let mut now = KeySet::EMPTY;
        for key in 0..KEY_COUNT {
            let angle = angles[self.layout.key_dof[key]];
            self.deepest[key] = self.deepest[key].max(angle);
            let border = if self.pressed.contains(key) { self.release[key] } else { self.threshold[key] };
            if angle >= border {
                now.insert(key);
            }
        }
        if now == self.pressed {
            return;
        }
        for key in now.difference(self.pressed).iter() {
            let speed = velocities[self.layout.key_dof[key]].max(0.0);
            let between_secs = CONTACTS_APART * self.lower_stop(key) / speed;
            let unrounded = unrounded_velocity(between_secs, LOUDEST_SECS, SOFTEST_SECS);
            let velocity = midi(unrounded);
            self.strikes.push(Strike { key, unrounded_velocity: unrounded });
            self.events.push(KeyEvent { secs, key, velocity });
        }
        for key in self.pressed.difference(now).iter() {
            self.events.push(KeyEvent { secs, key, velocity: 0 });
        }
        self.pressed = now;
    }

    /// Whether there is a contact other than a fingertip on the keyboard.
    fn collision(&self) -> bool {
        self.data.contact().iter().any(|contact| {
            // A geom id is negative only for a flex element, and this model has none.
            let part = |geom: i32| self.layout.geom_part[geom as usize];
            part(contact.geom[0]).collide(part(contact.geom[1]))
        })
    }

    /// One `mj_step` under `torques` and nothing else. A benchmark compares [`step`](Self::step)
    /// with it.
    pub fn bare_physics_step(&mut self, torques: &[f64; DRIVEN_JOINTS]) {
        self.data.ctrl_mut().copy_from_slice(torques);
        self.data.step();
    }
}
