//! The arm alone, for calibration: reads its joints, or lets an operator guide it by hand.

use std::time::{Duration, Instant};

use crate::rig_file::RigConfig;
use crate::stop::NOT_STOPPED;
use crate::xarm::codec::STOPPED;
use crate::xarm::kinematics::ARM_JOINTS;
use crate::xarm::{Arm, ArmConnection, ArmError, ArmFault, ArmLinkError, ArmState};

/// Time in which the arm must come up, and change its mode.
const READY_TIMEOUT: Duration = Duration::from_secs(8);
/// Time in which it must confirm that it stands still.
const STOP_TIMEOUT: Duration = Duration::from_secs(1);
/// Time between two polls.
pub const POLL_INTERVAL: Duration = Duration::from_millis(1);

/// The arm could not be read or guided.
#[derive(Debug, thiserror::Error)]
pub enum HandGuidingError {
    /// It cannot be reached.
    #[error(transparent)]
    Link(#[from] ArmLinkError),
    /// Its settings are not sound.
    #[error(transparent)]
    Config(#[from] etude_checks::RangeError),
    /// A safety stop.
    #[error(transparent)]
    Fault(#[from] ArmFault),
    /// It refused a request.
    #[error(transparent)]
    Refused(#[from] ArmError),
    /// It does not get ready.
    #[error("the arm did not get ready within {} s: look at its control box", READY_TIMEOUT.as_secs())]
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

impl HandGuidingError {
    /// Whether no arm was ever reached, so that nothing is to be stopped.
    pub fn is_unreached(&self) -> bool {
        matches!(self, Self::Link(error) if error.is_unreached()) || matches!(self, Self::Config(_))
    }
}

/// Where an arm was left.
#[derive(Clone, Debug, PartialEq)]
pub struct GuidedPose {
    /// Its joints, rad.
    pub joints_rad: [f64; ARM_JOINTS],
    /// Its serial number.
    pub serial: String,
}

/// What a program does while the arm is shown a place.
pub trait Guiding {
    /// A sign of life to the arm's guard, at least every [`POLL_INTERVAL`].
    ///
    /// # Errors
    /// If the guard has ended, or a stop was requested: the arm is then stopped.
    fn heartbeat(&mut self) -> Result<(), HandGuidingError>;

    /// Whether the operator still guides the arm.
    fn is_guiding(&mut self) -> bool;
}

/// Lets an operator show a place: brings the arm up, frees it if it is to be guided `by_hand`, and
/// reads where it stands then. The arm is left standing, in state 4, which it has confirmed.
///
/// # Errors
/// If the arm cannot be reached, stops itself, or does not confirm that it stands.
pub fn read_pose(
    config: &RigConfig,
    by_hand: bool,
    guiding: &mut dyn Guiding,
) -> Result<GuidedPose, HandGuidingError> {
    let mut guided = GuidedArm {
        wire: ArmConnection::open(&config.wires.arm)?,
        arm: Arm::new(config.arm.clone())?,
        begun: Instant::now(),
        bytes: Vec::new(),
        guiding,
    };
    guided.guiding.heartbeat()?;
    guided.arm.connected(Duration::ZERO);
    guided.arm.start(Duration::ZERO)?;
    guided.wait_until(|arm| arm.state() == ArmState::Ready)?;
    if by_hand {
        guided.arm.manual(guided.begun.elapsed(), true)?;
        guided.wait_until(|arm| arm.state() == ArmState::Manual)?;
        while guided.guiding.is_guiding() {
            guided.poll()?;
        }
        guided.arm.manual(guided.begun.elapsed(), false)?;
        guided.wait_until(|arm| arm.state() == ArmState::Ready)?;
    }
    let since = guided.begun.elapsed();
    guided.wait_until(|arm| arm.joints_at().is_some_and(|at| at > since))?;
    let serial = guided.arm.serial().unwrap_or_default().to_string();
    let shown = GuidedPose { joints_rad: guided.arm.joints().ok_or(HandGuidingError::Slow)?, serial };
    guided.stop()?;
    Ok(shown)
}

struct GuidedArm<'a> {
    wire: ArmConnection,
    arm: Arm,
    begun: Instant,
    bytes: Vec<u8>,
    guiding: &'a mut dyn Guiding,
}

impl GuidedArm<'_> {
    /// Stops the arm and waits until it has confirmed it.
    fn stop(&mut self) -> Result<(), HandGuidingError> {
        let begun = self.begun.elapsed();
        self.bytes.clear();
        self.arm.stop(begun, &mut self.bytes);
        self.wire.commands.send(&self.bytes)?;
        let end = Instant::now() + STOP_TIMEOUT;
        loop {
            self.poll()?;
            let is_new = self.arm.joints_at().is_some_and(|at| at > begun);
            if is_new && self.arm.report().is_some_and(|report| report.state == STOPPED) {
                return Ok(());
            }
            if Instant::now() > end {
                return Err(HandGuidingError::NotStopped);
            }
        }
    }

    fn wait_until(&mut self, is_met: impl Fn(&Arm) -> bool) -> Result<(), HandGuidingError> {
        let end = Instant::now() + READY_TIMEOUT;
        while !is_met(&self.arm) {
            if Instant::now() > end {
                return Err(HandGuidingError::Slow);
            }
            self.poll()?;
        }
        Ok(())
    }

    fn poll(&mut self) -> Result<(), HandGuidingError> {
        self.guiding.heartbeat()?;
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
        std::thread::sleep(POLL_INTERVAL);
        Ok(())
    }
}

impl Drop for GuidedArm<'_> {
    /// Always leaves the arm stopped, and never free or in servo mode without a program that
    /// commands it.
    fn drop(&mut self) {
        self.bytes.clear();
        self.arm.stop(self.begun.elapsed(), &mut self.bytes);
        // If the connection is gone, nothing more can be done.
        let _ = self.wire.commands.send(&self.bytes);
        std::thread::sleep(POLL_INTERVAL);
        let _ = self.wire.commands.send(&[]);
    }
}
