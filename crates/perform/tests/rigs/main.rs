//! What every rig promises, and which rig each column of the observation comes from. One binary,
//! because each costs a link.
#![allow(clippy::unwrap_used)] // Helpers of tests are tests too, which clippy.toml does not see.

mod bench;
mod contract;
mod recorded;
mod simulated;
mod sources;
