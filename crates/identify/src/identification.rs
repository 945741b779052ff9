//! From recordings to physical numbers: joint by joint, then finger by finger, then what only touching keys tells.
//!
//! Each stage is a [`Fit`] a group, all of them fed by the same replays. Everything is written to a file after each batch,
//! and a fit that was interrupted goes on from there to the same end.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use etude_perform::{FileError, shaping_params, write_file};
use etude_stage::{JOINTS, PhysicalParams, StageConfig, StageError};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, Differences, LmConfig, MethodConfig};
use crate::estimate::{Estimate, EstimateError, HALF_INTERVAL, WEAK_HALF_INTERVAL};
use crate::fit::{Candidate, Fit, TellError};
use crate::group::{Group, GroupError, fingers, joints, keyboard};
use crate::jacobian::JacobianError;
use crate::motion::Motion;
use crate::problem::{Evaluation, Problem};
use crate::replay::{Replayer, Trace};
use crate::rows::{contact_parameters, follow_stiffness, joint_parameters};
use crate::space::Parameter;

mod judge;
mod order;

/// Step of the differences that the last slopes and the estimate's intervals come from, as a share of each range.
const ESTIMATE_STEP: f64 = 1e-3;
/// Curvature of the cost along a number that is just told by itself, as the estimate has it.
const LEAST_CURVATURE: f64 = (HALF_INTERVAL / WEAK_HALF_INTERVAL) * (HALF_INTERVAL / WEAK_HALF_INTERVAL);

/// Parts of an identification, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// Every joint by itself.
    Joints,
    /// Every joint by itself from another start, kept where it ends better; by Levenberg–Marquardt only.
    Restart,
    /// Every finger's joints together, and the rail; by Levenberg–Marquardt only, the others cope with few parameters.
    Fingers,
    /// The keyboard and the encoders' biases, from motions that touch keys.
    Contact,
}

impl Stage {
    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Joints => "joint by joint",
            Self::Restart => "joint by joint, restarted",
            Self::Fingers => "finger by finger",
            Self::Contact => "keyboard",
        }
    }

    fn groups(self) -> Vec<Group> {
        match self {
            Self::Joints | Self::Restart => joints(),
            Self::Fingers => fingers(),
            Self::Contact => vec![keyboard()],
        }
    }
}

/// How to identify.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IdentifyConfig {
    /// The method of every stage.
    pub method: MethodConfig,
    /// Owns every random draw.
    pub seed: u64,
    /// Where the fit starts: rows other than the defaults, by path.
    pub start: BTreeMap<String, f64>,
}

