//! Moving a robot through an excitation, one joint target a control step.

use std::sync::atomic::{AtomicBool, Ordering};

use etude_robot::{Pace, Phase, Robot};
use etude_stage::{JOINTS, PHYSICS_STEPS};

use crate::performer::{Ending, PerformError, SETTLE, control_period};
use crate::robot_records::RobotRecords;
use crate::shaping::Shaping;
use crate::timing::Timing;
use crate::writer::RecordingWriter;

/// Gives the robot these targets (rad, the rail in m), one a control step, and records what it does. It must hold still
/// near the first one.
///
/// # Errors
/// If it does not, or the recording cannot be written. A fault on the way is no error but an [`Ending`]. Either way the
/// robot is not let go yet.
pub fn excite(
    robot: &mut Robot,
    pace: &mut dyn Pace,
    targets: &[[f64; JOINTS]],
    recording: &mut RecordingWriter,
    interrupt: &AtomicBool,
) -> Result<Ending, PerformError> {
    let Some(first) = targets.first() else { return Ok(Ending::Complete) };
    let begun = pace.now() + SETTLE;
    pace.run_until(robot, begun);
    let mut shaping = Shaping::new(&robot.config().limits, first);
    let mut records = RobotRecords::new(begun, Some(recording));
    let mut waypoints = [[0.0; JOINTS]; PHYSICS_STEPS];
    let (mut events, mut timing) = (Vec::new(), Timing::default());
    for (step, targets) in targets.iter().enumerate() {
        if interrupt.load(Ordering::Relaxed) {
            robot.hold(pace.now());
            return Ok(Ending::Interrupted);
        }
        let due = begun + control_period() * step as u32;
        shaping.shape(targets, &mut waypoints);
        robot.follow(due, &waypoints)?;
        records.target(step, targets)?;
        pace.run_until(robot, due + control_period());
        records.take(robot, &mut events, &mut timing)?;
        events.clear();
        if robot.phase() != Phase::Following {
            return Ok(Ending::of(robot));
        }
        records.step(step, robot, &waypoints[PHYSICS_STEPS - 1])?;
    }
    robot.hold(pace.now());
    Ok(Ending::Complete)
}
