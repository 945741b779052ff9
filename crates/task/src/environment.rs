//! One environment. An episode is one performance of the song, or of a new piece of a corpus.
//!
//! Reading order: [`Environment::reset`], [`Environment::step`], [`Environment::observe`],
//! [`Environment::save`].

use std::sync::Arc;

use etude_learn::EnvironmentError;
use etude_stage::{PhysicalParams, Snapshot, World};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use crate::observation::History;
use crate::reward::Reward;
use crate::simulation::{Simulation, StepResult};
use crate::stepper::Stepper;
use crate::{ACTION_LEN, Corpus, Piece, TaskConfig, TaskError};

/// A simulation, and a piece that is played in it.
pub struct Environment {
    simulation: Simulation,
    stepper: Stepper,
    /// Where each episode's piece comes from, if not all play the same.
    drawn: Option<DrawnPiece>,
}

/// A corpus, and the number of the piece in play.
struct DrawnPiece {
    corpus: Arc<Corpus>,
    number: u64,
}

/// The saved state of an environment.
#[derive(Serialize, Deserialize)]
struct SavedState {
    snapshot: Snapshot,
    params: PhysicalParams,
    random: Pcg64,
    step: usize,
    history: History,
    /// Of a corpus, the number of the piece in play.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    number: Option<u64>,
}

impl Environment {
    /// An environment for `piece` at the start of an episode, with its own random stream from
    /// `seed`.
    ///
    /// # Errors
    /// If the configuration is not valid.
    pub fn new(config: &TaskConfig, piece: &Piece, seed: u64) -> Result<Self, TaskError> {
        let simulation = Simulation::new(config, seed)?;
        let stepper = Stepper::new(config, piece, &simulation.state())?;
        Ok(Self { simulation, stepper, drawn: None })
    }

    /// An environment that draws a piece of `corpus` for each episode, at the start of the first.
    ///
    /// # Errors
    /// If the configuration is not valid.
    pub fn of_corpus(config: &TaskConfig, corpus: &Arc<Corpus>, seed: u64) -> Result<Self, TaskError> {
        let mut environment = Self::new(config, &corpus.piece(0), seed)?;
        environment.drawn = Some(DrawnPiece { corpus: corpus.clone(), number: 0 });
        environment.restart(seed);
        Ok(environment)
    }

    /// Resets everything, including the random stream: the state of a new environment with this
    /// seed.
    pub fn restart(&mut self, seed: u64) {
        self.simulation.random = Pcg64::seed_from_u64(seed);
        self.reset();
    }

    /// Takes the piece of this number from the corpus, if there is one.
    fn take(&mut self, number: u64) {
        if let Some(drawn) = &mut self.drawn {
            drawn.number = number;
            self.stepper.set_piece(drawn.corpus.piece(number));
        }
    }

    /// Starts the next episode: draws a piece of the corpus and the randomised parameters and puts
    /// the hand into its starting pose, at the beginning of the song.
    pub fn reset(&mut self) {
        if self.drawn.is_some() {
            let number = u64::from(self.simulation.random.random::<u32>());
            self.take(number);
        }
        self.simulation.reset();
        self.stepper.begin(&self.simulation.state());
    }

    /// Plays one control step with `action` (each value in [−1, 1]). Writes the weighted reward
    /// terms into `parts`, in the order of [`Reward::names`].
    pub fn step(&mut self, action: &[f32; ACTION_LEN], parts: &mut [f32]) -> StepResult {
        let state = self.simulation.state();
        let result = self.simulation.step(self.stepper.piece(), &self.stepper.command(action), parts);
        self.stepper.advance(&state, action);
        result
    }

    /// Writes the current observation, of the length of [`layout`](crate::layout).
    pub fn observe(&self, out: &mut [f32]) {
        self.stepper.observe(&self.simulation.state(), out);
    }

    /// Plays one control step and writes the observation after it into `last`. When the song is
    /// over the next episode begins. `observation` receives what the next action is chosen from.
    pub fn advance(
        &mut self,
        action: &[f32; ACTION_LEN],
        parts: &mut [f32],
        observation: &mut [f32],
        last: &mut [f32],
    ) -> StepResult {
        let result = self.step(action, parts);
        self.observe(last);
        if result.song_over {
            self.reset();
            self.observe(observation);
        } else {
            observation.copy_from_slice(last);
        }
        result
    }

    /// The piece in play.
    pub fn piece(&self) -> &Piece {
        self.stepper.piece()
    }

    /// The control step that is played next.
    pub fn next_step(&self) -> usize {
        self.stepper.next_step()
    }

    /// The world.
    pub fn world(&self) -> &World {
        self.simulation.world()
    }

    /// The reward.
    pub fn reward(&self) -> &Reward {
        self.simulation.reward()
    }

    /// The state as JSON; [`load`](Self::load) continues from it bit for bit.
    pub fn save(&self) -> Vec<u8> {
        let saved = SavedState {
            snapshot: self.world().snapshot(),
            params: self.world().params().clone(),
            random: self.simulation.random.clone(),
            step: self.stepper.step,
            history: self.stepper.history,
            number: self.drawn.as_ref().map(|drawn| drawn.number),
        };
        serde_json::to_vec(&saved).expect("plain numbers and strings become JSON")
    }

    /// Continues from [`Environment::save`].
    ///
    /// # Errors
    /// If the bytes are not the saved state of such an environment. It must then be
    /// [reset](Self::reset) before use.
    pub fn load(&mut self, bytes: &[u8]) -> Result<(), EnvironmentError> {
        let refuse = |error: &dyn std::fmt::Display| EnvironmentError::new(error.to_string());
        let saved: SavedState = serde_json::from_slice(bytes).map_err(|error| refuse(&error))?;
        if saved.number.is_some() != self.drawn.is_some() {
            return Err(refuse(&"it is of one song, or of a corpus, and this training of the other"));
        }
        if let Some(number) = saved.number {
            self.take(number);
        }
        if saved.step > self.piece().steps() {
            return Err(refuse(&"it is beyond the end of the song"));
        }
        saved.params.check().map_err(|error| refuse(&error))?;
        let world = &mut self.simulation.world;
        world.set_params(&saved.params);
        world.restore(&saved.snapshot).map_err(|error| refuse(&error))?;
        self.simulation.random = saved.random;
        self.stepper.step = saved.step;
        self.stepper.history = saved.history;
        Ok(())
    }
}
