//! How well a simulator repeats recordings: errors by joint.

use etude_stage::{DRIVEN_JOINTS, JOINT_NAMES, PhysicalParams, RAIL, StageConfig, StageError};
use serde::{Deserialize, Serialize};

use crate::motion::RecordedMotion;
use crate::replay::{Replayer, Trace};

/// Root mean square errors of one joint over several recordings, before and after the fit, rad or
/// m.
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
    /// Compares `motions` with replays with the parameters `before` and `after`. The errors of a
    /// simulation that diverges are infinite.
    ///
    /// # Errors
    /// If the simulation cannot be built.
    pub fn new(
        motions: &[RecordedMotion],
        before: &PhysicalParams,
        after: &PhysicalParams,
    ) -> Result<Self, StageError> {
        let Some(first) = motions.first() else { return Ok(Self::default()) };
        let mut errors: [[Vec<f64>; 2]; DRIVEN_JOINTS] = Default::default();
        for Replayed { motion, traces } in replay_both(motions, before, after)? {
            for joint in (0..DRIVEN_JOINTS).filter(|joint| motion.moves[*joint]) {
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
            joints: (0..DRIVEN_JOINTS).filter(moved).map(of_joint).collect(),
            fingers: [pooled(0), pooled(1)],
            fingers_noise: noise.sqrt(),
        })
    }
}

/// A motion and its replays before and after the fit. A replay is `None` where the simulation
/// diverged.
pub(crate) struct Replayed<'a> {
    pub motion: &'a RecordedMotion,
    pub traces: [Option<Trace>; 2],
}

/// Replays motions of one hand with the parameters `before` and `after`.
pub(crate) fn replay_both<'a>(
    motions: impl IntoIterator<Item = &'a RecordedMotion>,
    before: &PhysicalParams,
    after: &PhysicalParams,
) -> Result<Vec<Replayed<'a>>, StageError> {
    let mut motions = motions.into_iter().peekable();
    let Some(first) = motions.peek() else { return Ok(Vec::new()) };
    let mut replayer = Replayer::new(&StageConfig { side: first.side(), ..StageConfig::default() })?;
    let both = |motion: &'a RecordedMotion| Replayed {
        motion,
        traces: [before, after].map(|params| replayer.replay(params, motion, false)),
    };
    Ok(motions.map(both).collect())
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
