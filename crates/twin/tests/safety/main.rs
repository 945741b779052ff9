//! The whole robot against a twin whose devices, wires and operators misbehave.
//!
//! | module | what it holds the controller to |
//! |---|---|
//! | `playing` | an undisturbed robot starts, goes to the keyboard and follows |
//! | `matrix` | each fault in each phase ends as its table says (`target/fault-matrix.md`) |
//! | `elsewhere` | whichever joint of the arm is not where it was sent, the robot stops |
//! | `ordered` | each kind of fault that a truth can order ends a performance |
//! | `recovery` | wires that come back, and what an operator may ask while the arm moves by itself |
//! | `limits` | whatever is asked, heard or broken, nothing outside the limits is ever sent |
//! | `fuzz` | millions of frames and bytes at random break no driver, parser or emulator |
//! | `wiggling` | a small turn of each joint finds one that is wrong |
//! | `determinism` | the same seed gives the same records |
//!
//! `bench` has the controller and the twin, `judge` listens in on the wires and decodes what is sent by itself,
//! `faults` has the rows of the matrix.

#![allow(clippy::unwrap_used, reason = "a test that cannot continue has failed")]

mod bench;
mod determinism;
mod dice;
mod elsewhere;
mod faults;
mod fuzz;
mod judge;
mod limits;
mod matrix;
mod ordered;
mod playing;
mod recovery;
mod wiggling;
