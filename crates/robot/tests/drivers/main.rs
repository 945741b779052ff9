//! Each driver against its emulator, and the transports of CAN.

#![allow(clippy::unwrap_used, reason = "a test that cannot continue has failed")]

mod adapter;
mod allegro;
mod arm;
mod can;
mod keyboard;
mod keyboard_channels;
mod stop;
