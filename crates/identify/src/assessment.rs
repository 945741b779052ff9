//! How well a simulator repeats recordings: errors by joint.

use etude_stage::{JOINT_NAMES, JOINTS, PhysicalParams, RAIL, StageConfig, StageError};
use serde::{Deserialize, Serialize};

use crate::motion::Motion;
use crate::replay::Replayer;

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
        let mut errors: [[Vec<f64>; 2]; JOINTS] = Default::default();
        for motion in motions {
            let traces = [before, after].map(|params| replayer.replay(params, motion, false));
            for joint in (0..JOINTS).filter(|joint| motion.moves[*joint]) {
                for (errors, trace) in errors[joint].iter_mut().zip(&traces) {
                    match trace {
                        Some(trace) => errors.extend(trace.errors(motion, joint)),
                        None => errors.push(f64::INFINITY),
                    }
                }
            }
        }
        let of_joint = |joint: usize| JointErrors {
            joint: JOINT_NAMES[joint].to_string(),
            noise: first.noise[joint],
            before: rms([&errors[joint][0]]),
            after: rms([&errors[joint][1]]),
        };
        let moved = |joint: &usize| !errors[*joint][0].is_empty();
        let pooled = |which: usize| rms(errors[..RAIL].iter().map(|errors| &errors[which]));
        let noise = first.noise[..RAIL].iter().map(|noise| noise * noise).sum::<f64>() / RAIL as f64;
        Ok(Self {
            joints: (0..JOINTS).filter(moved).map(of_joint).collect(),
            fingers: [pooled(0), pooled(1)],
            fingers_noise: noise.sqrt(),
        })
    }
}

/// Root mean square of the errors of one joint or of several.
fn rms<'a>(joints: impl IntoIterator<Item = &'a Vec<f64>>) -> f64 {
    let (mut squares, mut count) = (0.0, 0);
    for errors in joints {
        squares += errors.iter().map(|error| error * error).sum::<f64>();
        count += errors.len();
    }
    f64::sqrt(squares / count.max(1) as f64)
}
