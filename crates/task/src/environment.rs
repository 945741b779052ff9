//! One environment: an episode is the song played once.

use etude_learn::EnvironmentError;
use etude_music::{KeySet, key_is_black};
use etude_stage::geometry::HALF_WIDTH;
use etude_stage::hand::root_lateral;
use etude_stage::params::Joint;
use etude_stage::{FINGERS, JOINTS, PhysicalParams, RAIL, Snapshot, World};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use crate::observation::observe;
use crate::randomise::Randomisation;
use crate::reward::{Moment, Reward};
use crate::{ACTION_LEN, Piece, TargetRange, TaskConfig, TaskError};

/// Result of one control step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Sum of the weighted reward terms. Not a number, which no learner takes, if the physics has become
    /// [unstable](etude_stage::StepOutcome::unstable).
    pub reward: f64,
    /// Whether the song is over. Not a terminal state: the learner bootstraps on.
    pub song_over: bool,
    /// Whether anything but fingertips on the keyboard touched, whatever the reward makes of it.
    pub collided: bool,
    /// Keys that sound at its end.
    pub pressed: KeySet,
}

/// A world, a piece, and the place in it.
pub struct Environment {
    world: World,
    piece: Piece,
    range: TargetRange,
    config: TaskConfig,
    reward: Reward,
    randomisation: Randomisation,
    random: Pcg64,
    step: usize,
    /// Control steps made over all episodes.
    steps_made: u64,
    /// Environments of the same training, this one included. They step together.
    peers: u64,
    previous_joints: [f64; JOINTS],
    previous_action: [f32; ACTION_LEN],
}

/// What [`Environment::save`] keeps.
#[derive(Serialize, Deserialize)]
struct Saved {
    snapshot: Snapshot,
    params: PhysicalParams,
    random: Pcg64,
    step: usize,
    /// Absent in states from before there was a curriculum, and then of no consequence.
    #[serde(default)]
    steps_made: u64,
    previous_joints: [f64; JOINTS],
    previous_action: [f32; ACTION_LEN],
}

impl Environment {
    /// An environment for `piece`, with its own stream of randomness from `seed`, at the start of an episode.
    ///
    /// # Errors
    /// If the configuration is not sound.
    pub fn new(config: &TaskConfig, piece: &Piece, seed: u64) -> Result<Self, TaskError> {
        config.check()?;
        let params = config.params()?;
        let randomisation =
            Randomisation::new(params.clone(), &config.randomisation, config.stage.actuation)?;
        let mut environment = Self {
            world: World::new(&config.stage, &params)?,
            piece: piece.clone(),
            range: TargetRange::new(piece),
            config: config.clone(),
            reward: Reward::new(&config.reward)?,
            randomisation,
            random: Pcg64::seed_from_u64(seed),
            step: 0,
            steps_made: 0,
            peers: 1,
            previous_joints: [0.0; JOINTS],
            previous_action: [0.0; ACTION_LEN],
        };
        environment.reset();
        Ok(environment)
    }

    /// As one of `peers` environments of a training, which count its steps together.
    pub(crate) fn among(self, peers: usize) -> Self {
        Self { peers: peers as u64, ..self }
    }

    /// Starts an episode in the world `params`. For environments without randomisation: the next reset of another would
    /// draw a world again.
    pub fn reset_in(&mut self, params: &PhysicalParams) {
        self.world.set_params(params);
        self.reset();
    }

    /// Starts over as a new environment with this seed would begin, its curriculum included.
    pub fn restart(&mut self, seed: u64) {
        self.random = Pcg64::seed_from_u64(seed);
        self.steps_made = 0;
        self.reset();
    }

