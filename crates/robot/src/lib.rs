//! The robot: an Allegro hand on CAN, an xArm7 on TCP, a keyboard on MIDI, and what limits them.
//! Their emulators are in `etude-emulators`.
//!
//! Drivers and controller are state machines without input or output of their own: they receive
//! bytes or frames and the time, and return the bytes or frames to send. Time is a
//! [`Duration`](std::time::Duration) since the start of the program, passed in by the caller, so
//! that tests run faster than real time and the same inputs always give the same outputs. Sockets,
//! serial ports and sound devices are thin shells around these machines.
//!
//! | module | what |
//! |---|---|
//! | [`can`] | CAN frames and what carries them |
//! | [`allegro`] | the Allegro Hand v4: messages, driver |
//! | [`xarm`] | the xArm7: messages, kinematics, driver |
//! | [`keyboard`] | the MIDI keyboard: parser, driver |
//! | [`joints`] | the order of joints, stated once |
//! | [`limiter`] | what every set-point goes through |
//! | [`calibration`] | where the keyboard stands, and the arm's path along it |
//! | [`rig_file`] | a rig's file |
//! | [`Robot`] | the controller of all three devices |
//! | [`hand_guiding`] | the arm alone, guided by hand for calibration |
//! | [`priority`] | real-time priority of the controlling thread |
//! | [`stream`] | reading and writing without blocking |
//!
//! The modules of the devices name the published sources of their numbers and byte layouts.

pub mod allegro;
pub mod calibration;
pub mod can;
pub mod hand_guiding;
pub mod joints;
pub mod keyboard;
pub mod limiter;
pub mod monitor;
mod pace;
pub mod priority;
pub mod rig_file;
mod robot;
pub mod stop;
pub mod stream;
pub mod wires;
pub mod xarm;

pub use pace::{Pace, RealTime};
pub use robot::{
    Fault, Implausible, JOINTS_CHECKED, JointCheck, MAX_AHEAD_M, MotorHeat, OBSERVED, Phase,
    ROOTS_OVER_KEYS_M, Record, Refused, Robot, RobotError, check_joints, drag_ways_m, propose_box,
};
