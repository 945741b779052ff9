//! A robot as a rig. The observation has its joints and keys; its set-points are shaped within the
//! limits of its rig file.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use etude_music::{CONTROL_HZ, KEY_COUNT, KeySet};
use etude_robot::{Pace, Phase, Record, Robot};
use etude_stage::{DRIVEN_JOINTS, PHYSICS_STEPS, RAIL};
use etude_task::{Command, RigState};

use crate::correction::{Correction, Tracking};
use crate::error::RecordingError;
use crate::messages::{PolicyMessage, StepMessage, TargetMessage};
use crate::performance::{Ending, Performance, PlayedStep, RobotResult};
use crate::prepare::STOPPED;
use crate::recorder::{RobotRecords, take_records};
use crate::rig::{Rig, StepEnd};
use crate::shaping::{Shaping, Waypoints};
use crate::timing::{CONTROL_PERIOD, Timing};
use crate::{PerformError, Recorder};

/// How long the robot holds still before the first control step.
const SETTLE: Duration = Duration::from_millis(300);
/// Time between two readings of the records of a robot at rest.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// A robot that has been prepared ([`prepare`](crate::prepare())) and holds still in the starting
/// pose.
pub struct RobotRig<'a> {
    robot: &'a mut Robot,
    pace: &'a mut dyn Pace,
    shaping: Shaping,
    records: RobotRecords,
    clamped_before: u64,
    timing: Timing,
    /// Added to the set-points.
    correction: Option<&'a Correction>,
    /// How the joints were asked to move and how they moved; measured for a correction alone.
    tracking: Tracking,
    /// What is not written yet of the step that has ended.
    ended: Option<StepMessage>,
}

impl<'a> RobotRig<'a> {
    /// A rig of `robot`, which holds still in the pose `start` (rad, the rail in m); `pace`
    /// advances its time.
    pub fn new(robot: &'a mut Robot, pace: &'a mut dyn Pace, start: &[f64; DRIVEN_JOINTS]) -> Self {
        Self {
            shaping: Shaping::new(&robot.config().limits, start),
            records: RobotRecords::since(pace.now()),
            clamped_before: robot.clamped(),
            timing: Timing::default(),
            correction: None,
            tracking: Tracking::default(),
            ended: None,
            robot,
            pace,
        }
    }

    /// The same rig, which adds `correction` to its set-points and measures the tracking. It is for
    /// a robot that follows simulated joints.
    pub fn corrected(self, correction: Option<&'a Correction>) -> Self {
        Self { correction, ..self }
    }

    /// Sends the set-points of one control step and waits for its end.
    pub(crate) fn follow(
        &mut self,
        waypoints: &Waypoints,
        command: &Command<'_>,
        observation: &[f32],
        recorder: &mut Recorder<'_>,
    ) -> Result<Result<KeySet, Ending>, PerformError> {
        let step = command.step as u64;
        let due = self.records.begun() + CONTROL_PERIOD * command.step as u32;
        if matches!(self.robot.phase(), Phase::Fault | Phase::Stopped) {
            return Ok(Err(fault(self.robot)));
        }
        let mut corrected = *waypoints;
        if let Some(correction) = self.correction {
            correction.add(command.step, &mut corrected);
        }
        self.robot.follow(due, &corrected)?;
        let late = self.pace.now().saturating_sub(due);
        self.timing.command(late);
        let begin_secs = command.step as f64 / CONTROL_HZ;
        // With what was measured in the step before, now that there is time.
        self.record(recorder, |recorder| {
            recorder.write(begin_secs, || TargetMessage { step, targets: command.targets.to_vec() })?;
            recorder.write(begin_secs, || PolicyMessage {
                step,
                observation: observation.to_vec(),
                action: command.action.to_vec(),
                command_late_secs: late.as_secs_f64(),
            })
        })?;
        if self.correction.is_some() {
            for (tick, waypoint) in (1u32..).zip(waypoints) {
                self.pace.run_until(self.robot, due + CONTROL_PERIOD * tick / PHYSICS_STEPS as u32);
                self.tracking.asked.push(*waypoint);
                self.tracking.measured.push(self.robot.joints());
            }
        }
        self.pace.run_until(self.robot, due + CONTROL_PERIOD);
        if self.robot.phase() != Phase::Following {
            return Ok(Err(fault(self.robot)));
        }
        let pressed = keys(self.robot);
        self.ended = Some(StepMessage {
            step,
            targets: corrected[PHYSICS_STEPS - 1].to_vec(),
            positions: self.robot.joints().to_vec(),
            pressed: pressed.pitches().collect(),
            ..StepMessage::default()
        });
        Ok(Ok(pressed))
    }

