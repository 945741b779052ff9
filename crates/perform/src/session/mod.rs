//! A robot that is set up to be moved: which rig it is, the claim on it, its guard, and how it is
//! released.

mod calibrate;
mod claim;
mod error;
mod guard;
mod motor_heat_file;
mod rig_choice;
mod robot_session;
mod worker;

pub use calibrate::{pitches_to_show, store_point, try_path};
pub use claim::{Claim, process_begins, request_stop};
pub use error::SessionError;
pub use guard::{Guard, ready, run_guard};
pub use rig_choice::{
    RigChoice, TWIN, claim, load_calibration, rig_choice, start_guard, start_pose, unix_secs,
};
pub use robot_session::{Live, Session, SessionPace};

pub use etude_twin::stage_side;
