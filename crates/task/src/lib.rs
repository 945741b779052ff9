//! The task: what the agent sees, does and is paid for, on top of a [`World`](etude_stage::World).
//!
//! A [`Piece`] is the sheet music in control steps. An [`Environment`] plays it once per episode; [`VectorPiano`] runs
//! many of them over threads for the learner. A [`Player`] chooses the actions.

mod assignment;
pub mod bench;
mod config;
mod environment;
mod observation;
mod piece;
mod player;
mod randomise;
mod range;
pub mod reward;
pub mod scripted;
mod vector;

pub use assignment::assign;
pub use config::{TaskConfig, TaskError};
pub use environment::{Environment, Step};
pub use observation::{ObservationScale, layout, observe};
pub use piece::Piece;
pub use player::Player;
pub use randomise::{Full, RANDOMISED, Randomisation, RandomisationConfig, Widths};
pub use range::TargetRange;
pub use scripted::{ScriptedConfig, ScriptedPlayer};
pub use vector::VectorPiano;

/// Length of an action: one target per driven joint.
pub const ACTION_LEN: usize = etude_stage::JOINTS;
