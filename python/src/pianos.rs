//! Environments of one song that step together into arrays of the caller's.

use std::fmt::Display;

use etude_checks::check_range;
use etude_lab::find_song;
use etude_learn::seed::fnv;
use etude_music::metrics::FrameTally;
use etude_stage::mjcf;
use etude_task::{ACTION_LEN, Environment, Piece, TargetRange, TaskConfig, layout};
use numpy::ndarray::Dimension;
use numpy::{
    PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray, PyReadwriteArray1, PyReadwriteArray2,
    PyUntypedArrayMethods as _,
};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use serde::{Deserialize, Serialize};

use crate::{Task, error, pictures};

/// As many as a training may have.
const MAX_ENVS: usize = 4096;
const MAX_THREADS: usize = 1024;
/// Columns of the scores: precision, recall and F1 of the song so far.
const SCORES: usize = 3;

/// An environment, and the scores of its episode so far.
struct Slot {
    environment: Environment,
    tally: FrameTally,
    over: bool,
}

/// The content of a saved state.
#[derive(Serialize, Deserialize)]
struct Saved {
    /// Of song and task.
    fingerprint: String,
    tally: FrameTally,
    over: bool,
    environment: String,
}

impl Slot {
    fn begin(&mut self, seed: Option<u64>) {
        match seed {
            Some(seed) => self.environment.restart(seed),
            None => self.environment.reset(),
        }
        (self.tally, self.over) = (FrameTally::default(), false);
    }
}

/// One environment with its rows of the caller's arrays.
struct StepRow<'a> {
    slot: &'a mut Slot,
    action: &'a [f32],
    observation: &'a mut [f32],
    last_observation: Option<&'a mut [f32]>,
    reward: &'a mut f64,
    over: &'a mut bool,
    collided: &'a mut bool,
    terms: &'a mut [f32],
    scores: &'a mut [f64],
}

impl StepRow<'_> {
    fn step(self, piece: &Piece) {
        let Slot { environment, tally, over } = self.slot;
        let action: &[f32; ACTION_LEN] = self.action.first_chunk().expect("rows have an action's length");
        let due = piece.due(environment.next_step());
        let begins_anew = self.last_observation.is_some();
        let step = match self.last_observation {
            Some(last) => environment.advance(action, self.terms, self.observation, last),
            None => {
                let step = environment.step(action, self.terms);
                environment.observe(self.observation);
                step
            }
        };
        tally.push(due, step.pressed);
        let scores = tally.scores();
        self.scores.copy_from_slice(&[scores.precision, scores.recall, scores.f1]);
        (*self.reward, *self.over, *self.collided) = (step.reward, step.song_over, step.collided);
        *over = step.song_over;
        if step.song_over && begins_anew {
            (*tally, *over) = (FrameTally::default(), false);
        }
    }
}

/// Environments of one song.
#[pyclass(module = "etude._native")]
pub struct Pianos {
    slots: Vec<Slot>,
    piece: Piece,
    config: TaskConfig,
    /// Of song and task.
    fingerprint: String,
    /// `None`: the calling thread alone.
    pool: Option<ThreadPool>,
}

/// A mutable view of an array of this shape, or what is wrong with it.
fn values<'a, T: numpy::Element, D: Dimension>(
    array: &'a mut PyReadwriteArray<'_, T, D>,
    name: &str,
    shape: &[usize],
) -> PyResult<&'a mut [T]> {
    let given = array.shape().to_vec();
    let wrong = || error(format!("{name} must be a C-contiguous array of shape {shape:?}, not {given:?}"));
    if given != shape {
        return Err(wrong());
    }
    array.as_slice_mut().map_err(|_| wrong())
}

/// The number `given` as `name`, from 1 to `max`.
fn count(name: &str, given: i64, max: usize) -> PyResult<usize> {
    check_range(name, given as f64, 1.0..=max as f64).map_err(error)?;
    usize::try_from(given).map_err(error)
}

/// Differs between songs and between tasks.
fn fingerprint(config: &TaskConfig, piece: &Piece) -> PyResult<String> {
    let mut bytes = serde_json::to_vec(config).map_err(error)?;
    for due in piece.frames() {
        bytes.extend(due.pitches().chain([u8::MAX]));
    }
    Ok(format!("{:016x}", fnv(&bytes)))
}

impl Pianos {
    fn slot(&self, index: usize) -> PyResult<&Slot> {
        let n = self.slots.len();
        self.slots.get(index).ok_or_else(|| error(format!("there is no environment {index}, there are {n}")))
    }
}

