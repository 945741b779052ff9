//! Groups: parameters that are fitted together and the readings that they explain. Groups of one stage do not influence each
//! other's readings enough to matter, so one replay serves a candidate of each.

use etude_music::{CONTROL_HZ, KEYS};
use etude_stage::{JOINT_NAMES, JOINTS, PhysicalParams};
use serde::{Deserialize, Serialize};

use crate::motion::Motion;
use crate::problem::{Block, Evaluation, Loss, Problem, ProblemError};
use crate::replay::Trace;
use crate::rows::contact_disbelief;
use crate::space::{Parameter, Space, SpaceError};

/// One reading of so many is compared: the hand sends three times as many as its motion has news.
const STRIDE: usize = 3;
/// Beyond this many standard deviations a residual counts in proportion only: a finger that slips off a key in one world and
/// not in the other.
const SLIPS: f64 = 3.0;
/// How far a key may be from its threshold when it is heard, as a share of its travel: what two steps of physics make.
const KEY_NOISE: f64 = 0.05;

/// A group that cannot be fitted.
#[derive(Debug, thiserror::Error)]
pub enum GroupError {
    /// Of its parameters.
    #[error(transparent)]
    Space(#[from] SpaceError),
    /// Of its residuals.
    #[error(transparent)]
    Problem(#[from] ProblemError),
}

/// Parameters that are fitted together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Group {
    /// What it is: a joint, a finger, the keyboard.
    pub name: String,
    /// Joints whose readings it explains.
    pub joints: Vec<usize>,
    /// Whether it explains which keys sound, too.
    pub keys: bool,
    /// Whether what was believed of its parameters counts beside the recordings.
    pub believes: bool,
}

impl Group {
    /// The residuals of this group: a block for each joint in each motion in which it moves, and one for the keys.
    ///
    /// # Errors
    /// If there is nothing to explain.
    pub fn problem(&self, parameters: Vec<Parameter>, motions: &[Motion]) -> Result<Problem, GroupError> {
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
        if self.believes {
            blocks.push(Block::new("belief", parameters.len()));
        }
        let loss = if self.keys { Loss::Huber(SLIPS) } else { Loss::Squared };
        Ok(Problem::new(Space::new(parameters)?, blocks, loss)?)
    }

    /// Names of the blocks that a number of a joint influences: those of its own finger. What the joints of one finger do to
    /// another's, through the rail, is beneath the noise.
    pub fn influenced<'a>(
        &'a self,
        joint: usize,
        motions: &'a [Motion],
    ) -> impl Iterator<Item = String> + 'a {
        let finger = |joint: usize| joint / etude_stage::hand::FINGER_JOINTS;
        motions.iter().enumerate().flat_map(move |(index, motion)| {
            let its = self.joints_of(motion).filter(move |other| finger(*other) == finger(joint));
            its.map(move |other| format!("{index}.{}", JOINT_NAMES[other]))
        })
    }

    fn joints_of<'a>(&'a self, motion: &'a Motion) -> impl Iterator<Item = usize> + 'a {
        self.joints.iter().copied().filter(|joint| motion.moves[*joint])
    }

    /// Whether a motion tells it anything.
    pub fn learns_from(&self, motion: &Motion) -> bool {
        self.joints_of(motion).next().is_some() || (self.keys && !motion.keys.is_empty())
    }

    /// Residuals of what the motions' replays came to, one a motion, in a world with `params`; `before` is the world that
    /// the stage began with.
    pub fn evaluate(
        &self,
        before: &PhysicalParams,
        params: &PhysicalParams,
        motions: &[Motion],
        traces: &[Option<Trace>],
    ) -> Evaluation {
        let mut residuals = Vec::new();
        for (motion, trace) in motions.iter().zip(traces) {
            if !self.learns_from(motion) {
                continue;
            }
            let Some(trace) = trace else {
                return Evaluation::Failed(format!("the world diverged in {}", motion.path.display()));
            };
            for joint in self.joints_of(motion) {
                let noise = motion.noise[joint];
                residuals.extend(trace.errors(motion, joint).step_by(STRIDE).map(|error| error / noise));
            }
            if self.keys && !motion.keys.is_empty() {
                key_residuals(params, motion, trace, &mut residuals);
            }
        }
        if self.believes {
            residuals.extend(contact_disbelief(before, params));
        }
        Evaluation::Residuals(residuals)
    }
}

/// For each control step two numbers: by how much the keys that sounded at its end miss their threshold, and by how much
/// those that did not are beyond it.
fn key_residuals(params: &PhysicalParams, motion: &Motion, trace: &Trace, residuals: &mut Vec<f64>) {
    let threshold = params.world(etude_stage::params::World::KeyThreshold);
    let mut sounding = [false; KEYS];
    let mut events = motion.keys.iter().peekable();
    for step in 0..motion.commands.steps() {
        let secs = (step + 1) as f64 / CONTROL_HZ;
        while let Some(event) = events.next_if(|event| event.secs <= secs) {
            sounding[event.key] = event.velocity > 0;
        }
        let (mut missing, mut extra) = (0.0, 0.0);
        for (key, sounds) in sounding.iter().enumerate() {
            let beyond = trace.key_travel(key, secs) - threshold;
            if *sounds { missing += (-beyond).max(0.0) } else { extra += beyond.max(0.0) }
        }
        residuals.extend([missing / KEY_NOISE, extra / KEY_NOISE]);
    }
}

/// Every joint by itself.
pub fn joints() -> Vec<Group> {
    let group = |joint: usize| Group {
        name: JOINT_NAMES[joint].to_string(),
        joints: vec![joint],
        keys: false,
        believes: false,
    };
    (0..JOINTS).map(group).collect()
}

/// Every finger's joints together, and the rail.
pub fn fingers() -> Vec<Group> {
    use etude_stage::hand::{FINGER_JOINTS, FINGER_NAMES};
    let finger = |finger: usize| Group {
        name: FINGER_NAMES[finger].to_string(),
        joints: (finger * FINGER_JOINTS..(finger + 1) * FINGER_JOINTS).collect(),
        keys: false,
        believes: false,
    };
    let rail =
        Group { name: "rail".to_string(), joints: vec![etude_stage::RAIL], keys: false, believes: false };
    (0..FINGER_NAMES.len()).map(finger).chain([rail]).collect()
}

/// The keyboard, by which keys sound and when. Not by the joints that press: how a finger folds under a key's load hangs on
/// play and dry friction at rest, which a simulated joint has not, and would bend the keyboard's numbers to its needs.
pub fn keyboard() -> Group {
    Group { name: "keyboard".to_string(), joints: Vec::new(), keys: true, believes: true }
}
