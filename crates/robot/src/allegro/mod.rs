//! The Allegro Hand v4 on CAN: its messages, the driver that keeps it safe, and an emulator that speaks the
//! same bytes.
//!
//! [`Hand`] is the only path to the hand: it starts it, watches it and clamps every torque as the last step
//! before the wire. [`JointLoop`] turns wanted joint angles into torques at the hand's own clock.
//! [`HandEmulator`] answers like a hand, and [`FreeHand`] gives it joints that move when there is no physics
//! at hand.

mod assembly;
mod codec;
mod config;
mod driver;
mod emulator;
mod encoder;
mod fault;
mod free_hand;
mod joint_loop;
mod limits;
mod messages;
mod state;

pub use codec::CodecError;
pub use config::{HandConfig, HandConfigError};
pub use driver::Hand;
pub use emulator::{EmulatorConfig, HandEmulator};
pub use fault::HandFault;
pub use free_hand::FreeHand;
pub use joint_loop::{JointLoop, JointLoopConfig, JointLoopError};
pub use limits::{
    FULL_SCALE_PWM, JOINT_LIMITS_RAD, JOINTS, PWM_LIMITS, RAD_PER_COUNT, clamp_pwm, counts_from_rad,
    rad_from_counts,
};
pub use messages::{
    DeviceId, Finger, HandMessage, HandSide, HostMessage, Information, Periods, Raw, Request, Serial,
    StatusBits,
};
pub use state::{HandCounters, HandEvent, HandState};
