//! The decision process on top of a [`World`](etude_stage::World): observation, action, reward,
//! episodes.
//!
//! A [`Piece`] is a song in control steps. A [`Stepper`] goes through it: what a [`Player`]
//! observes, and which joint targets its action means. A [`Simulation`] moves to them and evaluates
//! the reward. An [`Environment`] is both, once per episode, with a new piece of a [`Corpus`] in
//! each if there is one; [`PianoVectorEnv`] runs many environments in parallel for the learner.

mod assignment;
pub mod bench;
mod config;
mod corpus;
mod environment;
mod error;
pub mod fingering;
mod observation;
mod piece;
mod player;
mod randomise;
mod range;
pub mod reward;
pub mod scripted;
mod simulation;
mod stepper;
mod vector_env;
pub mod window;

pub use assignment::assign;
pub use config::{ObservationScale, ObservationView, TaskConfig};
pub use corpus::{Corpus, CorpusConfig};
pub use environment::Environment;
pub use error::TaskError;
pub use fingering::{Fingering, Goals};
pub use observation::{ColumnGroup, ColumnKind, History, column_groups, layout, observe};
pub use piece::Piece;
pub use player::Player;
pub use randomise::{NamedWidths, Randomisation, RandomisationConfig, Widths};
pub use range::TargetRange;
pub use scripted::{Lags, ScriptedBaseline, shortest_silences};
pub use simulation::{Simulation, StepResult};
pub use stepper::{Command, RigState, Stepper};
pub use vector_env::PianoVectorEnv;

/// Length of an action: one target per driven joint.
pub const ACTION_LEN: usize = etude_stage::DRIVEN_JOINTS;
