//! One environment. An episode is one performance of the song, or of a new piece of a corpus.
//!
//! Reading order: [`Environment::reset`], [`Environment::step`], [`Environment::observe`], [`Environment::save`].

use std::sync::Arc;

use etude_learn::EnvironmentError;
use etude_music::KeySet;
use etude_stage::{DRIVEN_JOINTS, PhysicalParams, Snapshot, World};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use crate::observation::{History, observe};
use crate::randomise::Randomisation;
use crate::reward::{Moment, Reward};
use crate::{ACTION_LEN, Corpus, Piece, TargetRange, TaskConfig, TaskError};

/// Result of one control step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Sum of the weighted reward terms; NaN if the physics diverged
    /// ([`StepOutcome::unstable`](etude_stage::StepOutcome::unstable)), at which the learner stops with an error.
    pub reward: f64,
    /// Whether the song is over. This is a truncation and not a terminal state: the learner bootstraps.
    pub song_over: bool,
    /// Whether there was a contact other than a fingertip on the keyboard.
    pub collided: bool,
    /// Keys that sound at its end.
    pub pressed: KeySet,
}

/// A world, a piece, and the current control step.
pub struct Environment {
    world: World,
    piece: Piece,
    /// Where each episode's piece comes from, if not all play the same.
    drawn: Option<Drawn>,
    range: TargetRange,
    config: TaskConfig,
    reward: Reward,
    randomisation: Randomisation,
    random: Pcg64,
    /// Next control step of the piece.
    step: usize,
    history: History,
}

/// A corpus, and the number of the piece in play.
struct Drawn {
    corpus: Arc<Corpus>,
    number: u64,
}

/// What [`Environment::save`] keeps.
#[derive(Serialize, Deserialize)]
struct Saved {
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
    /// An environment for `piece` at the start of an episode, with its own random stream from `seed`.
    ///
    /// # Errors
    /// If the configuration is not sound.
    pub fn new(config: &TaskConfig, piece: &Piece, seed: u64) -> Result<Self, TaskError> {
        config.check()?;
        let params = config.params()?;
        let randomisation =
            Randomisation::new(params.clone(), &config.randomisation, config.stage.actuation)?;
        if config.fingering != piece.fingering().is_some() {
            let error = "the piece and the configuration differ in `fingering`; make it by `Piece::for_task`";
            return Err(TaskError::Value(error.to_string()));
        }
        let range = TargetRange::new(piece);
        let mut environment = Self {
            world: World::new(&config.stage, &params)?,
            piece: piece.clone(),
            drawn: None,
            config: config.clone(),
            reward: Reward::new(&config.reward)?,
            randomisation,
            random: Pcg64::seed_from_u64(seed),
            step: 0,
            history: History::at_rest([0.0; DRIVEN_JOINTS], &range, 0),
            range,
        };
        environment.reset();
        Ok(environment)
    }

    /// An environment that draws a piece of `corpus` for each episode, at the start of the first.
    ///
    /// # Errors
    /// If the configuration is not sound.
    pub fn of_corpus(config: &TaskConfig, corpus: &Arc<Corpus>, seed: u64) -> Result<Self, TaskError> {
        let mut environment = Self::new(config, &corpus.piece(0), seed)?;
        environment.drawn = Some(Drawn { corpus: corpus.clone(), number: 0 });
        environment.restart(seed);
        Ok(environment)
    }

    /// Starts an episode with the physical numbers `params`. Only for environments without randomisation: with it, the next reset
    /// would draw other numbers.
    pub fn reset_in(&mut self, params: &PhysicalParams) {
        self.world.set_params(params);
        self.reset();
    }

    /// Resets everything, including the random stream: the state of a new environment with this seed.
    pub fn restart(&mut self, seed: u64) {
        self.random = Pcg64::seed_from_u64(seed);
        self.reset();
    }

    /// Takes the piece of this number from the corpus, if there is one.
    fn take(&mut self, number: u64) {
        if let Some(drawn) = &mut self.drawn {
            drawn.number = number;
            self.piece = drawn.corpus.piece(number);
            self.range = TargetRange::new(&self.piece);
        }
    }

