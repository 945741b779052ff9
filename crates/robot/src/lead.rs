//! The arm alone, for calibration: reads its joints, or lets an operator lead it by hand.

use std::time::{Duration, Instant};

use crate::rig::RigConfig;
use crate::stop::NOT_STOPPED;
use crate::xarm::codec::STOPPED;
use crate::xarm::kinematics::JOINTS;
use crate::xarm::{Arm, ArmConnection, ArmError, ArmFault, ArmLinkError, ArmState};

/// Time in which the arm must come up, and change its mode.
const READY: Duration = Duration::from_secs(8);
/// Time in which it must confirm that it stands still.
const CONFIRM: Duration = Duration::from_secs(1);
/// Time between two polls.
pub const POLL: Duration = Duration::from_millis(1);

/// The arm could not be read or led.
#[derive(Debug, thiserror::Error)]
pub enum LeadError {
    /// It cannot be reached.
    #[error(transparent)]
    Link(#[from] ArmLinkError),
    /// Its settings are not sound.
    #[error(transparent)]
    Config(#[from] crate::setting::SettingError),
    /// It stopped itself.
    #[error(transparent)]
    Fault(#[from] ArmFault),
    /// It refused a request.
    #[error(transparent)]
    Refused(#[from] ArmError),
    /// It does not get ready.
    #[error("the arm did not get ready within {} s: look at its control box", READY.as_secs())]
    Slow,
    /// It does not confirm that it was stopped.
    #[error("arm: {NOT_STOPPED}")]
    NotStopped,
    /// Another process has requested to stop it.
    #[error("the arm was stopped by `etude robot stop`: start again")]
    Stopped,
    /// Nothing would stop the arm if this program ended now.
    #[error("the guard of the robot has ended: the arm was stopped; start again")]
    Unguarded,
}

/// Where an arm was left.
#[derive(Clone, Debug, PartialEq)]
pub struct Shown {
    /// Its joints, rad.
    pub joints_rad: [f64; JOINTS],
    /// Its serial number.
    pub serial: String,
}

/// What a program does while the arm is shown a place.
pub trait Showing {
    /// A sign of life to the arm's guard, at least every [`POLL`].
    ///
    /// # Errors
    /// If the guard has ended, or a stop was requested: the arm is then stopped.
    fn beat(&mut self) -> Result<(), LeadError>;

    /// Whether the operator still leads the arm.
    fn is_led(&mut self) -> bool;
}

/// Lets an operator show a place: brings the arm up, frees it if it is to be led `by_hand`, and reads where it stands then. The arm is
/// left standing, in state 4, which it has confirmed.
///
/// # Errors
/// If the arm cannot be reached, stops itself, or does not confirm that it stands.
pub fn show(config: &RigConfig, by_hand: bool, showing: &mut dyn Showing) -> Result<Shown, LeadError> {
    let mut leader = Leader {
        wire: ArmConnection::open(&config.wires.arm)?,
        arm: Arm::new(config.arm.clone())?,
        begun: Instant::now(),
        bytes: Vec::new(),
        showing,
    };
    leader.showing.beat()?;
    leader.arm.connected(Duration::ZERO);
    leader.arm.start(Duration::ZERO)?;
    leader.until(|arm| arm.state() == ArmState::Ready)?;
    if by_hand {
        leader.arm.manual(leader.begun.elapsed(), true)?;
        leader.until(|arm| arm.state() == ArmState::Manual)?;
        while leader.showing.is_led() {
            leader.poll()?;
        }
        leader.arm.manual(leader.begun.elapsed(), false)?;
        leader.until(|arm| arm.state() == ArmState::Ready)?;
    }
    let since = leader.begun.elapsed();
    leader.until(|arm| arm.joints_at().is_some_and(|at| at > since))?;
    let serial = leader.arm.serial().unwrap_or_default().to_string();
    let shown = Shown { joints_rad: leader.arm.joints().ok_or(LeadError::Slow)?, serial };
    leader.stop()?;
    Ok(shown)
}

struct Leader<'a> {
    wire: ArmConnection,
    arm: Arm,
    begun: Instant,
    bytes: Vec<u8>,
    showing: &'a mut dyn Showing,
}

impl Leader<'_> {
    /// Stops the arm and waits until it has confirmed it.
    fn stop(&mut self) -> Result<(), LeadError> {
        let begun = self.begun.elapsed();
        self.bytes.clear();
        self.arm.stop(begun, &mut self.bytes);
        self.wire.commands.send(&self.bytes)?;
        let end = Instant::now() + CONFIRM;
        loop {
            self.poll()?;
            let told = self.arm.joints_at().is_some_and(|at| at > begun);
            if told && self.arm.report().is_some_and(|report| report.state == STOPPED) {
                return Ok(());
            }
            if Instant::now() > end {
                return Err(LeadError::NotStopped);
            }
        }
    }

    fn until(&mut self, is_so: impl Fn(&Arm) -> bool) -> Result<(), LeadError> {
        let end = Instant::now() + READY;
        while !is_so(&self.arm) {
            if Instant::now() > end {
                return Err(LeadError::Slow);
            }
            self.poll()?;
        }
        Ok(())
    }

    fn poll(&mut self) -> Result<(), LeadError> {
        self.showing.beat()?;
        let now = self.begun.elapsed();
        self.bytes.clear();
        self.wire.commands.receive(&mut self.bytes)?;
        self.arm.receive_command(now, &self.bytes);
        self.bytes.clear();
        self.wire.receive_reports(&mut self.bytes)?;
        self.arm.receive_report(now, &self.bytes);
        self.bytes.clear();
        self.arm.poll(now, &mut self.bytes);
        self.wire.commands.send(&self.bytes)?;
        if let ArmState::Fault(fault) = self.arm.state() {
            return Err(fault.into());
        }
        std::thread::sleep(POLL);
        Ok(())
    }
}

impl Drop for Leader<'_> {
    /// Always leaves the arm stopped, and never free or in servo mode without a program that commands it.
    fn drop(&mut self) {
        self.bytes.clear();
        self.arm.stop(self.begun.elapsed(), &mut self.bytes);
        // If the connection is gone, nothing more can be done.
        let _ = self.wire.commands.send(&self.bytes);
        std::thread::sleep(POLL);
        let _ = self.wire.commands.send(&[]);
    }
}
