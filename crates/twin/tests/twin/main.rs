//! The twin as a program meets it: its hidden parameters, and its sockets. The controller plays on
//! it in the tests of `etude-robot`.

#![allow(clippy::unwrap_used, reason = "a test that cannot continue has failed")]

mod hidden;
mod served;