    /// Starts the next episode: draws a piece of the corpus and the randomised numbers and puts the hand into its starting pose, at the
    /// beginning of the song.
    pub fn reset(&mut self) {
        if self.drawn.is_some() {
            let number = u64::from(self.random.random::<u32>());
            self.take(number);
        }
        if self.randomisation.is_on() {
            let params = self.randomisation.draw(&mut self.random);
            self.world.set_params(&params);
        }
        self.world.reset();
        self.step = 0;
        self.history = History::at_rest(self.world.joints(), &self.range, 0);
    }

    /// The places of the joints that the observation has.
    fn joints(&self) -> [f64; DRIVEN_JOINTS] {
        self.config.observed(self.world.joints(), self.world.set_points())
    }

    /// Plays one control step with `action` (each value in [−1, 1]). Writes the weighted reward terms into `parts`, in the order
    /// of [`Reward::names`].
    pub fn step(&mut self, action: &[f32; ACTION_LEN], parts: &mut [f32]) -> Step {
        let due = self.piece.due(self.step);
        let joints = self.joints();
        let pressed_before = self.world.pressed();
        let targets = self.range.targets(action, self.step);
        let outcome = self.world.step(&targets);
        let moment = Moment {
            world: &self.world,
            due,
            held: self.piece.held(self.step),
            pressed_before,
            outcome,
            targets: &targets,
            action,
            previous_action: &self.history.actions[0],
            goals: self.piece.goals(self.step),
        };
        let reward = self.reward.evaluate(&moment, parts);
        let reward = if outcome.unstable { f64::NAN } else { reward };
        self.history.push(joints, action);
        self.step += 1;
        let song_over = self.step >= self.piece.steps();
        Step { reward, song_over, collided: outcome.collided, pressed: self.world.pressed() }
    }

    /// Writes the current observation, of the length of [`layout`](crate::layout).
    pub fn observe(&self, out: &mut [f32]) {
        let joints = self.joints();
        let pressed = self.world.pressed();
        observe(&self.config, &joints, &self.history, pressed, &self.piece, self.step, out);
    }

    /// Plays one control step and writes the observation after it into `last`. When the song is over the next episode begins.
    /// `observation` receives what the next action is chosen from.
    pub fn advance(
        &mut self,
        action: &[f32; ACTION_LEN],
        parts: &mut [f32],
        observation: &mut [f32],
        last: &mut [f32],
    ) -> Step {
        let step = self.step(action, parts);
        self.observe(last);
        if step.song_over {
            self.reset();
            self.observe(observation);
        } else {
            observation.copy_from_slice(last);
        }
        step
    }

    /// The piece in play.
    pub fn piece(&self) -> &Piece {
        &self.piece
    }

    /// The control step that is played next.
    pub fn position(&self) -> usize {
        self.step
    }

    /// The mapping from actions to joint targets.
    pub fn range(&self) -> &TargetRange {
        &self.range
    }

    /// The world.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The reward.
    pub fn reward(&self) -> &Reward {
        &self.reward
    }

    /// The state as JSON; [`load`](Self::load) continues from it bit for bit.
    pub fn save(&self) -> Vec<u8> {
        let saved = Saved {
            snapshot: self.world.snapshot(),
            params: self.world.params().clone(),
            random: self.random.clone(),
            step: self.step,
            history: self.history,
            number: self.drawn.as_ref().map(|drawn| drawn.number),
        };
        serde_json::to_vec(&saved).expect("plain numbers and strings become JSON")
    }

    /// Continues from [`Environment::save`].
    ///
    /// # Errors
    /// If the bytes are not the saved state of such an environment. It must then be [reset](Self::reset) before use.
    pub fn load(&mut self, bytes: &[u8]) -> Result<(), EnvironmentError> {
        let saved: Saved = serde_json::from_slice(bytes).map_err(|e| EnvironmentError::new(e.to_string()))?;
        if saved.number.is_some() != self.drawn.is_some() {
            return Err(EnvironmentError::new(
                "it is of one song, or of a corpus, and this training of the other",
            ));
        }
        if let Some(number) = saved.number {
            self.take(number);
        }
        if saved.step > self.piece.steps() {
            return Err(EnvironmentError::new("it is beyond the end of the song"));
        }
        saved.params.check().map_err(|e| EnvironmentError::new(e.to_string()))?;
        self.world.set_params(&saved.params);
        self.world.restore(&saved.snapshot).map_err(|e| EnvironmentError::new(e.to_string()))?;
        self.random = saved.random;
        self.step = saved.step;
        self.history = saved.history;
        Ok(())
    }
}
