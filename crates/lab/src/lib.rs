//! Runs: from names and files to a trained policy and its scores.
//!
//! [`RunConfig`] is everything that decides a training; it comes in layers (preset, file, overrides) and is written
//! into the run's folder, where it is itself a valid config file. A [`Run`] makes policies, [`play`](play()) plays them in simulation,
//! and [`play_on_robot`] on a robot or its twin.

pub mod bench;
mod config;
pub mod experiment;
pub mod gallery;
mod grid;
mod guard;
mod identify;
mod live;
pub mod onnx;
mod play;
mod player;
mod record;
mod rehearsal_page;
mod rehearse;
pub mod render;
pub mod replay;
mod rig;
mod robot;
mod run;
mod stand;
pub mod watch;

pub use config::{ConfigError, PRESETS, RunConfig, resolve};
pub use grid::{GridConfig, GridReport, Marginal, WorldScores, evaluate_grid};
pub use guard::{READY, stand_guard};
pub use identify::{
    IDENTIFIED, Identification, IdentificationError, IdentifyMethod, IdentifyReport, identify_robot,
};
pub use live::play_live;
pub use play::{Files, PlayError, Report, play, scores_in_simulation};
pub use player::{Player, load_player, shipped_policies};
pub use record::{Motion, Recorded, record_robot};
pub use rehearse::{
    REHEARSAL_PAGE, RehearsalConfig, RehearsalError, RehearsalStep, Round, rehearse_on_robot,
};
pub use rig::{
    RigChoice, StandError, TWIN, claim, load_calibration, rig_choice, start_pose, try_path, unix_secs,
};
pub use robot::{RobotPlay, RobotReport, RobotRun, RunEnded, play_on_robot};
pub use run::{Run, RunError, find_song};
pub use stand::{Claim, Stand, StandPace, tell_to_stop};
