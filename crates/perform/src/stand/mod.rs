//! A robot that is set up to be moved: which rig it is, the claim on it, its guard, and how it is released.

mod choice;
mod claim;
mod guard;
mod session;

pub use choice::{
    RigChoice, StandError, TWIN, claim, load_calibration, rig_choice, start_pose, try_path, unix_secs,
};
pub use claim::{Claim, tell_to_stop};
pub use guard::{READY, stand_guard};
pub use session::{Live, Stand, StandPace};

pub use etude_twin::stage_side;
