//! Where the fits of a pass start.

use std::sync::atomic::AtomicBool;

use etude_stage::hand::JOINTS_PER_FINGER;
use etude_stage::params::JointRow;
use etude_stage::{DRIVEN_JOINTS, PhysicalParams, RAIL};

use super::error::IdentifyError;
use super::setup::Setup;
use crate::motion::RecordedMotion;
use crate::replay::Trace;

/// How far beyond its kink a jerk limit is restarted, as a factor.
const RESTART_FACTOR: f64 = 1.4;
/// How much worse than another a joint is that was caught in a local minimum (our choice).
const CAUGHT: f64 = 1.5;
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
        let costs: Vec<f64> = traces.iter().map(|traces| total_error(motions, traces, joint)).collect();
        if let Some(best) = (0..costs.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b])) {
            params.set_joint(JointRow::Delay, joint, worlds[best].joint(JointRow::Delay, joint));
        }
    }
    Ok(())
}

/// Other starts for all joints. A joint that repeats its motion much worse than another of the same
/// place in a finger was caught in a local minimum: it starts where that one has ended, since
/// motors and links are alike. Every other joint's jerk limit is put on the other side of its kink.
/// Above the kink the physics step bounds how the reference settles, below it the jerk limit does,
/// and no slope leads from one side to the other.
pub(super) fn restart(
    setup: &Setup<'_>,
    params: &mut PhysicalParams,
    motions: &[RecordedMotion],
    interrupt: &AtomicBool,
) -> Result<(), IdentifyError> {
    let ended = params.clone();
    let traces = setup.replay(std::slice::from_ref(&ended), motions, |_| true, false, interrupt)?;
    let errors: [f64; DRIVEN_JOINTS] = std::array::from_fn(|joint| total_error(motions, &traces[0], joint));
    for joint in 0..DRIVEN_JOINTS {
        let alike = |other: &usize| joint != RAIL && other % JOINTS_PER_FINGER == joint % JOINTS_PER_FINGER;
        let moved = |other: &usize| errors[*other] > 0.0;
        let others = (0..RAIL).filter(alike).filter(moved);
        let best = others.min_by(|a, b| errors[*a].total_cmp(&errors[*b]));
        match best.filter(|best| errors[joint] > CAUGHT * errors[*best]) {
            Some(best) => {
                for row in JointRow::ALL {
                    params.set_joint(*row, joint, ended.joint(*row, best));
                }
            }
            None => {
                let kink = ended.joint(JointRow::AccelerationLimit, joint) / setup.world.physics_step_secs();
                let is_below = ended.joint(JointRow::JerkLimit, joint) < kink;
                let side = if is_below { RESTART_FACTOR } else { 1.0 / RESTART_FACTOR };
                params.set_joint(JointRow::JerkLimit, joint, side * kink);
            }
        }
    }
    Ok(())
}

/// Sum of a joint's errors in the motions in which it moves, rad or m.
fn total_error(motions: &[RecordedMotion], traces: &[Option<Trace>], joint: usize) -> f64 {
    let moving = motions.iter().zip(traces).filter(|(motion, _)| motion.moves[joint]);
    moving.map(|(motion, trace)| trace.as_ref().map_or(f64::INFINITY, |t| t.rmse(motion, joint))).sum()
}
