//! The uncertainty of the result.

use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;

use etude_stage::PhysicalParams;
use serde::{Deserialize, Serialize};

use super::error::IdentifyError;
use super::pass::{ESTIMATE_STEP, Pass, PassEnd};
use super::setup::{Batch, Setup};
use super::state::State;
use crate::estimate::Estimate;
use crate::group::Group;
use crate::jacobian::JacobianPlan;
use crate::presses::Measured;

/// The result of an identification.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Identified {
    /// Parameters that differ from the defaults, by path: the identified simulator.
    pub physics: BTreeMap<String, f64>,
    /// The same at the start of the fit.
    pub before: BTreeMap<String, f64>,
    /// The passes.
    pub passes: Vec<PassEnd>,
    /// Parameters of the keyboard that slow presses measured.
    pub measured: Vec<Measured>,
    /// Name of each group and the estimates of its last pass.
    pub estimates: Vec<(String, Estimate)>,
}

/// Estimates the parameters' uncertainty at the end of the fits.
pub(super) fn with_uncertainty(
    setup: &Setup<'_>,
    state: State,
    measured: Vec<Measured>,
) -> Result<Identified, IdentifyError> {
    let done = |pass: Pass| state.ended.iter().any(|end| end.pass == pass);
    // A finger's estimate is that of its joints with their correlations.
    let air = if done(Pass::Fingers) { Pass::Fingers } else { Pass::Joints };
    let mut estimates = Vec::new();
    for pass in [air, Pass::Contact].into_iter().filter(|pass| done(*pass)) {
        estimates.extend(pass_estimates(setup, &state.params, pass)?);
    }
    Ok(Identified {
        physics: changed(&state.params),
        before: changed(&setup.before),
        passes: state.ended,
        measured,
        estimates,
    })
}

fn pass_estimates(
    setup: &Setup<'_>,
    params: &PhysicalParams,
    pass: Pass,
) -> Result<Vec<(String, Estimate)>, IdentifyError> {
    let motions = setup.motions(pass == Pass::Contact);
    let mut problems = Vec::new();
    // From the recordings alone, without the prior.
    let groups = pass.groups().into_iter().map(|group| Group { uses_prior: false, ..group });
    for group in groups.filter(|group| motions.iter().any(|motion| group.uses(motion))) {
        let problem = group.problem(setup.parameters(&group, &motions), &motions)?;
        let values = problem.space().parameters().iter().map(|parameter| params.get(&parameter.path));
        let point = problem.space().to_normalised(&values.collect::<Result<Vec<_>, _>>()?);
        let plan = JacobianPlan::new(&problem, &point, ESTIMATE_STEP);
        let candidates = plan.candidates(&problem);
        problems.push((group, problem, plan, candidates));
    }
    let batches: Vec<Batch<'_>> = (problems.iter())
        .map(|(group, problem, _, candidates)| Batch { group, problem, candidates, best: None })
        .collect();
    // Too short to be interrupted.
    let (keys, interrupt) = (pass == Pass::Contact, AtomicBool::new(false));
    let evaluated = setup.evaluate(params, &setup.before, &batches, &motions, keys, &interrupt)?;
    let mut estimates = Vec::new();
    for ((group, problem, plan, _), evaluations) in problems.iter().zip(evaluated) {
        let linear = plan.finish(problem, &evaluations)?;
        estimates.push((group.name.clone(), Estimate::new(problem, &linear)?));
    }
    Ok(estimates)
}

/// Parameters that differ from the defaults.
fn changed(params: &PhysicalParams) -> BTreeMap<String, f64> {
    PhysicalParams::rows()
        .filter_map(|(path, _, default)| {
            let value = params.get(&path).ok()?;
            (value != default).then_some((path, value))
        })
        .collect()
}
