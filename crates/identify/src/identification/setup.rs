//! The motions of an identification, what each group estimates from them, and their replays.

use std::sync::atomic::{AtomicBool, Ordering};

use etude_stage::{PhysicalParams, StageConfig};
use rayon::prelude::*;

use super::error::IdentifyError;
use super::state::IdentifyConfig;
use crate::config::MethodConfig;
use crate::error::FitError;
use crate::group::Group;
use crate::method::Candidate;
use crate::motion::RecordedMotion;
use crate::parameter_bounds::{contact_parameters, follow_stiffness, joint_parameters, start};
use crate::presses::{self, Measured};
use crate::problem::{Evaluation, Problem};
use crate::replay::{Replayer, Trace};
use crate::space::Parameter;

/// Motions of one rig and the simulation that replays them.
pub(super) struct Setup<'a> {
    pub motions: &'a [RecordedMotion],
    pub world: StageConfig,
    /// The parameters at the start.
    pub before: PhysicalParams,
    /// Whether the drives are fitted to what plays keys too.
    uses_played: bool,
    /// Paths of the parameters that slow presses measure, and no fit estimates.
    measured: Vec<String>,
}

/// Traces of one simulation, one a motion; `None` where it diverged, or was not wanted.
pub(super) type Traces = Vec<Option<Trace>>;

/// Candidates of a group.
pub(super) struct Batch<'a> {
    pub group: &'a Group,
    pub problem: &'a Problem,
    pub candidates: &'a [Candidate],
    /// Values in place of candidates that the group does not have.
    pub best: Option<&'a [f64]>,
}

impl<'a> Setup<'a> {
    pub fn new(motions: &'a [RecordedMotion], config: &IdentifyConfig) -> Result<Self, IdentifyError> {
        let first = motions.first().ok_or(IdentifyError::Nothing)?;
        let world = StageConfig { side: first.side(), ..StageConfig::default() };
        let before = start(&first.rig).with(&config.start)?;
        let measured = presses::measure(motions, &before).into_iter().map(|one| one.path).collect();
        let uses_played = matches!(config.method, MethodConfig::Bo(_));
        Ok(Self { motions, world, before, uses_played, measured })
    }

    /// Motions that play keys (`keys`), which the keyboard is fitted to, or those which the drives
    /// are fitted to: with Bayesian optimisation all of them, as in the paper, else those that
    /// touch no key.
    pub fn motions(&self, keys: bool) -> Vec<RecordedMotion> {
        let is_one = |motion: &&RecordedMotion| match keys {
            true => motion.plays_keys(),
            false => self.uses_played || motion.keys.is_empty(),
        };
        self.motions.iter().filter(is_one).cloned().collect()
    }

    /// Measures the keyboard by slow presses, and sets it.
    pub fn measure(&self, params: &mut PhysicalParams) -> Vec<Measured> {
        let measured = presses::measure(self.motions, params);
        presses::apply(&measured, params);
        measured
    }

    /// The parameters that a group estimates, with bounds around their values before the first
    /// pass.
    pub fn parameters(&self, group: &Group, motions: &[RecordedMotion]) -> Vec<Parameter> {
        if group.keys {
            let mut parameters = contact_parameters(&self.before);
            parameters.retain(|parameter| !self.measured.contains(&parameter.path));
            return parameters;
        }
        let of_joint = |&joint: &usize| {
            let influenced: Vec<String> = group.influenced(joint, motions).collect();
            // A joint of a finger that never moves has no parameter to estimate.
            let parameters = (!influenced.is_empty()).then(|| joint_parameters(joint, &self.before));
            parameters.into_iter().flatten().map(move |parameter| parameter.influencing(influenced.clone()))
        };
        group.joints.iter().flat_map(of_joint).collect()
    }

    /// Sets the parameters of a problem to these values, and those that follow from them.
    pub fn set(&self, params: &mut PhysicalParams, problem: &Problem, values: &[f64]) {
        for (parameter, value) in problem.space().parameters().iter().zip(values) {
            // The path is one of the rows and the value within its bounds.
            let _ = params.set(&parameter.path, *value);
        }
        follow_stiffness(&self.before, params);
    }

    /// Evaluates candidates of several groups in shared replays of `motions`: candidate *i* of each
    /// group in the same simulation, on top of `params`. `before` is the mean of the priors. `keys`
    /// records the travel of the keys too.
    pub fn evaluate(
        &self,
        params: &PhysicalParams,
        before: &PhysicalParams,
        batches: &[Batch<'_>],
        motions: &[RecordedMotion],
        keys: bool,
        interrupt: &AtomicBool,
    ) -> Result<Vec<Vec<Evaluation>>, IdentifyError> {
        let simulation = |index: usize| {
            let mut params = params.clone();
            for Batch { problem, candidates, best, .. } in batches {
                let values = candidates.get(index).map(|candidate| candidate.values.as_slice());
                if let Some(values) = values.or(*best) {
                    self.set(&mut params, problem, values);
                }
            }
            params
        };
        let count = batches.iter().map(|batch| batch.candidates.len()).max().unwrap_or(0);
        let simulations: Vec<PhysicalParams> = (0..count).map(simulation).collect();
        let is_used = |motion: &RecordedMotion| {
            batches.iter().any(|batch| !batch.candidates.is_empty() && batch.group.uses(motion))
        };
        let traces = self.replay(&simulations, motions, is_used, keys, interrupt)?;
        let evaluations = |batch: &Batch<'_>| {
            let indices = 0..batch.candidates.len();
            let of =
                |index: usize| batch.group.evaluate(before, &simulations[index], motions, &traces[index]);
            indices.map(of).collect()
        };
        Ok(batches.iter().map(evaluations).collect())
    }

    /// Replays the motions that are wanted in a simulation with each set of parameters. `keys`
    /// records the travel of the keys too.
    pub fn replay(
        &self,
        worlds: &[PhysicalParams],
        motions: &[RecordedMotion],
        wanted: impl Fn(&RecordedMotion) -> bool,
        keys: bool,
        interrupt: &AtomicBool,
    ) -> Result<Vec<Traces>, IdentifyError> {
        let wanted: Vec<bool> = motions.iter().map(wanted).collect();
        let jobs: Vec<(usize, usize)> = (0..worlds.len())
            .flat_map(|world| (0..motions.len()).map(move |motion| (world, motion)))
            .collect();
        let traces: Traces = jobs
            .par_iter()
            .map_init(
                || Replayer::new(&self.world),
                |replayer, (world, motion)| match replayer {
                    _ if interrupt.load(Ordering::Relaxed) => Err(IdentifyError::Interrupted),
                    _ if !wanted[*motion] => Ok(None),
                    Ok(replayer) => Ok(replayer.replay(&worlds[*world], &motions[*motion], keys)),
                    Err(error) => Err(FitError(format!("cannot build the simulation: {error}")).into()),
                },
            )
            .collect::<Result<_, _>>()?;
        let mut traces = traces.into_iter();
        Ok(worlds.iter().map(|_| traces.by_ref().take(motions.len()).collect()).collect())
    }
}
