//! Performances: rigs, the one loop that plays, recordings of what a rig did, and the files beside
//! a performance.
//!
//! [`perform`] joins a [`Rig`] and an [`etude_task::Player`]. [`SimRig`] is the simulator,
//! [`RobotRig`] a robot, whatever moves its devices; an execution [`Mode`] puts them together. A
//! [`Recording`] is an MCAP file with JSON messages, so Foxglove, the Python `mcap` package and
//! Étude itself read it.

mod correction;
mod error;
mod excitation;
mod files;
mod job;
mod key_correction;
mod messages;
mod mirrored;
mod mode;
mod note_counts;
#[allow(clippy::module_inception)] // The loop has the crate's name because it is what the crate is for.
mod perform;
mod performance;
mod prepare;
mod recorder;
mod recording;
mod rig;
mod robot_rig;
pub mod session;
mod shaping;
mod shell;
mod sim_rig;
pub mod stats;
mod terminated_file;
mod timing;
mod training_evaluator;
mod writer;

pub use correction::{Correction, Delays, Tracking};
pub use error::{PerformError, RecordingError};
pub use excitation::{Excitation, ExcitationPlayer};
pub use files::{FileError, write_file, write_frames_csv};
pub use job::Job;
pub use key_correction::{KeyCorrections, PlannedAndPlayed};
pub use messages::{
    Activity, ArmMessage, DueNote, EventMessage, HandMessage, Header, KeyMessage, Message, PolicyMessage,
    RewardMessage, SetPointMessage, StepMessage, TargetMessage,
};
pub use mode::Mode;
pub use note_counts::NoteCounts;
pub use perform::perform;
pub use performance::{Ending, Performance, PlayedStep, RobotResult, Scores, SimulationResult, gap};
pub use prepare::{prepare, record_release};
pub use recorder::Recorder;
pub use recording::Recording;
pub use rig::{Rig, StepEnd};
pub use robot_rig::RobotRig;
pub use shaping::{limits_for, shaping_params, within_limits};
pub use shell::{shell_line, shell_word};
pub use sim_rig::SimRig;
pub use timing::{Timing, TimingReport};
pub use training_evaluator::{LEARNED_F1, SCORES, TrainingEvaluator};
pub use writer::RecordingWriter;
