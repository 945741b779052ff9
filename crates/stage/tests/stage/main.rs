//! Tests of the stage as a whole: everything here steps MuJoCo. One binary, because each costs a link.

mod bench;
mod damaged;
mod energy;
mod events;
mod exported;
mod extremes;
mod moving;
mod parameters;
mod playing;
mod resting;
mod slipping;
mod snapshots;
mod touching;