    /// Writes what was done and measured since the last call, and what `begins`, while the robot is
    /// controlled.
    fn record(
        &mut self,
        recorder: &mut Recorder<'_>,
        mut begins: impl FnMut(&mut Recorder<'_>) -> Result<(), RecordingError> + Send,
    ) -> Result<(), PerformError> {
        let (times, timing, mut ended) = (&self.records, &mut self.timing, self.ended.take());
        let write = |records: &[Record]| {
            if let Some(message) = ended.take() {
                recorder.write((message.step + 1) as f64 / CONTROL_HZ, || message)?;
            }
            times.write_all(records, recorder, timing)?;
            begins(recorder)
        };
        Ok(take_records(self.robot, self.pace, write)?)
    }

    /// Records the robot while it holds still, until `timeout` has passed or `interrupt` is set.
    ///
    /// # Errors
    /// If the recording cannot be written.
    pub fn hold(
        &mut self,
        timeout: Option<Duration>,
        recorder: &mut Recorder<'_>,
        interrupt: &AtomicBool,
    ) -> Result<Ending, PerformError> {
        let begun = self.records.begun();
        loop {
            if timeout.is_some_and(|timeout| self.pace.now() >= begun + timeout) {
                return Ok(Ending::Complete);
            }
            if interrupt.load(Ordering::Relaxed) {
                return Ok(Ending::Interrupted);
            }
            let next = self.pace.now() + POLL_INTERVAL;
            self.pace.run_until(self.robot, next);
            self.record(recorder, |_| Ok(()))?;
            recorder.events.clear();
            if self.robot.phase() != Phase::Holding {
                return Ok(fault(self.robot));
            }
        }
    }
}

impl Rig for RobotRig<'_> {
    fn begin(&mut self) -> Result<(), PerformError> {
        let begun = self.pace.now() + SETTLE;
        self.pace.run_until(self.robot, begun);
        self.records = RobotRecords::since(begun);
        self.clamped_before = self.robot.clamped();
        Ok(())
    }

    fn state(&self) -> RigState {
        RigState { joints: self.robot.joints(), set_points: self.robot.sent(), keys: keys(self.robot) }
    }

    fn step(
        &mut self,
        command: &Command<'_>,
        observation: &[f32],
        recorder: &mut Recorder<'_>,
    ) -> Result<StepEnd, PerformError> {
        let mut waypoints = [[0.0; DRIVEN_JOINTS]; PHYSICS_STEPS];
        self.shaping.resume_rail(self.robot.rail_set_point());
        self.shaping.shape(&command.targets, &mut waypoints);
        let followed = self.follow(&waypoints, command, observation, recorder)?;
        Ok(followed.map(|pressed| PlayedStep { pressed, simulated: None }))
    }

    fn run_while(&mut self, work: &mut (dyn FnMut() + Send)) {
        self.pace.run_while(self.robot, work);
    }

    fn rest(&mut self) {
        self.robot.hold(self.pace.now());
    }

    fn finish(
        &mut self,
        performance: &mut Performance,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), PerformError> {
        if self.robot.phase() == Phase::Holding {
            let played = CONTROL_PERIOD * performance.pressed.len() as u32;
            let late = Duration::from_secs_f64(performance.piece.late_secs());
            self.pace.run_until(self.robot, self.records.begun() + played + late);
        }
        self.record(recorder, |_| Ok(()))?;
        performance.robot = Some(RobotResult {
            timing: std::mem::take(&mut self.timing),
            clamped: self.robot.clamped() - self.clamped_before,
            lost_records: self.robot.lost_records(),
            warnings: self.robot.warnings(),
            tracking: std::mem::take(&mut self.tracking),
        });
        Ok(())
    }
}

/// The ending of a robot that has stopped following.
fn fault(robot: &Robot) -> Ending {
    Ending::Fault(robot.fault().map_or_else(|| STOPPED.to_string(), ToString::to_string))
}

/// Keys that are down on the robot's keyboard.
pub fn keys(robot: &Robot) -> KeySet {
    let mut set = KeySet::EMPTY;
    for key in (0..KEY_COUNT).filter(|key| robot.pressed() >> key & 1 == 1) {
        set.insert(key);
    }
    set
}

// Physics steps and set-points have the same rate, and both crates have the same driven joints.
const _: () = assert!(CONTROL_HZ * PHYSICS_STEPS as f64 == etude_robot::rig_file::SETPOINT_HZ);
const _: () = assert!(DRIVEN_JOINTS == etude_robot::joints::DRIVEN && RAIL == etude_robot::joints::RAIL);
