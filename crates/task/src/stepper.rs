//! Steps through a piece: what a player observes, and which joint targets its action means.
//! Training ([`Environment`](crate::Environment)) and playing (`etude_perform::perform`) both use
//! it.

use etude_music::KeySet;
use etude_stage::{DRIVEN_JOINTS, RAIL, World};

use crate::observation::{History, observe};
use crate::{ACTION_LEN, Piece, TargetRange, TaskConfig, TaskError};

/// What is known of a hand and its keyboard, simulated or real.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigState {
    /// Joints as the encoders read them: rad, the rail in m.
    pub joints: [f64; DRIVEN_JOINTS],
    /// Set-points of the joints: rad, the rail in m.
    pub set_points: [f64; DRIVEN_JOINTS],
    /// Keys that sound.
    pub keys: KeySet,
}

impl From<&World> for RigState {
    fn from(world: &World) -> Self {
        Self { joints: world.joints(), set_points: world.references(), keys: world.pressed() }
    }
}

/// What is commanded in one control step.
#[derive(Clone, Copy, Debug)]
pub struct Command<'a> {
    /// Index of the control step.
    pub step: usize,
    /// The action, −1 to 1.
    pub action: &'a [f32; ACTION_LEN],
    /// The action of the step before; in the first step, the one whose targets are the starting
    /// pose, as far as the range allows.
    pub previous_action: &'a [f32; ACTION_LEN],
    /// The joint targets of the action: rad, the rail in m.
    pub targets: [f64; DRIVEN_JOINTS],
}

/// A piece in play: its range of joint targets, the control step, and what came before it.
pub struct Stepper {
    config: TaskConfig,
    piece: Piece,
    range: TargetRange,
    /// The control step that is played next.
    pub(crate) step: usize,
    pub(crate) history: History,
}

impl Stepper {
    /// At the beginning of `piece`, with the hand at rest in `state`.
    ///
    /// # Errors
    /// If the piece was planned for a task with a fingering and this one has none, or the reverse.
    pub fn new(config: &TaskConfig, piece: &Piece, state: &RigState) -> Result<Self, TaskError> {
        if config.fingering != piece.fingering().is_some() {
            let error = "the piece and the configuration differ in `fingering`; make it by `Piece::for_task`";
            return Err(TaskError::Value(error.to_string()));
        }
        let range = TargetRange::new(piece);
        let history = History::at_rest([0.0; DRIVEN_JOINTS], &range, 0);
        let mut stepper = Self { config: config.clone(), piece: piece.clone(), range, step: 0, history };
        stepper.begin(state);
        Ok(stepper)
    }

    /// Goes to the beginning of the piece, with the hand at rest in `state`.
    pub fn begin(&mut self, state: &RigState) {
        self.step = 0;
        self.history = History::at_rest(self.joints(state), &self.range, 0);
    }

    /// Takes another piece, to be begun.
    pub(crate) fn set_piece(&mut self, piece: Piece) {
        self.range = TargetRange::new(&piece);
        self.piece = piece;
    }

    /// The joint positions that the observation has.
    fn joints(&self, state: &RigState) -> [f64; DRIVEN_JOINTS] {
        let mut joints = state.joints;
        if self.config.rail_set_point {
            joints[RAIL] = state.set_points[RAIL];
        }
        joints
    }

    /// Writes the observation in `state`, of the length of [`layout`](crate::layout).
    pub fn observe(&self, state: &RigState, out: &mut [f32]) {
        let joints = self.joints(state);
        observe(&self.config, &joints, &self.history, state.keys, &self.piece, self.step, out);
    }

    /// What `action` (each value in [−1, 1]) commands.
    pub fn command<'a>(&'a self, action: &'a [f32; ACTION_LEN]) -> Command<'a> {
        Command {
            step: self.step,
            action,
            previous_action: &self.history.actions[0],
            targets: self.range.targets(action, self.step),
        }
    }

    /// Goes to the next control step, after one that began in `state` and was played with `action`.
    pub fn advance(&mut self, state: &RigState, action: &[f32; ACTION_LEN]) {
        self.history.push(self.joints(state), action);
        self.step += 1;
    }

    /// Whether the piece has ended.
    pub fn is_over(&self) -> bool {
        self.step >= self.piece.steps()
    }

    /// The piece.
    pub fn piece(&self) -> &Piece {
        &self.piece
    }

    /// The control step that is played next.
    pub fn next_step(&self) -> usize {
        self.step
    }
}
