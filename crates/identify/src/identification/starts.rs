//! Where the fits of a pass start.

use std::sync::atomic::AtomicBool;

use etude_stage::params::JointRow;
use etude_stage::{DRIVEN_JOINTS, PhysicalParams};

use super::error::IdentifyError;
use super::scene::Scene;
use crate::motion::Motion;
use crate::replay::Trace;

/// How far beyond its kink a jerk limit is restarted, as a factor.
const CROSSED: f64 = 1.4;
/// Longest delay of the first search, in physics steps.
const MOST_DELAY_STEPS: usize = 6;

/// Sets each joint's delay to the one that repeats its motion best while its other parameters stay fixed. A fit that starts a
/// step or two away can end in the wrong local minimum, because other parameters delay a joint too.
pub(super) fn find_delays(
    scene: &Scene<'_>,
    params: &mut PhysicalParams,
    motions: &[Motion],
    interrupt: &AtomicBool,
) -> Result<(), IdentifyError> {
    let worlds: Vec<PhysicalParams> = (0..=MOST_DELAY_STEPS)
        .map(|steps| {
            let mut params = params.clone();
            for joint in 0..DRIVEN_JOINTS {
                params.set_joint(JointRow::Delay, joint, steps as f64 * scene.world.physics_step_secs());
            }
            params
        })
        .collect();
    let traces = scene.replay(&worlds, motions, |_| true, false, interrupt)?;
    for joint in 0..DRIVEN_JOINTS {
        let cost = |traces: &[Option<Trace>]| -> f64 {
            let moving = motions.iter().zip(traces).filter(|(motion, _)| motion.moves[joint]);
            moving
                .map(|(motion, trace)| trace.as_ref().map_or(f64::INFINITY, |t| t.rmse(motion, joint)))
                .sum()
        };
        let costs: Vec<f64> = traces.iter().map(|traces| cost(traces)).collect();
        if let Some(best) = (0..costs.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b])) {
            params.set_joint(JointRow::Delay, joint, worlds[best].joint(JointRow::Delay, joint));
        }
    }
    Ok(())
}

/// Puts every joint's jerk limit on the other side of its kink. Above the kink the physics step bounds how the reference
/// settles, below it the jerk limit does, and no slope leads from one side to the other.
pub(super) fn cross_the_kinks(scene: &Scene<'_>, params: &mut PhysicalParams) {
    for joint in 0..DRIVEN_JOINTS {
        let kink = params.joint(JointRow::AccelerationLimit, joint) / scene.world.physics_step_secs();
        let side = if params.joint(JointRow::JerkLimit, joint) < kink { CROSSED } else { 1.0 / CROSSED };
        params.set_joint(JointRow::JerkLimit, joint, side * kink);
    }
}