/// An identification failed.
#[derive(Debug, thiserror::Error)]
pub enum IdentifyError {
    /// The world cannot be built.
    #[error(transparent)]
    Stage(#[from] StageError),
    /// A start value that is none.
    #[error(transparent)]
    Param(#[from] etude_stage::ParamError),
    /// The method's numbers.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A group cannot be fitted.
    #[error(transparent)]
    Group(#[from] GroupError),
    /// A fit was told the wrong thing: a bug.
    #[error(transparent)]
    Tell(#[from] TellError),
    /// The end cannot be judged.
    #[error(transparent)]
    Estimate(#[from] EstimateError),
    /// Nor its slopes.
    #[error(transparent)]
    Jacobian(#[from] JacobianError),
    /// The state cannot be written.
    #[error(transparent)]
    Write(#[from] FileError),
    /// The state cannot be read, or is of another identification.
    #[error("{0}; remove it, or choose another folder with -o, to begin anew")]
    State(String),
    /// Nothing to fit.
    #[error("none of the recordings moves a joint; record an excitation (`etude record --excitation chirp`)")]
    Nothing,
    /// On request; what was done is saved.
    #[error("interrupted; the same command goes on from where it stopped")]
    Interrupted,
}

/// How far it has got.
#[derive(Clone, Debug)]
pub struct Progress {
    /// The stage.
    pub stage: Stage,
    /// Replays of all motions so far in this stage.
    pub replays: u64,
    /// Root mean square of all residuals of the best candidates so far, in standard deviations of the noise.
    pub rms: f64,
    /// Groups that have ended, of all.
    pub ended: [usize; 2],
}

/// One stage as it ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageEnd {
    /// Which.
    pub stage: Stage,
    /// Replays of all motions.
    pub replays: u64,
    /// Time that they and the method took, s, over all interruptions.
    pub secs: f64,
    /// Root mean square of the residuals at its beginning and at its end, in standard deviations of the noise.
    pub rms: [f64; 2],
}

/// What came of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Identified {
    /// Rows other than the defaults, by path: the identified simulator.
    pub physics: BTreeMap<String, f64>,
    /// Where the fit started.
    pub before: BTreeMap<String, f64>,
    /// The stages.
    pub stages: Vec<StageEnd>,
    /// What the estimates of the last stage of each group are worth.
    pub estimates: Vec<(String, Estimate)>,
}

/// What is kept on the way.
#[derive(Serialize, Deserialize)]
struct State {
    config: IdentifyConfig,
    /// What tells recordings from others: path, length and start of each.
    motions: Vec<(String, usize, [f64; JOINTS])>,
    params: PhysicalParams,
    ended: Vec<StageEnd>,
    /// Whether all stages are.
    done: bool,
    /// The stage under way.
    stage: Stage,
    fits: Vec<(Group, Fit)>,
    replays: u64,
    secs: f64,
    rms: f64,
    /// The cost that each group of the last stage ended with.
    costs: BTreeMap<String, f64>,
}

/// Fits the simulator to motions of one rig. What is needed to go on after an interruption is in the file `state`.
///
/// # Errors
/// If there is nothing to fit, a number makes no sense, or a file cannot be read or written; [`IdentifyError::Interrupted`]
/// when `interrupt` is set.
pub fn identify(
    motions: &[Motion],
    config: &IdentifyConfig,
    state: &Path,
    tell: &mut dyn FnMut(&Progress),
    interrupt: &AtomicBool,
) -> Result<Identified, IdentifyError> {
    let mut work = Work::open(motions, config, state)?;
    while let Some(stage) = work.next_stage() {
        work.run(stage, tell, interrupt)?;
    }
    work.state.done = true;
    work.save()?;
    work.finish()
}

struct Work<'a> {
    motions: &'a [Motion],
    world: StageConfig,
    before: PhysicalParams,
    file: &'a Path,
    state: State,
}

impl<'a> Work<'a> {
    fn open(motions: &'a [Motion], config: &IdentifyConfig, file: &'a Path) -> Result<Self, IdentifyError> {
        let first = motions.first().ok_or(IdentifyError::Nothing)?;
        let world = StageConfig { side: first.side(), ..StageConfig::default() };
        let before = shaping_params(&first.rig.limits).with(&config.start)?;
        let marks: Vec<_> = motions
            .iter()
            .map(|motion| (motion.path.display().to_string(), motion.commands.steps(), motion.start))
            .collect();
        let fresh = State {
            config: config.clone(),
            motions: marks,
            params: before.clone(),
            ended: Vec::new(),
            done: false,
            stage: Stage::Joints,
            fits: Vec::new(),
            replays: 0,
            secs: 0.0,
            rms: 0.0,
            costs: BTreeMap::new(),
        };
        let state = match std::fs::read(file) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => fresh,
            Err(error) => {
                return Err(IdentifyError::State(format!("cannot read {}: {error}", file.display())));
            }
            Ok(bytes) => {
                let saved: State = serde_json::from_slice(&bytes).map_err(|error| {
                    IdentifyError::State(format!("{} is damaged: {error}", file.display()))
                })?;
                let same = saved.config == fresh.config && saved.motions == fresh.motions;
                if !same && !saved.done {
                    let what = "is of an unfinished identification with other recordings or settings";
                    return Err(IdentifyError::State(format!("{} {what}", file.display())));
                }
                if same { saved } else { fresh }
            }
        };
        Ok(Self { motions, world, before, file, state })
    }

    /// Motions that touch no key: what the drives of the joints are fitted to.
    fn air(&self) -> impl Iterator<Item = &'a Motion> + use<'a> {
        self.motions.iter().filter(|motion| motion.keys.is_empty())
    }

    fn motions_of(&self, stage: Stage) -> Vec<Motion> {
        match stage {
            Stage::Joints | Stage::Restart | Stage::Fingers => self.air().cloned().collect(),
            Stage::Contact => self.motions.iter().filter(|motion| !motion.keys.is_empty()).cloned().collect(),
        }
    }

    /// What a group of a stage estimates, with bounds around what the numbers were before the first stage.
    fn parameters(&self, stage: Stage, group: &Group, motions: &[Motion]) -> Vec<Parameter> {
        match stage {
            Stage::Contact => contact_parameters(&self.before),
            _ => drives(group, motions, &self.before),
        }
    }

    /// The method of a stage. The fingers are the last word on the drives. Their slopes are taken to both sides: over so wide a
    /// difference they do not feel how rough the replays are, and yet they do not lean. The damping falls to a millionth on
    /// the way, so that a joint's scale of torque, which moves its cost by one in 250, is found too; a number that the
    /// recordings do not tell is left where it is, or a step along it would end in another valley.
    fn method(&self, stage: Stage) -> MethodConfig {
        match &self.state.config.method {
            MethodConfig::Lm(lm) if stage == Stage::Fingers => MethodConfig::Lm(LmConfig {
                differences: Differences::Central,
                difference_step: ESTIMATE_STEP,
                first_difference_step: ESTIMATE_STEP,
                initial_damping: 1e-3,
                cost_tolerance: 0.1 * lm.cost_tolerance,
                least_curvature: LEAST_CURVATURE,
                ..lm.clone()
            }),
            method => method.clone(),
        }
    }

    fn begin(
        &mut self,
        stage: Stage,
        starts: &PhysicalParams,
        motions: &[Motion],
    ) -> Result<(), IdentifyError> {
        let mut fits = Vec::new();
        for (index, group) in stage.groups().into_iter().enumerate() {
            if !motions.iter().any(|motion| group.learns_from(motion)) {
                continue;
            }
            let mut parameters = self.parameters(stage, &group, motions);
            for parameter in &mut parameters {
                // Where an earlier stage has left it.
                let [now, before] = [starts.get(&parameter.path)?, self.before.get(&parameter.path)?];
                if now != before {
                    parameter.start = now.clamp(parameter.low, parameter.high);
                }
            }
            let problem = group.problem(parameters, motions)?;
            let seed = self.state.config.seed.wrapping_mul(1000).wrapping_add(index as u64);
            fits.push((group, Fit::new(problem, &self.method(stage), seed)?));
        }
        if fits.is_empty() {
            return Err(IdentifyError::Nothing);
        }
        (self.state.stage, self.state.fits, self.state.replays, self.state.secs) = (stage, fits, 0, 0.0);
        Ok(())
    }

    fn run(
        &mut self,
        stage: Stage,
        tell: &mut dyn FnMut(&Progress),
        interrupt: &AtomicBool,
    ) -> Result<(), IdentifyError> {
        let motions = self.motions_of(stage);
        if self.state.fits.is_empty() || self.state.stage != stage {
            if self.state.ended.is_empty() && stage == Stage::Joints {
                self.find_delays(&motions, interrupt)?;
            }
            let mut starts = self.state.params.clone();
            if stage == Stage::Restart {
                self.cross_the_kinks(&mut starts);
            }
            self.begin(stage, &starts, &motions)?;
        }
        let began = self.state.params.clone();
        loop {
            let begun = Instant::now();
            let asked: Vec<Vec<Candidate>> = self.state.fits.iter_mut().map(|(_, fit)| fit.ask()).collect();
            let batch = asked.iter().map(Vec::len).max().unwrap_or(0);
            if batch == 0 {
                break;
            }
            if interrupt.load(Ordering::Relaxed) {
                return Err(IdentifyError::Interrupted);
            }
            let worlds: Vec<PhysicalParams> = (0..batch).map(|index| self.world_of(&asked, index)).collect();
            let traces = self.replay(&worlds, &motions, stage == Stage::Contact, interrupt)?;
            for ((group, fit), candidates) in self.state.fits.iter_mut().zip(&asked) {
                if !candidates.is_empty() {
                    let evaluations: Vec<Evaluation> = (0..candidates.len())
                        .map(|index| group.evaluate(&began, &worlds[index], &motions, &traces[index]))
                        .collect();
                    fit.tell(&evaluations)?;
                }
            }
            let rms = rms(&self.state.fits);
            if self.state.replays == 0 {
                self.state.rms = rms;
            }
            self.state.replays += batch as u64;
            self.state.secs += begun.elapsed().as_secs_f64();
            let ended = self.state.fits.iter().filter(|(_, fit)| fit.finished().is_some()).count();
            let replays = self.state.replays;
            // Told first: who is killed in between is told again, and misses nothing.
            tell(&Progress { stage, replays, rms, ended: [ended, self.state.fits.len()] });
            self.save()?;
        }
        let mut fits = std::mem::take(&mut self.state.fits);
        let samples = fits.iter().map(|(_, fit)| fit.problem().samples()).sum();
        let mut begin_rms = self.state.rms;
        let costs = &mut self.state.costs;
        if stage == Stage::Restart {
            // What did not end better stays as it was.
            begin_rms = self.state.ended.last().map_or(begin_rms, |end| end.rms[1]);
            fits.retain(|(group, fit)| {
                let before = costs.get(&group.name).copied().unwrap_or(f64::INFINITY);
                fit.best().is_some_and(|best| best.cost < before)
            });
        } else {
            costs.clear();
        }
        costs.extend(fits.iter().filter_map(|(group, fit)| Some((group.name.clone(), fit.best()?.cost))));
        let end_rms = root_mean_square(costs.values().sum(), samples);
        self.state.params = best_of(&self.state.params, &fits);
        if stage != Stage::Contact {
            let saturates = |joint| saturates(&motions, joint);
            follow_stiffness(&self.before, saturates, &mut self.state.params);
        }
        let (replays, secs) = (self.state.replays, self.state.secs);
        self.state.ended.push(StageEnd { stage, replays, secs, rms: [begin_rms, end_rms] });
        self.save()
    }

    /// A world with the candidate `index` of each fit, or with the best so far of one that has fewer.
    fn world_of(&self, asked: &[Vec<Candidate>], index: usize) -> PhysicalParams {
        let mut params = self.state.params.clone();
        for ((_, fit), candidates) in self.state.fits.iter().zip(asked) {
            let values = candidates.get(index).map(|candidate| &candidate.values);
            if let Some(values) = values.or_else(|| fit.best().map(|best| &best.values)) {
                set(&mut params, fit.problem(), values);
            }
        }
        params
    }

    /// Replays every motion in every world: one list a world, one trace a motion.
    fn replay(
        &self,
        worlds: &[PhysicalParams],
        motions: &[Motion],
        keys: bool,
        interrupt: &AtomicBool,
    ) -> Result<Vec<Vec<Option<Trace>>>, IdentifyError> {
        let jobs: Vec<(usize, usize)> = (0..worlds.len())
            .flat_map(|world| (0..motions.len()).map(move |motion| (world, motion)))
            .collect();
        let replayer = || Replayer::new(&self.world);
        let traces: Vec<Option<Trace>> = jobs
            .par_iter()
            .map_init(replayer, |replayer, (world, motion)| match replayer {
                _ if interrupt.load(Ordering::Relaxed) => Err(IdentifyError::Interrupted),
                Ok(replayer) => Ok(replayer.replay(&worlds[*world], &motions[*motion], keys)),
                Err(_) => Err(replayer_error(&self.world)),
            })
            .collect::<Result<_, _>>()?;
        let mut traces = traces.into_iter();
        Ok(worlds.iter().map(|_| traces.by_ref().take(motions.len()).collect()).collect())
    }

    fn save(&self) -> Result<(), IdentifyError> {
        // Numbers, strings and paths: writing them as JSON cannot fail.
        let text = serde_json::to_string(&self.state).unwrap_or_default();
        Ok(write_file(self.file, &text)?)
    }
}

/// Parameters of a group's joints.
fn drives(group: &Group, motions: &[Motion], before: &PhysicalParams) -> Vec<Parameter> {
    let of_joint = |&joint: &usize| {
        let influenced: Vec<String> = group.influenced(joint, motions).collect();
        // A joint of a finger that never moves has no number to find.
        let parameters =
            (!influenced.is_empty()).then(|| joint_parameters(joint, saturates(motions, joint), before));
        parameters.into_iter().flatten().map(move |parameter| parameter.influencing(influenced.clone()))
    };
    group.joints.iter().flat_map(of_joint).collect()
}

/// Whether the motions tell where the limit of a joint's drive is.
fn saturates(motions: &[Motion], joint: usize) -> bool {
    motions.iter().any(|motion| motion.saturates[joint])
}

fn replayer_error(world: &StageConfig) -> IdentifyError {
    match Replayer::new(world) {
        Err(error) => error.into(),
        Ok(_) => StageError::Missing("memory for another world".to_string()).into(),
    }
}

fn set(params: &mut PhysicalParams, problem: &Problem, values: &[f64]) {
    for (parameter, value) in problem.space().parameters().iter().zip(values) {
        // A path of the rows, within their bounds.
        let _ = params.set(&parameter.path, *value);
    }
}

fn best_of(before: &PhysicalParams, fits: &[(Group, Fit)]) -> PhysicalParams {
    let mut params = before.clone();
    for (_, fit) in fits {
        if let Some(best) = fit.best() {
            set(&mut params, fit.problem(), &best.values);
        }
    }
    params
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
