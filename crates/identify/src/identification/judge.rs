//! What the numbers are worth where the fits have ended.

use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;

use etude_stage::PhysicalParams;

use super::{ESTIMATE_STEP, Identified, IdentifyError, Stage, Work, set};
use crate::estimate::Estimate;
use crate::fit::Candidate;
use crate::group::Group;
use crate::jacobian::JacobianPlan;
use crate::problem::Evaluation;

impl Work<'_> {
    /// Judges where the fits have ended.
    pub(super) fn finish(self) -> Result<Identified, IdentifyError> {
        let still = AtomicBool::new(false);
        let done = |stage: Stage| self.state.ended.iter().any(|end| end.stage == stage);
        // The estimate of a finger is that of its joints with their correlations.
        let air = if done(Stage::Fingers) { Stage::Fingers } else { Stage::Joints };
        let judged = [air, Stage::Contact].into_iter().filter(|stage| done(*stage));
        let mut estimates = Vec::new();
        let began = self.before.clone();
        for stage in judged {
            let motions = self.motions_of(stage);
            let mut problems = Vec::new();
            // What the recordings tell, without what was believed before them.
            for group in stage.groups().into_iter().map(|group| Group { believes: false, ..group }) {
                if motions.iter().any(|motion| group.learns_from(motion)) {
                    let params = &self.state.params;
                    let parameters = self.parameters(stage, &group, &motions);
                    let problem = group.problem(parameters, &motions)?;
                    let values: Vec<f64> = problem
                        .space()
                        .parameters()
                        .iter()
                        .map(|parameter| params.get(&parameter.path))
                        .collect::<Result<_, _>>()?;
                    let plan =
                        JacobianPlan::new(&problem, &problem.space().to_normalised(&values), ESTIMATE_STEP);
                    problems.push((group, problem, plan));
                }
            }
            let asked: Vec<Vec<Candidate>> =
                problems.iter().map(|(_, problem, plan)| plan.candidates(problem)).collect();
            let batch = asked.iter().map(Vec::len).max().unwrap_or(0);
            let worlds: Vec<PhysicalParams> = (0..batch)
                .map(|index| {
                    let mut params = self.state.params.clone();
                    for ((_, problem, _), candidates) in problems.iter().zip(&asked) {
                        if let Some(candidate) = candidates.get(index) {
                            set(&mut params, problem, &candidate.values);
                        }
                    }
                    params
                })
                .collect();
            let traces = self.replay(&worlds, &motions, stage == Stage::Contact, &still)?;
            for ((group, problem, plan), candidates) in problems.iter().zip(&asked) {
                let evaluations: Vec<Evaluation> = (0..candidates.len())
                    .map(|index| group.evaluate(&began, &worlds[index], &motions, &traces[index]))
                    .collect();
                let linear = plan.finish(problem, &evaluations)?;
                estimates.push((group.name.clone(), Estimate::new(problem, &linear)?));
            }
        }
        Ok(Identified {
            physics: changed(&self.state.params),
            before: changed(&self.before),
            stages: self.state.ended,
            estimates,
        })
    }
}

/// Rows other than the defaults.
fn changed(params: &PhysicalParams) -> BTreeMap<String, f64> {
    PhysicalParams::rows()
        .filter_map(|(path, _, default)| {
            let value = params.get(&path).ok()?;
            (value != default).then_some((path, value))
        })
        .collect()
}
