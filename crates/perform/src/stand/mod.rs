//! A robot that is set up to be moved: which rig it is, the claim on it, its guard, and how it is released.

mod calibrate;
mod choice;
mod claim;
mod guard;
mod session;
mod warm;
mod worker;

pub use calibrate::{pitches_to_show, store_point, try_path};
pub use choice::{
    RigChoice, StandError, TWIN, claim, load_calibration, rig_choice, start_guard, start_pose, unix_secs,
};
pub use claim::{Claim, process_begins, request_stop};
pub use guard::{Guard, ready, stand_guard};
pub use session::{Live, Stand, StandPace};

pub use etude_twin::stage_side;
