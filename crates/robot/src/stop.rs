//! Stopping a robot from outside its controller: another terminal, or the guard that outlives it.
//!
//! It opens wires of its own. The hand is let go (zero torque three times, servo off); the arm is put into state 4 and
//! asked whether it is. What no protocol can promise: that a hand whose cable is out stops pushing (it holds its last
//! torque), and that an arm whose network is out stops moving. Both need the hardware stop within the operator's reach.

use std::time::{Duration, Instant};

use crate::allegro::Hand;
use crate::can;
use crate::rig::RigConfig;
use crate::xarm::{Arm, ArmConnection};

/// Time within which the arm must confirm.
const CONFIRM: Duration = Duration::from_secs(1);
/// Frames are given this long to leave the adapter.
const SETTLE: Duration = Duration::from_millis(50);
/// The state in which the arm stands still and takes no motion (fact sheet "hardware" §2.4).
const STOPPED: u8 = 4;

/// What became of a stop. `Err` says what an operator must do now.
#[derive(Debug)]
pub struct Stopped {
    /// The hand: whether the frames could be sent.
    pub hand: Result<(), String>,
    /// The arm: whether it confirmed.
    pub arm: Result<(), String>,
}

impl Stopped {
    /// Whether both were told, and the arm confirmed.
    pub fn is_sure(&self) -> bool {
        self.hand.is_ok() && self.arm.is_ok()
    }
}

/// Stops hand and arm of a rig. A failure of one does not keep the other from being stopped.
pub fn stop(config: &RigConfig) -> Stopped {
    // The arm carries more energy: it goes first.
    let arm = stop_arm(config);
    Stopped { hand: stop_hand(config), arm }
}

fn stop_hand(config: &RigConfig) -> Result<(), String> {
    let mut bus = can::open(&config.wires.can).map_err(|error| error.to_string())?;
    let mut hand = Hand::new(&config.hand).map_err(|error| error.to_string())?;
    let mut frames = Vec::new();
    hand.stop(Duration::ZERO, &mut frames);
    for frame in frames {
        bus.send(frame).map_err(|error| error.to_string())?;
    }
    let until = Instant::now() + SETTLE;
    while Instant::now() < until {
        // Reading keeps an adapter's queue moving.
        while bus.receive().map_err(|error| error.to_string())?.is_some() {}
        std::thread::sleep(Duration::from_millis(1));
    }
    Ok(())
}

fn stop_arm(config: &RigConfig) -> Result<(), String> {
    let mut wire = ArmConnection::open(&config.wires.arm).map_err(|error| error.to_string())?;
    let mut arm = Arm::new(config.arm.clone()).map_err(|error| error.to_string())?;
    let begun = Instant::now();
    let mut bytes = Vec::new();
    arm.connected(Duration::ZERO);
    arm.stop(Duration::ZERO, &mut bytes);
    loop {
        wire.send(&bytes).map_err(|error| error.to_string())?;
        let now = begun.elapsed();
        bytes.clear();
        wire.receive_commands(&mut bytes).map_err(|error| error.to_string())?;
        arm.receive_command(now, &bytes);
        bytes.clear();
        wire.receive_reports(&mut bytes).map_err(|error| error.to_string())?;
        arm.receive_report(now, &bytes);
        bytes.clear();
        arm.poll(now, &mut bytes);
        let fresh = arm.joints_at().is_some_and(|at| at > Duration::ZERO);
        if fresh && arm.report().is_some_and(|report| report.state == STOPPED) {
            return Ok(());
        }
        if now > CONFIRM {
            return Err("it did not confirm that it stands still: press its emergency stop".to_string());
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}
