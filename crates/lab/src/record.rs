//! Recording a robot that plays no song.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use etude_music::CONTROL_HZ;
use etude_perform::{Header, RecordingWriter, RobotRecords, Timing, prepare};
use etude_robot::{Pace as _, Phase};
use etude_stage::JOINT_NAMES;

use crate::play::PlayError;
use crate::rig::{RigChoice, start_pose};
use crate::stand::Stand;

/// Time between two looks at the records.
const SLICE: Duration = Duration::from_millis(50);

/// Brings a robot up (and, with `home`, to the keyboard), holds it still for `longest` or until it is interrupted, and
/// writes down everything that happens. Returns the number of messages.
///
/// # Errors
/// If the robot does not get ready or stops itself, or the recording cannot be written.
pub fn record_robot(
    rig: &RigChoice,
    home: bool,
    longest: Option<Duration>,
    path: &Path,
    interrupt: &AtomicBool,
) -> Result<u64, PlayError> {
    let side = rig.side();
    let header = Header {
        player: "nobody".to_string(),
        rig: rig.name().to_string(),
        control_hz: CONTROL_HZ,
        joints: JOINT_NAMES.map(str::to_string).to_vec(),
        ..Header::default()
    };
    let pose = start_pose(side).map_err(etude_task::TaskError::from)?;
    let mut stand = rig.open(side, 0)?;
    let mut writer = RecordingWriter::create(path, &header)?;
    let Stand { robot, pace } = &mut stand;
    prepare(robot, pace, home.then_some(&pose), Some(&mut writer), interrupt)?;
    let begun = pace.now();
    let mut records = RobotRecords::new(begun, Some(&mut writer));
    let (mut events, mut timing) = (Vec::new(), Timing::default());
    let mut written = Ok(());
    while written.is_ok()
        && robot.phase() == Phase::Holding
        && !interrupt.load(Ordering::Relaxed)
        && longest.is_none_or(|longest| pace.now() < begun + longest)
    {
        let next = pace.now() + SLICE;
        pace.run_until(robot, next);
        written = records.take(robot, &mut events, &mut timing);
        events.clear();
    }
    let fault = robot.fault().map(ToString::to_string);
    stand.let_go().map_err(PlayError::NotLetGo)?;
    written?;
    let messages = writer.messages();
    writer.finish()?;
    match fault {
        None => Ok(messages),
        Some(fault) => Err(etude_perform::PerformError::Fault(fault).into()),
    }
}
