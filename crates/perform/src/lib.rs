//! Performances: playing on a robot in the three execution modes, recordings of what a rig did, and the files that people
//! take away from a song that was played.
//!
//! A [`Recording`] is an MCAP file with JSON messages, so Foxglove, the Python `mcap` package and Étude itself read it.
//! A [`Performer`] plays on a [`Robot`](etude_robot::Robot), whatever moves its devices.

mod excitation;
mod excite;
mod files;
mod job;
mod messages;
mod mode;
mod performer;
mod recording;
mod robot_records;
mod shaping;
pub mod stand;
mod timing;
mod writer;

pub use excitation::Excitation;
pub use excite::excite;
pub use files::{FileError, write_file, write_frames_csv};
pub use job::Job;
pub use messages::{
    ArmMessage, HandMessage, Header, KeyMessage, NoteMessage, PolicyMessage, RewardMessage, SetPointMessage,
    StepMessage, TargetMessage,
};
pub use mode::Mode;
pub use performer::{Choose, Ending, PerformError, Performer, Played, keys, prepare};
pub use recording::{Recording, RecordingError};
pub use robot_records::RobotRecords;
pub use shaping::shaping_params;
pub use timing::{Timing, TimingReport};
pub use writer::RecordingWriter;
