//! Runs: from names and files to a trained policy and its scores.
//!
//! [`RunConfig`] is everything that decides a training; it comes in layers (preset, file, overrides) and is written
//! into the run's folder, where it is itself a valid config file. A [`Run`] makes policies, [`perform`] plays them.

pub mod bench;
mod config;
mod play;
mod player;
mod run;

pub use config::{ConfigError, PRESETS, RunConfig, resolve};
pub use play::{Files, PlayError, Report, perform};
pub use player::{Player, load_player, shipped_policies};
pub use run::{Run, RunError, find_song};
