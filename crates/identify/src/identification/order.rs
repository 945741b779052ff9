//! The order of the stages, and where each begins.

use std::sync::atomic::AtomicBool;

use etude_stage::params::Joint;
use etude_stage::{JOINTS, PhysicalParams};

use super::{IdentifyError, Stage, StageEnd, Work};
use crate::config::MethodConfig;
use crate::motion::Motion;
use crate::replay::Trace;

/// Rounds of fits joint by joint at most, and the share of the error that one must take away for another to follow.
const MOST_ROUNDS: usize = 6;
const LEAST_GAIN: f64 = 0.01;
/// How far beyond its kink a jerk limit is restarted, as a factor.
const CROSSED: f64 = 1.4;
/// Longest delay that is tried at first, in physics steps.
const MOST_DELAY_STEPS: usize = 6;

impl Work<'_> {
    /// The stage that follows those that have ended.
    pub(super) fn next_stage(&self) -> Option<Stage> {
        let lm = matches!(self.state.config.method, MethodConfig::Lm(_));
        let keys = self.motions.iter().any(|motion| !motion.keys.is_empty());
        let ended = &self.state.ended;
        let times = |stage: Stage| ended.iter().filter(|end| end.stage == stage).count();
        let error = |end: &StageEnd| end.rms[1];
        let gained = match ended.as_slice() {
            [.., before, last] => error(last) < (1.0 - LEAST_GAIN) * error(before),
            _ => true,
        };
        let after_air = || (keys && times(Stage::Contact) == 0).then_some(Stage::Contact);
        match ended.last().map(|end| end.stage) {
            None if self.air().next().is_some() => Some(Stage::Joints),
            // A slope is misled while the joint beside it moves as well: what ended for that reason has a better one in the
            // next round.
            Some(Stage::Joints | Stage::Restart) if lm && gained && times(Stage::Joints) < MOST_ROUNDS => {
                Some(Stage::Joints)
            }
            Some(Stage::Joints) if lm && times(Stage::Restart) == 0 => Some(Stage::Restart),
            Some(Stage::Joints | Stage::Restart) if lm => Some(Stage::Fingers),
            _ => after_air(),
        }
    }

    /// Finds the delay of each joint that repeats its motion best while its other numbers are as they are. A fit that begins
    /// a step or two away from it can settle in the wrong valley: a delay is not the only number that holds a joint back.
    pub(super) fn find_delays(
        &mut self,
        motions: &[Motion],
        interrupt: &AtomicBool,
    ) -> Result<(), IdentifyError> {
        let worlds: Vec<PhysicalParams> = (0..=MOST_DELAY_STEPS)
            .map(|steps| {
                let mut params = self.state.params.clone();
                for joint in 0..JOINTS {
                    params.set_joint(Joint::Delay, joint, steps as f64 * self.world.physics_step_secs());
                }
                params
            })
            .collect();
        let traces = self.replay(&worlds, motions, false, interrupt)?;
        for joint in 0..JOINTS {
            let cost = |traces: &[Option<Trace>]| -> f64 {
                let moving = motions.iter().zip(traces).filter(|(motion, _)| motion.moves[joint]);
                moving
                    .map(|(motion, trace)| trace.as_ref().map_or(f64::INFINITY, |t| t.rmse(motion, joint)))
                    .sum()
            };
            let costs: Vec<f64> = traces.iter().map(|traces| cost(traces)).collect();
            if let Some(best) = (0..costs.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b])) {
                let delay = worlds[best].joint(Joint::Delay, joint);
                self.state.params.set_joint(Joint::Delay, joint, delay);
            }
        }
        Ok(())
    }

    /// Puts every joint's jerk limit on the other side of where the reference's settling changes: above, the physics step
    /// bounds it, below, the limit does. A fit that has settled on one side finds no slope that leads across.
    pub(super) fn cross_the_kinks(&self, params: &mut PhysicalParams) {
        for joint in 0..JOINTS {
            let kink = params.joint(Joint::AccelerationLimit, joint) / self.world.physics_step_secs();
            let side = if params.joint(Joint::JerkLimit, joint) < kink { CROSSED } else { 1.0 / CROSSED };
            params.set_joint(Joint::JerkLimit, joint, side * kink);
        }
    }
}
