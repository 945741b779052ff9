//! Tests of the task as a whole, with worlds behind it. One binary, because each costs a link.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // Helpers of tests are tests too, which clippy.toml does not see.

mod assignment;
mod bench;
mod corpora;
mod fingerings;
mod model_choices;
mod randomisation;
#[path = "../../../stage/tests/stage/replica.rs"]
mod replica;
mod rewards;
mod saved;
mod scripted;
mod vectors;
mod views;
