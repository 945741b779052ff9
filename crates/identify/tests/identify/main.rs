//! Tests of the methods and of the statistics through the public interface. One binary, because
//! linking is slow.
// clippy.toml exempts tests, but not their helpers.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

mod bo;
mod continued;
mod estimates;
mod golden;
mod limits;
mod lm;
mod problems;
mod recovery;
mod synthetic;
