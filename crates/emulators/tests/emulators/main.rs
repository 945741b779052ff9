//! The emulators against the documented protocols and the makers' own clients. The drivers meet
//! them in the tests of `etude-robot`.

#![allow(clippy::unwrap_used, reason = "a test that cannot continue has failed")]

mod arm;
mod hostile;
mod keyboard;
mod official_client;
mod served;
