//! Stops a robot from outside its controller: from another terminal, or from the guard process.
//!
//! It opens its own connections, and neither device waits for the other. The hand is released (zero torque three times, servo
//! off); the arm is put into state 4, which is read back. No protocol can stop a hand whose cable is out
//! (it holds its last torque), or an arm whose network is out. Both cases need the hardware stop, which must be within the
//! operator's reach.

use std::time::{Duration, Instant};

use crate::allegro::{Hand, HostMessage, Request};
use crate::can::{self, CanError, CanFrame, CanTransport};
use crate::rig::RigConfig;
use crate::xarm::{ArmCommands, Stopper};

/// Time within which the arm must confirm.
const CONFIRM: Duration = Duration::from_secs(1);
/// Frames are given this long to leave the adapter.
const SETTLE: Duration = Duration::from_millis(50);

/// The result of a stop. `Err` names what an operator must do now.
#[derive(Debug)]
pub struct Stopped {
    /// The hand: whether the frames could be sent.
    pub hand: Result<(), String>,
    /// The arm: whether it confirmed.
    pub arm: Result<(), String>,
}

impl Stopped {
    /// Whether both were commanded to stop, and the arm confirmed it.
    pub fn is_sure(&self) -> bool {
        self.hand.is_ok() && self.arm.is_ok()
    }
}

/// Stops hand and arm of a rig at the same time: neither waits for the other, nor keeps it from being stopped.
pub fn stop(config: &RigConfig) -> Stopped {
    std::thread::scope(|scope| {
        let arm = scope.spawn(|| stop_arm(config));
        let hand = stop_hand(config);
        let arm = arm.join().unwrap_or_else(|_| Err("stopping it failed: press its emergency stop".into()));
        Stopped { hand, arm }
    })
}

fn stop_hand(config: &RigConfig) -> Result<(), String> {
    let spec = &config.wires.can;
    let mut hand = Hand::new(&config.hand).map_err(|error| error.to_string())?;
    let mut frames = Vec::new();
    hand.stop(Duration::ZERO, &mut frames);
    // An answer shows that the bus works.
    frames.push(HostMessage::Request(Request::Information).encode(config.hand.device_id));
    let told = can::join(spec).and_then(|mut bus| tell(&mut *bus, &frames));
    let told = match told {
        // No answer: perhaps the adapter's channel is not open.
        Ok(false) | Err(_) if can::is_serial(spec) => {
            can::open(spec).and_then(|mut bus| tell(&mut *bus, &frames))
        }
        told => told,
    };
    told.map(drop).map_err(|error| error.to_string())
}

/// Sends the frames; returns whether anything came from the bus.
fn tell(bus: &mut dyn CanTransport, frames: &[CanFrame]) -> Result<bool, CanError> {
    for frame in frames {
        bus.send(*frame)?;
    }
    let mut heard = false;
    let until = Instant::now() + SETTLE;
    while Instant::now() < until {
        // Reading keeps an adapter's queue moving.
        while bus.receive()?.is_some() {
            heard = true;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    Ok(heard)
}

fn stop_arm(config: &RigConfig) -> Result<(), String> {
    let mut wire = ArmCommands::open(&config.wires.arm).map_err(|error| error.to_string())?;
    let mut stopper = Stopper::default();
    let begun = Instant::now();
    let mut bytes = Vec::new();
    while begun.elapsed() <= CONFIRM {
        bytes.clear();
        stopper.poll(begun.elapsed(), &mut bytes);
        wire.send(&bytes).map_err(|error| error.to_string())?;
        bytes.clear();
        wire.receive(&mut bytes).map_err(|error| error.to_string())?;
        stopper.receive(begun.elapsed(), &bytes);
        if stopper.is_stopped() {
            return Ok(());
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    Err("it did not confirm that it stands still: press its emergency stop".to_string())
}
