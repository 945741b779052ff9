//! Where the fits of a pass start.

use std::sync::atomic::AtomicBool;

use etude_stage::params::JointRow;
use etude_stage::{DRIVEN_JOINTS, PhysicalParams};

use super::error::IdentifyError;
use super::setup::Setup;
use crate::motion::RecordedMotion;
use crate::replay::Trace;

/// How far beyond its kink a jerk limit is restarted, as a factor.
const RESTART_FACTOR: f64 = 1.4;
/// Longest delay of the first search, in physics steps.
const MAX_DELAY_STEPS: usize = 6;

/// Sets each joint's delay to the one that repeats its motion best while its other parameters stay
/// fixed. A fit that starts a step or two away can end in the wrong local minimum, because other
/// parameters delay a joint too.
pub(super) fn find_delays(
    setup: &Setup<'_>,
    params: &mut PhysicalParams,
    motions: &[RecordedMotion],
    interrupt: &AtomicBool,
) -> Result<(), IdentifyError> {
    let worlds: Vec<PhysicalParams> = (0..=MAX_DELAY_STEPS)
        .map(|steps| {
            let mut params = params.clone();
            for joint in 0..DRIVEN_JOINTS {
                params.set_joint(JointRow::Delay, joint, steps as f64 * setup.world.physics_step_secs());
            }
            params
        })
        .collect();
    let traces = setup.replay(&worlds, motions, |_| true, false, interrupt)?;
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

/// Puts every joint's jerk limit on the other side of its kink. Above the kink the physics step
/// bounds how the reference settles, below it the jerk limit does, and no slope leads from one side
/// to the other.
pub(super) fn restart_jerk_limits(setup: &Setup<'_>, params: &mut PhysicalParams) {
    for joint in 0..DRIVEN_JOINTS {
        let kink = params.joint(JointRow::AccelerationLimit, joint) / setup.world.physics_step_secs();
        let side = if params.joint(JointRow::JerkLimit, joint) < kink {
            RESTART_FACTOR
        } else {
            1.0 / RESTART_FACTOR
        };
        params.set_joint(JointRow::JerkLimit, joint, side * kink);
    }
}
