//! The controller of all three devices, on a bench of emulators.

#![allow(clippy::unwrap_used, reason = "a test that cannot continue has failed")]

mod bench;
mod extremes;
mod hand;
mod homing;
mod interlocks;
mod records;
