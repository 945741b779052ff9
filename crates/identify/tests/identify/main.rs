//! Tests of the methods and of the statistics through the public interface. One binary, because each costs a
//! link.
// Helpers of tests are tests too, which clippy.toml does not see.
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
