//! The arm's driver against the arm's emulator: in virtual time, on sockets, and under bytes that
//! make no sense.

mod bench;
mod driving;
mod faults;
mod hostile;
#[path = "../../../../emulators/tests/emulators/served.rs"]
mod served;
mod sockets;
