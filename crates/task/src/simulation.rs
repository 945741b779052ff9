//! A simulated world, randomised, and the reward of what is played in it.

use etude_music::KeySet;
use etude_stage::{PhysicalParams, World};
use rand::SeedableRng as _;
use rand_pcg::Pcg64;

use crate::randomise::Randomisation;
use crate::reward::{Reward, StepContext};
use crate::stepper::{Command, RigState};
use crate::{Piece, TaskConfig, TaskError};

/// Result of one control step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepResult {
    /// Sum of the weighted reward terms; NaN if the physics diverged
    /// ([`StepOutcome::unstable`](etude_stage::StepOutcome::unstable)), at which the learner stops
    /// with an error.
    pub reward: f64,
    /// Whether the song is over. This is a truncation and not a terminal state: the learner
    /// bootstraps.
    pub song_over: bool,
    /// Whether there was a contact other than a fingertip on the keyboard.
    pub collided: bool,
    /// Keys that sound at its end.
    pub pressed: KeySet,
}

/// A world with its reward and its random stream.
pub struct Simulation {
    pub(crate) world: World,
    reward: Reward,
    randomisation: Randomisation,
    pub(crate) random: Pcg64,
}

impl Simulation {
    /// The simulation of a task in its starting pose, with its own random stream from `seed`.
    ///
    /// # Errors
    /// If the configuration is not valid.
    pub fn new(config: &TaskConfig, seed: u64) -> Result<Self, TaskError> {
        config.check()?;
        let params = config.params()?;
        let randomisation =
            Randomisation::new(params.clone(), &config.randomisation, config.stage.actuation)?;
        let mut simulation = Self {
            world: World::new(&config.stage, &params)?,
            reward: Reward::new(&config.reward)?,
            randomisation,
            random: Pcg64::seed_from_u64(seed),
        };
        simulation.reset();
        Ok(simulation)
    }

    /// Puts the hand into its starting pose, in the next world of the randomisation.
    pub fn reset(&mut self) {
        if self.randomisation.is_on() {
            self.world.set_params(&self.randomisation.draw(&mut self.random));
        }
        self.world.reset();
    }

    /// Resets everything, including the random stream: the state of a new simulation with this
    /// seed.
    pub fn restart(&mut self, seed: u64) {
        self.random = Pcg64::seed_from_u64(seed);
        self.reset();
    }

    /// The same simulation in the world `params`. Only without randomisation: with it, the next
    /// reset would draw another world.
    pub fn set_params(&mut self, params: &PhysicalParams) {
        self.world.set_params(params);
        self.world.reset();
    }

    /// Plays one control step of `piece`. Writes the weighted reward terms into `parts`, in the
    /// order of [`Reward::names`].
    pub fn step(&mut self, piece: &Piece, command: &Command<'_>, parts: &mut [f32]) -> StepResult {
        let step = command.step;
        let pressed_before = self.world.pressed();
        let outcome = self.world.step(&command.targets);
        let context = StepContext {
            world: &self.world,
            due: piece.due(step),
            to_hold: piece.held(step),
            pressed_before,
            outcome,
            targets: &command.targets,
            action: command.action,
            previous_action: command.previous_action,
            goals: piece.goals(step),
        };
        let reward = self.reward.evaluate(&context, parts);
        StepResult {
            reward: if outcome.unstable { f64::NAN } else { reward },
            song_over: step + 1 >= piece.steps(),
            collided: outcome.collided,
            pressed: self.world.pressed(),
        }
    }

    /// What is known of the hand and the keyboard.
    pub fn state(&self) -> RigState {
        (&self.world).into()
    }

    /// The world.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The reward.
    pub fn reward(&self) -> &Reward {
        &self.reward
    }
}