#[pymethods]
impl Pianos {
    #[new]
    fn new(py: Python<'_>, song: &str, task: &Task, num_envs: i64, threads: i64) -> PyResult<Self> {
        let config = task.0.clone();
        let num_envs = count("num_envs", num_envs, MAX_ENVS)?;
        let threads = count("threads", threads, MAX_THREADS)?;
        py.detach(|| {
            let song = find_song(song, false).map_err(error)?;
            config.check().map_err(error)?;
            let piece = Piece::for_task(&song, &config).map_err(error)?;
            let slot = |seed: usize| {
                let environment = Environment::new(&config, &piece, seed as u64).map_err(error)?;
                Ok(Slot { environment, tally: FrameTally::default(), over: false })
            };
            let slots = (0..num_envs).map(slot).collect::<PyResult<_>>()?;
            let pool = match threads.min(num_envs) {
                1 => None,
                threads => Some(ThreadPoolBuilder::new().num_threads(threads).build().map_err(error)?),
            };
            let fingerprint = fingerprint(&config, &piece)?;
            Ok(Self { slots, piece, config: config.clone(), fingerprint, pool })
        })
    }

    /// Columns of an observation: real ones, then those that are 0 or 1.
    #[getter]
    fn layout(&self) -> (usize, usize) {
        let layout = layout(&self.config);
        (layout.real, layout.binary)
    }

    #[getter]
    fn action_len(&self) -> usize {
        ACTION_LEN
    }

    /// The joint targets of the actions -1 and 1: rad, the rail in m. The rail's depend on the
    /// song.
    #[getter]
    fn action_range(&self) -> ([f64; ACTION_LEN], [f64; ACTION_LEN]) {
        let range = TargetRange::new(&self.piece);
        (range.targets(&[-1.0; ACTION_LEN], 0), range.targets(&[1.0; ACTION_LEN], 0))
    }

    /// Control steps of an episode.
    #[getter]
    fn steps(&self) -> usize {
        self.piece.steps()
    }

    #[getter]
    fn title(&self) -> &str {
        self.piece.title()
    }

    #[getter]
    fn reward_terms(&self) -> Vec<&str> {
        self.slots[0].environment.reward().names().collect()
    }

    /// Begins an episode in each environment of `mask`: with a new random stream if it has a seed.
    fn reset(
        &mut self,
        py: Python<'_>,
        seeds: Vec<Option<u64>>,
        mask: PyReadonlyArray1<'_, bool>,
        mut observations: PyReadwriteArray2<'_, f32>,
    ) -> PyResult<()> {
        let (n, width) = (self.slots.len(), layout(&self.config).len());
        let mask = mask.as_slice().map_err(error)?;
        if mask.len() != n || seeds.len() != n {
            return Err(error(format!("there must be a seed and a mask for each of {n} environments")));
        }
        let observations = values(&mut observations, "observations", &[n, width])?;
        py.detach(|| {
            let rows = self.slots.iter_mut().zip(observations.chunks_exact_mut(width));
            for ((slot, row), (seed, _)) in
                rows.zip(seeds.iter().zip(mask)).filter(|(_, (_, wanted))| **wanted)
            {
                slot.begin(*seed);
                slot.environment.observe(row);
            }
        });
        Ok(())
    }

