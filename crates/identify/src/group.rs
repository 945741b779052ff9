//! Groups: parameters that are fitted together, and their residuals. Groups of one pass hardly
//! influence each other's readings, so one replay serves a candidate of each.

use etude_music::{CONTROL_HZ, KEY_COUNT};
use etude_stage::hand::{FINGER_NAMES, JOINTS_PER_FINGER};
use etude_stage::params::WorldRow;
use etude_stage::{DRIVEN_JOINTS, JOINT_NAMES, PhysicalParams, RAIL};
use serde::{Deserialize, Serialize};

use crate::error::FitError;
use crate::motion::RecordedMotion;
use crate::parameter_bounds::{contact_parameters, contact_prior};
use crate::problem::{Block, Evaluation, Loss, Problem};
use crate::replay::Trace;
use crate::space::{Parameter, Space};

/// Every third reading is compared: the hand sends readings three times as often as its motion
/// changes.
const STRIDE: usize = 3;
/// Bend of the Huber loss, standard deviations: a finger may slip off a key in the simulation only.
const HUBER_BEND: f64 = 3.0;
/// Standard deviation of a key's travel when it sounds, as a share of its travel: its motion in two
/// physics steps.
const KEY_NOISE: f64 = 0.05;

/// Parameters that are fitted together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Group {
    /// Name of a joint, a finger, or the keyboard.
    pub name: String,
    /// Joints whose readings are its residuals.
    pub joints: Vec<usize>,
    /// Whether the sounding keys are its residuals too.
    pub keys: bool,
    /// Whether the prior of its parameters is among its residuals.
    pub uses_prior: bool,
}

impl Group {
    /// The residuals of this group: a block for each joint in each motion in which it moves, and
    /// one for the keys.
    ///
    /// # Errors
    /// If there are no parameters or no residuals.
    pub fn problem(
        &self,
        parameters: Vec<Parameter>,
        motions: &[RecordedMotion],
    ) -> Result<Problem, FitError> {
        let mut blocks = Vec::new();
        for (index, motion) in motions.iter().enumerate() {
            for joint in self.joints_of(motion) {
                let name = format!("{index}.{}", JOINT_NAMES[joint]);
                blocks.push(Block::new(&name, motion.readings(joint).step_by(STRIDE).count()));
            }
            if self.keys && !motion.keys.is_empty() {
                blocks.push(Block::new(&format!("{index}.keys"), 2 * motion.commands.steps()));
            }
        }
        if self.uses_prior {
            blocks.push(Block::new("prior", contact_parameters(&PhysicalParams::default()).len()));
        }
        let loss = if self.keys { Loss::Huber(HUBER_BEND) } else { Loss::Squared };
        Problem::new(Space::new(parameters)?, blocks, loss)
    }

    /// Names of the blocks that a joint's parameters influence: those of its own finger. Its
    /// influence on other fingers through the rail is below the noise.
    pub fn influenced<'a>(
        &'a self,
        joint: usize,
        motions: &'a [RecordedMotion],
    ) -> impl Iterator<Item = String> + 'a {
        let finger = |joint: usize| joint / JOINTS_PER_FINGER;
        motions.iter().enumerate().flat_map(move |(index, motion)| {
            let its = self.joints_of(motion).filter(move |other| finger(*other) == finger(joint));
            its.map(move |other| format!("{index}.{}", JOINT_NAMES[other]))
        })
    }

    fn joints_of<'a>(&'a self, motion: &'a RecordedMotion) -> impl Iterator<Item = usize> + 'a {
        self.joints.iter().copied().filter(|joint| motion.moves[*joint])
    }

    /// Whether a motion has residuals of this group.
    pub fn uses(&self, motion: &RecordedMotion) -> bool {
        self.joints_of(motion).next().is_some() || (self.keys && !motion.keys.is_empty())
    }

    /// Residuals of the motions' replays, one trace a motion, with `params`; `before` are the
    /// parameters at the start of the pass.
    pub fn evaluate(
        &self,
        before: &PhysicalParams,
        params: &PhysicalParams,
        motions: &[RecordedMotion],
        traces: &[Option<Trace>],
    ) -> Evaluation {
        let mut residuals = Vec::new();
        for (motion, trace) in motions.iter().zip(traces) {
            if !self.uses(motion) {
                continue;
            }
            let trace = trace.as_ref()?;
            for joint in self.joints_of(motion) {
                let noise = motion.noise[joint];
                residuals.extend(trace.errors(motion, joint).step_by(STRIDE).map(|error| error / noise));
            }
            if self.keys && !motion.keys.is_empty() {
                key_residuals(params, motion, trace, &mut residuals);
            }
        }
        if self.uses_prior {
            residuals.extend(contact_prior(before, params));
        }
        Some(residuals)
    }
}

/// Two residuals a control step: by how much the keys that sounded at its end are short of where
/// they are silent again, and by how much the others are beyond their threshold.
fn key_residuals(params: &PhysicalParams, motion: &RecordedMotion, trace: &Trace, residuals: &mut Vec<f64>) {
    let threshold = params.world(WorldRow::KeyThreshold);
    let release = threshold * (1.0 - params.world(WorldRow::KeyHysteresis));
    let mut sounding = [false; KEY_COUNT];
    let mut events = motion.keys.iter().peekable();
    for step in 0..motion.commands.steps() {
        let secs = (step + 1) as f64 / CONTROL_HZ;
        while let Some(event) = events.next_if(|event| event.secs <= secs) {
            sounding[event.key] = event.velocity > 0;
        }
        let (mut missing, mut extra) = (0.0, 0.0);
        for (key, sounds) in sounding.iter().enumerate() {
            let beyond = trace.key_travel(key, secs) - if *sounds { release } else { threshold };
            if *sounds { missing += (-beyond).max(0.0) } else { extra += beyond.max(0.0) }
        }
        residuals.extend([missing / KEY_NOISE, extra / KEY_NOISE]);
    }
}

/// Joints whose readings are fitted, without keys.
fn drives(name: &str, joints: Vec<usize>) -> Group {
    Group { name: name.to_string(), joints, keys: false, uses_prior: false }
}

/// Every joint separately.
pub fn joints() -> Vec<Group> {
    (0..DRIVEN_JOINTS).map(|joint| drives(JOINT_NAMES[joint], vec![joint])).collect()
}

/// Every finger's joints together, and the rail.
pub fn fingers() -> Vec<Group> {
    let joints = |finger: usize| (finger * JOINTS_PER_FINGER..(finger + 1) * JOINTS_PER_FINGER).collect();
    let fingers = FINGER_NAMES.iter().enumerate().map(|(finger, name)| drives(name, joints(finger)));
    fingers.chain([drives("rail", vec![RAIL])]).collect()
}

/// The keyboard, fitted to which keys sound and when. The pressing joints' readings are left out:
/// how a finger yields under a key depends on backlash, which the simulated joints lack, and would
/// bias the keyboard's parameters.
pub fn keyboard() -> Group {
    Group { name: "keyboard".to_string(), joints: Vec::new(), keys: true, uses_prior: true }
}
