//! The arm's driver against the arm's emulator, in virtual time, on sockets, and under bytes that make no
//! sense; the emulator against the documented protocol and against UFACTORY's own client.

#![allow(clippy::unwrap_used, reason = "a test that cannot continue has failed")]

mod bench;
mod driving;
mod emulating;
mod faults;
mod hostile;
mod sockets;
