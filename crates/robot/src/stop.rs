//! Stops a robot from outside its controller: from another terminal, or from the guard process.
//!
//! It opens its own connections, and neither device waits for the other. The hand is released (zero
//! torque three times, servo off), which its information reply confirms; the arm is put into state
//! 4, which is read back. No protocol can stop a hand whose cable is out (it holds its last
//! torque), or an arm whose network is out. Both cases need the hardware stop, which must be within
//! the operator's reach.

use std::time::{Duration, Instant};

use crate::allegro::Hand;
use crate::can::{self, CanError, CanTransport};
use crate::priority::{Priority, Rank};
use crate::rig_file::RigConfig;
use crate::xarm::{ArmCommands, Stopper};

/// Time within which the arm must confirm.
const CONFIRM: Duration = Duration::from_secs(1);
/// Time within which the hand must confirm; the release is sent again every 100 ms.
const LET_GO: Duration = Duration::from_millis(350);
/// Time within which a controller sees the request to stop.
const CONTROLLER: Duration = Duration::from_millis(100);
/// What to do about an arm that does not confirm that it stands still.
pub const NOT_STOPPED: &str = "it did not confirm that it stands still: press its emergency stop";
/// What to do about a hand that does not confirm that it was released.
pub const NOT_LET_GO: &str = "it did not confirm that its servo is off: switch off its power";

/// The result of a stop. `Err` names what an operator must do now.
#[derive(Debug)]
pub struct Stopped {
    /// The hand: whether it confirmed that its servo is off.
    pub hand: Result<(), String>,
    /// The arm: whether it confirmed.
    pub arm: Result<(), String>,
}

impl Stopped {
    /// Whether both have confirmed.
    pub fn is_sure(&self) -> bool {
        self.hand.is_ok() && self.arm.is_ok()
    }
}

/// Stops hand and arm of a rig at the same time: neither waits for the other, nor keeps it from
/// being stopped.
pub fn stop(config: &RigConfig) -> Stopped {
    std::thread::scope(|scope| {
        let arm = scope.spawn(|| {
            // A thread does not inherit the priority of the guard's.
            let _priority = Priority::of_this_thread(Rank::Guard);
            stop_arm(config)
        });
        let hand = stop_hand(config);
        let arm = arm.join().unwrap_or_else(|_| Err("stopping it failed: press its emergency stop".into()));
        Stopped { hand, arm }
    })
}

fn stop_hand(config: &RigConfig) -> Result<(), String> {
    let spec = &config.wires.can;
    let hand = Hand::new(&config.hand).map_err(|error| error.to_string())?;
    let release = |bus: &mut dyn CanTransport| {
        // Twice: a controller that is starting may switch the servo on once more, until it has seen
        // the request to stop.
        Ok(lets_go(bus, hand.clone())? && {
            std::thread::sleep(CONTROLLER);
            lets_go(bus, hand.clone())?
        })
    };
    let confirmed = match can::join(spec).and_then(|mut bus| release(&mut *bus)) {
        // No answer: perhaps the adapter's channel is not open.
        Ok(false) | Err(_) if can::is_serial(spec) => can::open(spec).and_then(|mut bus| release(&mut *bus)),
        confirmed => confirmed,
    };
    match confirmed {
        Ok(true) => Ok(()),
        Ok(false) => Err(NOT_LET_GO.to_string()),
        Err(error) => Err(error.to_string()),
    }
}

/// Releases the hand; returns whether it confirmed it.
fn lets_go(bus: &mut dyn CanTransport, mut hand: Hand) -> Result<bool, CanError> {
    // What lies in the queue was sent before.
    while bus.receive()?.is_some() {}
    let begun = Instant::now();
    let mut frames = Vec::new();
    hand.stop(Duration::ZERO, &mut frames);
    while begun.elapsed() <= LET_GO {
        for frame in frames.drain(..) {
            bus.send(frame)?;
        }
        while let Some(frame) = bus.receive()? {
            let _ = hand.receive(begun.elapsed(), &frame);
        }
        if hand.has_confirmed_release() {
            return Ok(true);
        }
        std::thread::sleep(Duration::from_millis(1));
        let _ = hand.poll(begun.elapsed(), &mut frames);
    }
    Ok(false)
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
    Err(NOT_STOPPED.to_string())
}
