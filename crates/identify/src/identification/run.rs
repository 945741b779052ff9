//! Runs a pass: its fits propose candidates, shared replays evaluate them, and the best become the
//! new parameters.

use std::path::Path;
use std::time::Instant;

use etude_perform::Job;
use etude_stage::PhysicalParams;

use super::error::IdentifyError;
use super::pass::{Pass, PassEnd};
use super::setup::{Batch, Setup};
use super::start_values::{find_delays, restart};
use super::state::State;
use crate::fit::Fit;
use crate::group::Group;
use crate::method::Candidate;
use crate::motion::RecordedMotion;

/// Progress of a pass.
#[derive(Clone, Debug)]
pub struct Progress {
    /// The pass.
    pub pass: Pass,
    /// Which pass it is, from 1. How many there are is decided by what they gain.
    pub number: usize,
    /// The time that the pass has taken so far, s, interruptions excluded.
    pub secs: f64,
    /// Replays of all motions so far in this pass.
    pub replays: u64,
    /// Root mean square of all residuals of the best candidates so far, in standard deviations of
    /// the noise.
    pub rms: f64,
    /// Groups that have ended, and all groups.
    pub ended: [usize; 2],
    /// Evaluations that a group may still make in this pass, of the one with most. Groups share
    /// replays, and most end before.
    pub max_evaluations_left: u64,
}

impl Progress {
    /// The longest time that the rest of the pass takes at the present speed, s; none before the
    /// first replay, and at the end.
    pub fn max_secs_left(&self) -> Option<f64> {
        let secs = self.secs / self.replays as f64 * self.max_evaluations_left as f64;
        (self.replays > 0 && self.max_evaluations_left > 0).then_some(secs)
    }
}

/// Runs or resumes a pass to its end.
pub(super) fn run(
    setup: &Setup<'_>,
    state: &mut State,
    pass: Pass,
    file: &Path,
    job: &mut Job<'_, Progress>,
) -> Result<(), IdentifyError> {
    let motions = setup.motions(pass == Pass::Contact);
    if state.fits.is_empty() || state.pass != pass {
        if state.ended.is_empty() && pass == Pass::Joints {
            find_delays(setup, &mut state.params, &motions, job.interrupt())?;
        }
        let mut starts = state.params.clone();
        if pass == Pass::Restart {
            restart(setup, &mut starts, &motions, job.interrupt())?;
        }
        state.fits = fits(setup, state, pass, &starts, &motions)?;
        (state.pass, state.replays, state.secs) = (pass, 0, 0.0);
    }
    let began = state.params.clone();
    loop {
        let begun = Instant::now();
        let asked: Vec<Vec<Candidate>> = state.fits.iter_mut().map(|(_, fit)| fit.ask()).collect();
        let batch = asked.iter().map(Vec::len).max().unwrap_or(0);
        if batch == 0 {
            break;
        }
        let batches: Vec<Batch<'_>> = (state.fits.iter().zip(&asked))
            .map(|((group, fit), candidates)| {
                let best = fit.best().map(|best| best.values.as_slice());
                Batch { group, problem: fit.problem(), candidates, best }
            })
            .collect();
        let keys = pass == Pass::Contact;
        let evaluated = setup.evaluate(&state.params, &began, &batches, &motions, keys, job.interrupt())?;
        for (((_, fit), candidates), evaluations) in state.fits.iter_mut().zip(&asked).zip(evaluated) {
            if !candidates.is_empty() {
                fit.tell(&evaluations)?;
            }
        }
        let rms = rms(&state.fits);
        if state.replays == 0 {
            state.rms = rms;
        }
        state.replays += batch as u64;
        state.secs += begun.elapsed().as_secs_f64();
        let ended = state.fits.iter().filter(|(_, fit)| fit.finished().is_some()).count();
        let (replays, ended) = (state.replays, [ended, state.fits.len()]);
        // Before the state is saved: after a kill in between the same progress is reported again,
        // and none is lost.
        let (number, secs) = (state.ended.len() + 1, state.secs);
        let max_evaluations_left =
            state.fits.iter().map(|(_, fit)| fit.max_evaluations_left()).max().unwrap_or(0);
        job.report(&Progress { pass, number, secs, replays, rms, ended, max_evaluations_left });
        state.save(file)?;
    }
    end(setup, state, pass);
    state.save(file)
}

/// The fits of a pass's groups. Their parameters start where an earlier pass has left them.
fn fits(
    setup: &Setup<'_>,
    state: &State,
    pass: Pass,
    starts: &PhysicalParams,
    motions: &[RecordedMotion],
) -> Result<Vec<(Group, Fit)>, IdentifyError> {
    let mut fits = Vec::new();
    for (index, group) in pass.groups().into_iter().enumerate() {
        if !motions.iter().any(|motion| group.uses(motion)) {
            continue;
        }
        let mut parameters = setup.parameters(&group, motions);
        for parameter in &mut parameters {
            let [now, before] = [starts.get(&parameter.path)?, setup.before.get(&parameter.path)?];
            if now != before {
                parameter.start = now.clamp(parameter.low, parameter.high);
            }
        }
        let problem = group.problem(parameters, motions)?;
        let seed = state.config.seed.wrapping_mul(1000).wrapping_add(index as u64);
        fits.push((group, Fit::new(problem, &pass.method(&state.config.method), seed)?));
    }
    if fits.is_empty() { Err(IdentifyError::Nothing) } else { Ok(fits) }
}

/// Takes the best candidates of a pass over into the parameters.
fn end(setup: &Setup<'_>, state: &mut State, pass: Pass) {
    let mut fits = std::mem::take(&mut state.fits);
    let samples = fits.iter().map(|(_, fit)| fit.problem().samples()).sum();
    let mut begin_rms = state.rms;
    if pass == Pass::Restart {
        // Fits that did not end better are dropped.
        begin_rms = state.ended.last().map_or(begin_rms, |end| end.rms[1]);
        fits.retain(|(group, fit)| {
            let before = state.costs.get(&group.name).copied().unwrap_or(f64::INFINITY);
            fit.best().is_some_and(|best| best.cost < before)
        });
    } else {
        state.costs.clear();
    }
    for (group, fit) in &fits {
        if let Some(best) = fit.best() {
            state.costs.insert(group.name.clone(), best.cost);
            setup.set(&mut state.params, fit.problem(), &best.values);
        }
    }
    let rms = [begin_rms, root_mean_square(state.costs.values().sum(), samples)];
    state.ended.push(PassEnd { pass, replays: state.replays, secs: state.secs, rms });
}

/// Root mean square of the residuals of the best candidates.
fn rms(fits: &[(Group, Fit)]) -> f64 {
    let (cost, samples) = fits.iter().fold((0.0, 0), |(cost, samples), (_, fit)| {
        let best = fit.best().map_or(f64::INFINITY, |best| best.cost);
        (cost + best, samples + fit.problem().samples())
    });
    root_mean_square(cost, samples)
}

fn root_mean_square(cost: f64, samples: usize) -> f64 {
    f64::sqrt(2.0 * cost / samples.max(1) as f64)
}
