//! The whole robot against a twin whose devices, wires and operators misbehave.
//!
//! | module | what it holds the controller to |
//! |---|---|
//! | `playing` | an undisturbed robot starts, goes to the keyboard and follows |
//! | `links` | late replies of the arm cost time, not the motion |
//! | `matrix` | each fault in each phase ends as its table says (`target/fault-matrix.md`) |
//! | `stalls` | whenever the controller stood still, it continues or names that as the cause |
//! | `other_client` | who else sends the arm targets is seen, an arm that only lags is not that |
//! | `runaway` | a joint of the wrong sign pushes for less than a second, a pushed one is none |
//! | `elsewhere` | whichever joint of the arm is not where it was sent, the robot stops |
//! | `ordered` | each kind of fault that a parameter set can order ends a performance |
//! | `recovery` | wires that come back, and what an operator may ask while the arm moves by itself |
//! | `limits` | whatever is asked, heard or broken, nothing outside the limits is ever sent |
//! | `fuzz` | millions of frames and bytes at random break no driver, parser or emulator |
//! | `joint_check` | a small turn of each joint finds one that is wrong |
//! | `determinism` | the same seed gives the same records |
//! | `fingers`, `weight` | the controller's kinematics and feed-forward agree with the world |
//!
//! `bench` has the controller and the twin, `mischief` disturbs their wires, `judge` listens in and
//! decodes what is sent by itself, `faults` has the rows of the matrix, `page` makes the table of
//! `docs/robot.md` of them.

#![allow(clippy::unwrap_used, reason = "a test that cannot continue has failed")]

mod bench;
mod determinism;
mod dice;
mod elsewhere;
mod faults;
mod fingers;
mod fuzz;
mod joint_check;
mod judge;
mod limits;
mod links;
mod matrix;
mod mischief;
mod ordered;
mod other_client;
mod page;
mod playing;
mod policy;
mod recovery;
mod runaway;
mod stalls;
mod weight;
