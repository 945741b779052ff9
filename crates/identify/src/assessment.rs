//! How well a simulator repeats recordings: errors by joint.

use etude_stage::{JOINT_NAMES, JOINTS, PhysicalParams, RAIL, StageConfig, StageError};
use serde::{Deserialize, Serialize};

use crate::motion::Motion;
use crate::replay::{Replayer, Trace};

/// Root mean square errors of one joint over several recordings, before and after the fit, rad or m.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointErrors {
    /// Name of the joint.
    pub joint: String,
    /// Standard deviation of its readings at rest, the smallest possible error.
    pub noise: f64,
    /// Before the fit.
    pub before: f64,
    /// After the fit.
    pub after: f64,
}

/// Errors over several recordings.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Assessment {
    /// Joints that move in a recording.
    pub joints: Vec<JointErrors>,
    /// Over all finger joints, rad: before and after.
    pub fingers: [f64; 2],
    /// Their noise, rad.
    pub fingers_noise: f64,
}

impl Assessment {
    /// Compares `motions` with replays with the parameters `before` and `after`. The errors of a simulation that diverges
    /// are infinite.
    ///
    /// # Errors
    /// If the simulation cannot be built.
    pub fn new(
        motions: &[Motion],
        before: &PhysicalParams,
        after: &PhysicalParams,
    ) -> Result<Self, StageError> {
        let Some(first) = motions.first() else { return Ok(Self::default()) };
        let stage = StageConfig { side: first.side(), ..StageConfig::default() };
        let mut replayer = Replayer::new(&stage)?;
        let mut sums = [[Sum::default(); 2]; JOINTS];
        for motion in motions {
            let traces = [before, after].map(|params| replayer.replay(params, motion, false));
            for joint in (0..JOINTS).filter(|joint| motion.moves[*joint]) {
                for (sum, trace) in sums[joint].iter_mut().zip(&traces) {
                    sum.add(motion, trace.as_ref(), joint);
                }
            }
        }
        let errors = |joint: usize| JointErrors {
            joint: JOINT_NAMES[joint].to_string(),
            noise: first.noise[joint],
            before: sums[joint][0].rms(),
            after: sums[joint][1].rms(),
        };
        let moved = |joint: &usize| sums[*joint][0].count > 0.0;
        let pooled = |which: usize| {
            let all = sums[..RAIL].iter().fold(Sum::default(), |all, sums| all.plus(sums[which]));
            all.rms()
        };
        let noise = first.noise[..RAIL].iter().map(|noise| noise * noise).sum::<f64>() / RAIL as f64;
        Ok(Self {
            joints: (0..JOINTS).filter(moved).map(errors).collect(),
            fingers: [pooled(0), pooled(1)],
            fingers_noise: noise.sqrt(),
        })
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    squares: f64,
    count: f64,
}

impl Sum {
    fn add(&mut self, motion: &Motion, trace: Option<&Trace>, joint: usize) {
        match trace {
            None => *self = Self { squares: f64::INFINITY, count: self.count + 1.0 },
            Some(trace) => {
                for error in trace.errors(motion, joint) {
                    self.squares += error * error;
                    self.count += 1.0;
                }
            }
        }
    }

    fn plus(self, other: Self) -> Self {
        Self { squares: self.squares + other.squares, count: self.count + other.count }
    }

    fn rms(self) -> f64 {
        f64::sqrt(self.squares / f64::max(self.count, 1.0))
    }
}