    /// Starts the next episode: a new draw of the randomised numbers, the hand in its starting pose, the beginning of
    /// the song (or, with `random_start`, any place in it with a finger over the key that is due next).
    pub fn reset(&mut self) {
        if self.randomisation.is_on() {
            let steps = self.steps_made.saturating_mul(self.peers);
            let params = self.randomisation.draw(steps, &mut self.random);
            self.world.set_params(&params);
        }
        self.world.reset();
        self.step = 0;
        if self.config.random_start {
            self.step = self.random.random_range(0..self.piece.steps());
            let finger = self.random.random_range(0..FINGERS);
            if self.step > 0
                && let Some(key) = self.next_due_key()
            {
                // The world is placed by true angles; the starting pose is what the encoders read.
                let mut pose = self.world.start_pose();
                for (joint, reading) in pose.iter_mut().enumerate() {
                    *reading -= self.world.params().joint(Joint::EncoderBias, joint);
                }
                let over = self.world.key_target(key)[1] - root_lateral(self.config.stage.side, finger);
                pose[RAIL] = over.clamp(-HALF_WIDTH, HALF_WIDTH);
                self.world.reset_to(&pose);
            }
        }
        self.previous_joints = self.world.joints();
        self.previous_action = self.range.action(&self.previous_joints);
    }

    /// The lowest key, white if there is one, of the next frame that has any.
    fn next_due_key(&self) -> Option<usize> {
        let due = self.piece.frames()[self.step..].iter().find(|due| !due.is_empty())?;
        due.iter().find(|key| !key_is_black(*key)).or_else(|| due.iter().next())
    }

    /// Plays one control step. `parts` receives the weighted reward terms in the order of [`Reward::names`].
    pub fn step(&mut self, action: &[f32; ACTION_LEN], parts: &mut [f32]) -> Step {
        let due = self.piece.due(self.step);
        self.previous_joints = self.world.joints();
        let outcome = self.world.step(&self.range.targets(action));
        let moment =
            Moment { world: &self.world, due, outcome, action, previous_action: &self.previous_action };
        let reward = self.reward.evaluate(&moment, parts);
        let reward = if outcome.unstable { f64::NAN } else { reward };
        self.previous_action = *action;
        self.step += 1;
        self.steps_made = self.steps_made.saturating_add(1);
        let song_over = self.step >= self.piece.steps();
        Step { reward, song_over, collided: outcome.collided, pressed: self.world.pressed() }
    }

    /// Writes the current observation.
    pub fn observe(&self, out: &mut [f32]) {
        let joints = self.world.joints();
        let pressed = self.world.pressed();
        observe(&self.config, &joints, &self.previous_joints, pressed, &self.piece, self.step, out);
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

    /// The next control step to be played.
    pub fn position(&self) -> usize {
        self.step
    }

    /// What an action means.
    pub fn range(&self) -> &TargetRange {
        &self.range
    }

    /// The world behind the task.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The reward in force.
    pub fn reward(&self) -> &Reward {
        &self.reward
    }

    /// Everything needed to continue bit for bit.
    pub fn save(&self) -> Vec<u8> {
        let saved = Saved {
            snapshot: self.world.snapshot(),
            params: self.world.params().clone(),
            random: self.random.clone(),
            step: self.step,
            steps_made: self.steps_made,
            previous_joints: self.previous_joints,
            previous_action: self.previous_action,
        };
        // Plain numbers and strings: writing them as JSON cannot fail.
        serde_json::to_vec(&saved).unwrap_or_default()
    }

    /// Continues from [`Environment::save`].
    ///
    /// # Errors
    /// If the bytes are not the saved state of such an environment; the environment is then unusable until reset.
    pub fn load(&mut self, bytes: &[u8]) -> Result<(), EnvironmentError> {
        let saved: Saved = serde_json::from_slice(bytes).map_err(|e| EnvironmentError::new(e.to_string()))?;
        if saved.step > self.piece.steps() {
            return Err(EnvironmentError::new("it is beyond the end of the song"));
        }
        saved.params.check().map_err(|e| EnvironmentError::new(e.to_string()))?;
        self.world.set_params(&saved.params);
        self.world.restore(&saved.snapshot).map_err(|e| EnvironmentError::new(e.to_string()))?;
        self.random = saved.random;
        self.step = saved.step;
        self.steps_made = saved.steps_made;
        self.previous_joints = saved.previous_joints;
        self.previous_action = saved.previous_action;
        Ok(())
    }
}