    /// One control step of all environments. With `last_observations`, an episode that has ended
    /// restarts in the same step, and its last observation is written there.
    #[allow(clippy::too_many_arguments)] // One an array.
    fn step(
        &mut self,
        py: Python<'_>,
        actions: PyReadonlyArray2<'_, f32>,
        mut observations: PyReadwriteArray2<'_, f32>,
        mut last_observations: Option<PyReadwriteArray2<'_, f32>>,
        mut rewards: PyReadwriteArray1<'_, f64>,
        mut over: PyReadwriteArray1<'_, bool>,
        mut collided: PyReadwriteArray1<'_, bool>,
        mut terms: PyReadwriteArray2<'_, f32>,
        mut scores: PyReadwriteArray2<'_, f64>,
    ) -> PyResult<()> {
        let (n, width) = (self.slots.len(), layout(&self.config).len());
        let term_count = self.slots[0].environment.reward().names().len();
        let shape = actions.as_array().dim();
        let actions = match actions.as_slice() {
            Ok(actions) if shape == (n, ACTION_LEN) => actions,
            _ => {
                return Err(error(format!(
                    "the actions must have the shape ({n}, {ACTION_LEN}), not {shape:?}"
                )));
            }
        };
        if !actions.iter().all(|value| value.is_finite()) {
            return Err(error("an action is not a finite number"));
        }
        match self.slots.iter().position(|slot| slot.over) {
            Some(0) if n == 1 => return Err(error("the song is over: call reset() before the next step")),
            Some(index) => {
                return Err(error(format!(
                    "environment {index} is at the end of its song: call reset(options={{'reset_mask': …}}) before the next step"
                )));
            }
            None => {}
        }
        let observations = values(&mut observations, "observations", &[n, width])?;
        let last: Vec<Option<&mut [f32]>> = match &mut last_observations {
            Some(array) => {
                values(array, "last_observations", &[n, width])?.chunks_exact_mut(width).map(Some).collect()
            }
            None => (0..n).map(|_| None).collect(),
        };
        let rewards = values(&mut rewards, "rewards", &[n])?;
        let over = values(&mut over, "over", &[n])?;
        let collided = values(&mut collided, "collided", &[n])?;
        let terms = values(&mut terms, "terms", &[n, term_count])?;
        let scores = values(&mut scores, "scores", &[n, SCORES])?;

        let mut actions = actions.chunks_exact(ACTION_LEN);
        let (mut observations, mut last) = (observations.chunks_exact_mut(width), last.into_iter());
        let (mut rewards, mut over) = (rewards.iter_mut(), over.iter_mut());
        let (mut collided, mut scores) = (collided.iter_mut(), scores.chunks_exact_mut(SCORES));
        // A reward may have no terms, and `chunks_exact_mut(0)` panics.
        let mut terms_left = terms;
        let mut row = |slot| {
            let (terms, rest) = std::mem::take(&mut terms_left).split_at_mut(term_count);
            terms_left = rest;
            Some(StepRow {
                slot,
                action: actions.next()?,
                observation: observations.next()?,
                last_observation: last.next()?,
                reward: rewards.next()?,
                over: over.next()?,
                collided: collided.next()?,
                terms,
                scores: scores.next()?,
            })
        };
        let rows: Vec<StepRow<'_>> = self.slots.iter_mut().filter_map(&mut row).collect();
        let piece = &self.piece;
        match &self.pool {
            None => py.detach(|| rows.into_iter().for_each(|row| row.step(piece))),
            Some(pool) => py.detach(|| {
                pool.install(|| rows.into_par_iter().with_max_len(1).for_each(|row| row.step(piece)));
            }),
        }
        Ok(())
    }

    /// Everything that environment `index` needs to continue bit for bit.
    fn state<'py>(&self, py: Python<'py>, index: usize) -> PyResult<Bound<'py, PyBytes>> {
        let Slot { environment, tally, over } = self.slot(index)?;
        let environment = String::from_utf8(environment.save()).map_err(error)?;
        let saved = Saved { fingerprint: self.fingerprint.clone(), tally: *tally, over: *over, environment };
        Ok(PyBytes::new(py, &serde_json::to_vec(&saved).map_err(error)?))
    }

    /// Restores environment `index` from a state, and writes its observation.
    fn set_state(
        &mut self,
        index: usize,
        state: &[u8],
        mut observation: PyReadwriteArray2<'_, f32>,
    ) -> PyResult<()> {
        self.slot(index)?;
        let width = layout(&self.config).len();
        let row = values(&mut observation, "observation", &[1, width])?;
        let refuse = |why: &dyn Display| {
            error(format!("the environment cannot continue from this saved state: {why}"))
        };
        let saved: Saved = serde_json::from_slice(state).map_err(|why| refuse(&why))?;
        if saved.fingerprint != self.fingerprint {
            return Err(refuse(&"it is of another song or another task"));
        }
        let slot = &mut self.slots[index];
        let before = slot.environment.save();
        if let Err(why) = slot.environment.load(saved.environment.as_bytes()) {
            slot.environment.load(&before).map_err(error)?;
            return Err(error(why));
        }
        (slot.tally, slot.over) = (saved.tally, saved.over);
        slot.environment.observe(row);
        Ok(())
    }

    /// The world as MJCF, which stock MuJoCo loads.
    fn mjcf(&self) -> PyResult<String> {
        Ok(mjcf(&self.config.stage, &self.config.params().map_err(error)?))
    }

    /// Positions of all joints, keys included, in MuJoCo's order.
    fn qpos(&self, index: usize) -> PyResult<Vec<f64>> {
        Ok(self.slot(index)?.environment.world().data().qpos().to_vec())
    }

    /// A picture of environment `index`: rows from top to bottom, three bytes a pixel.
    fn render<'py>(
        &self,
        py: Python<'py>,
        index: usize,
        width: i64,
        height: i64,
        view: &str,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let (size, view) = pictures::parse(width, height, view)?;
        let pixels = pictures::paint(self.slot(index)?.environment.world(), size, view)?;
        Ok(PyBytes::new(py, &pixels))
    }
}
