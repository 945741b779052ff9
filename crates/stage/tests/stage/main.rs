//! Tests of the stage as a whole: everything here steps MuJoCo. One binary, because each costs a
//! link.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // Helpers of tests are tests too, which clippy.toml does not see.

mod bench;
mod damaged;
mod energy;
mod events;
mod exported;
mod extremes;
mod moving;
mod parameters;
mod playing;
mod replica;
mod resting;
mod slipping;
mod snapshots;
mod touching;
