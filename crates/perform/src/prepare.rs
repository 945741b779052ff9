//! Starts a robot and moves it to the starting pose.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use etude_robot::{OBSERVED, Pace, Phase, Record, Robot};
use etude_stage::DRIVEN_JOINTS;

use crate::recorder::{RobotRecords, take_records};
use crate::timing::Timing;
use crate::{PerformError, Recorder, RecordingWriter};

/// Time limit for the start of the devices, and again for the slow move to the keyboard.
const PREPARATION_TIMEOUT: Duration = Duration::from_secs(120);
/// Time between two checks of the robot's phase.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// The reason of a stop that has no fault.
pub(crate) const STOPPED: &str =
    "it was stopped by `etude robot stop`, or its guard process has ended: give the same command again";

/// Starts a robot's devices, waits until it holds still, and, if there is a `pose` (rad, the rail
/// in m), moves it there slowly. Its records go into the recording, with time 0 and their time on
/// the robot's clock.
///
/// # Errors
/// If a device does not start, the robot is not there after two minutes, `interrupt` is set, or the
/// recording cannot be written. The caller must then stop the robot.
pub fn prepare(
    robot: &mut Robot,
    pace: &mut dyn Pace,
    pose: Option<&[f64; DRIVEN_JOINTS]>,
    writer: Option<&mut RecordingWriter>,
    interrupt: &AtomicBool,
) -> Result<(), PerformError> {
    let mut recorder = Recorder::new(writer);
    robot.start(pace.now());
    wait_for(robot, pace, &mut recorder, interrupt)?;
    if let Some(pose) = pose {
        robot.home(pace.now(), pose)?;
        wait_for(robot, pace, &mut recorder, interrupt)?;
    }
    Ok(())
}

/// Adds to a recording what a robot has recorded since its last performance ended, and what comes
/// in the first second after its release: why it stopped, with the number of an arm's error, and
/// how the hand and the arm came to rest.
///
/// # Errors
/// If the recording cannot be written.
pub fn record_release(
    robot: &mut Robot,
    pace: &mut dyn Pace,
    writer: &mut RecordingWriter,
) -> Result<(), PerformError> {
    if let Some(released) = robot.first_released_at() {
        pace.run_until(robot, released + OBSERVED);
    }
    let begun = Duration::try_from_secs_f64(writer.begun_secs).unwrap_or_default();
    let records: Vec<Record> = robot.records().collect();
    let mut recorder = Recorder::new(Some(writer));
    Ok(RobotRecords::since(begun).write_all(&records, &mut recorder, &mut Timing::default())?)
}

/// Waits until the robot holds still, and records it meanwhile.
fn wait_for(
    robot: &mut Robot,
    pace: &mut dyn Pace,
    recorder: &mut Recorder<'_>,
    interrupt: &AtomicBool,
) -> Result<(), PerformError> {
    let begun = pace.now();
    loop {
        let next = pace.now() + POLL_INTERVAL;
        pace.run_until(robot, next);
        let times = RobotRecords::since(pace.now());
        take_records(robot, pace, |records| times.write_all(records, recorder, &mut Timing::default()))?;
        match robot.phase() {
            Phase::Holding => return Ok(()),
            Phase::Fault => {
                let reason = robot.fault().map_or_else(String::new, ToString::to_string);
                return Err(PerformError::NotReady(reason));
            }
            _ if interrupt.load(Ordering::Relaxed) => {
                return Err(PerformError::Interrupted);
            }
            Phase::Stopped => return Err(PerformError::NotReady(STOPPED.to_string())),
            phase if next.saturating_sub(begun) > PREPARATION_TIMEOUT => {
                let waiting = robot.keyboard().state();
                let why = format!(
                    "it is still {} after two minutes ({waiting}); check the devices with `etude robot monitor`",
                    phase.name()
                );
                return Err(PerformError::NotReady(why));
            }
            _ => {}
        }
    }
}
