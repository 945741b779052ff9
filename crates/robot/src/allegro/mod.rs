//! The Allegro Hand v4 on CAN: its messages, and the driver that keeps it safe.
//!
//! Sources: Wonik's wiki page "CAN Protocol v4.0"; the drivers allegro_hand_ros_v4 and
//! allegro_hand_linux_v4 (<https://github.com/simlabrobotics>) and allegro_hand_ros2
//! (<https://github.com/Wonikrobotics-git>); the Allegro client in
//! <https://github.com/facebookresearch/fairo>.
//!
//! [`Hand`] is the only path to the hand: it starts it, watches it and clamps every torque as the
//! last step before the wire. [`JointLoop`] turns wanted joint angles into torques at the hand's
//! own clock.

mod assembly;
mod codec;
mod config;
mod driver;
mod encoder;
mod fault;
mod fingers;
mod frame_rate;
mod gravity;
mod joint_loop;
mod limits;
mod messages;
mod state;

pub use config::HandConfig;
pub use driver::Hand;
pub use fault::HandFault;
pub(crate) use fingers::TIP_RADIUS_M;
pub use fingers::{PLAYING, tip_depths};
pub use gravity::holding_torques;
pub use joint_loop::{JointLoop, JointLoopConfig};
pub use limits::{
    FULL_SCALE_PWM, JOINT_LIMITS_RAD, PWM_LIMITS, RAD_PER_COUNT, WIRE_JOINTS, clamp_pwm, counts_from_rad,
    rad_from_counts,
};
pub use messages::{
    DeviceId, Finger, HandMessage, HandSide, HostMessage, Information, Request, Serial, StatusBits,
};
pub use state::{HandEvent, HandState};
