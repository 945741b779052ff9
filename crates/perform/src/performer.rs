//! Playing a piece on a robot: the 20 Hz loop, in each of the three modes.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use etude_music::{CONTROL_HZ, KEYS, KeyEvent, KeySet};
use etude_robot::{Pace, Phase, Refused, Robot};
use etude_stage::{JOINTS, PHYSICS_STEPS, RAIL, World};
use etude_task::{ACTION_LEN, Piece, TargetRange, TaskConfig, TaskError, layout, observe};

use crate::Mode;
use crate::recording::RecordingError;
use crate::robot_records::RobotRecords;
use crate::shaping::Shaping;
use crate::timing::Timing;
use crate::writer::RecordingWriter;

/// Time that devices may take to come up, and that the slow way to the keyboard may take.
const PREPARATION: Duration = Duration::from_secs(120);
/// How long the robot holds still before the first note is counted in.
pub(crate) const SETTLE: Duration = Duration::from_millis(300);
/// What is known of a stop that came from elsewhere.
const STOPPED: &str = "it was stopped by `etude robot stop`, or its guard is gone";
/// Steps of a wait.
const WAIT: Duration = Duration::from_millis(20);

/// A performance could not be given.
#[derive(Debug, thiserror::Error)]
pub enum PerformError {
    /// The task could not be built.
    #[error(transparent)]
    Task(#[from] TaskError),
    /// The robot would not move.
    #[error(transparent)]
    Refused(#[from] Refused),
    /// The robot did not come up, or not to the keyboard.
    #[error("the robot did not get ready: {0}")]
    NotReady(String),
    /// The robot stopped itself.
    #[error("the robot stopped itself: {0}")]
    Fault(String),
    /// The recording could not be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

/// How a performance ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ending {
    /// With the last control step.
    Complete,
    /// The robot stopped itself, for this reason.
    Fault(String),
    /// On request.
    Interrupted,
}

impl Ending {
    /// That of a robot which no longer does what it was asked to.
    pub fn of(robot: &Robot) -> Self {
        Self::Fault(robot.fault().map_or_else(|| STOPPED.to_string(), ToString::to_string))
    }
}

/// What was played on the robot.
#[derive(Clone, Debug)]
pub struct Played {
    /// Keys of the robot at the end of each control step; fewer than the piece has if it was cut short.
    pub pressed: Vec<KeySet>,
    /// Strikes and releases of the robot's keys, at times since the beginning.
    pub events: Vec<KeyEvent>,
    /// Keys of the simulation that played along; empty in a mode without one.
    pub simulated: Vec<KeySet>,
    /// How it ended.
    pub ending: Ending,
    /// Deadlines and periods.
    pub timing: Timing,
    /// Set-points that were clamped, counted by joint.
    pub clamped: u64,
    /// Records that did not get into the recording because there were too many at once.
    pub lost_records: u64,
}

/// Chooses the action of a control step from the observation.
pub type Choose<'a> = dyn FnMut(usize, &[f32], &mut [f32; ACTION_LEN]) + 'a;

/// A piece on the music stand: the task that the policy was trained in, and the mode to play it in.
pub struct Performer {
    mode: Mode,
    task: TaskConfig,
    piece: Piece,
    range: TargetRange,
    world: World,
}

impl Performer {
    /// A performer at the beginning of a piece.
    ///
    /// # Errors
    /// If the task's configuration is not sound.
    pub fn new(task: &TaskConfig, piece: &Piece, mode: Mode) -> Result<Self, TaskError> {
        let params = task.params()?;
        let world = World::new(&task.stage, &params)?;
        Ok(Self { mode, task: task.clone(), piece: piece.clone(), range: TargetRange::new(piece), world })
    }

    /// The pose in which every performance begins: rad, the rail in m.
    pub fn start_pose(&self) -> [f64; JOINTS] {
        self.world.start_pose()
    }

    /// Plays the piece once. `choose` is the policy; `recording` receives everything; `interrupt` ends it.
    ///
    /// # Errors
    /// If the robot does not hold still in the starting pose, or the recording cannot be written. A fault of the robot
    /// on the way is no error but an [`Ending`]. Either way the robot is not let go yet.
    pub fn play(
        &mut self,
        robot: &mut Robot,
        pace: &mut dyn Pace,
        choose: &mut Choose<'_>,
        recording: Option<&mut RecordingWriter>,
        interrupt: &AtomicBool,
    ) -> Result<Played, PerformError> {
        self.world.reset();
        let begun = pace.now() + SETTLE;
        pace.run_until(robot, begun);
        let mut records = RobotRecords::new(begun, recording);
        let clamped = robot.clamped();
        let mut played = Played {
            pressed: Vec::with_capacity(self.piece.steps()),
            events: Vec::new(),
            simulated: Vec::new(),
            ending: Ending::Complete,
            timing: Timing::default(),
            clamped: 0,
            lost_records: 0,
        };
        let outcome = self.steps(robot, pace, choose, &mut records, interrupt, begun, &mut played);
        robot.hold(pace.now());
        outcome?;
        records.take(robot, &mut played.events, &mut played.timing)?;
        played.clamped = robot.clamped() - clamped;
        played.lost_records = robot.lost_records();
        Ok(played)
    }

    #[allow(clippy::too_many_arguments)] // The loop of `play`, apart so that every way out passes its end.
    fn steps(
        &mut self,
        robot: &mut Robot,
        pace: &mut dyn Pace,
        choose: &mut Choose<'_>,
        records: &mut RobotRecords<'_>,
        interrupt: &AtomicBool,
        begun: Duration,
        played: &mut Played,
    ) -> Result<(), PerformError> {
        let mut observation = vec![0.0; layout(&self.task).len()];
        let mut action = [0.0; ACTION_LEN];
        let mut waypoints = [[0.0; JOINTS]; PHYSICS_STEPS];
        let mut shaping = Shaping::new(&robot.config().limits, &self.start_pose());
        let mut previous = self.observed_joints(robot);
        for step in 0..self.piece.steps() {
            let due = begun + control_period() * step as u32;
            if interrupt.load(Ordering::Relaxed) {
                played.ending = Ending::Interrupted;
                return Ok(());
            }
            let joints = self.observed_joints(robot);
            let pressed = if self.mode.sees_robot_keys() { keys(robot) } else { self.world.pressed() };
            observe(&self.task, &joints, &previous, pressed, &self.piece, step, &mut observation);
            previous = joints;
            choose(step, &observation, &mut action);
            let targets = self.range.targets(&action);
            if self.mode.has_simulation() {
                self.mirror(&targets, &mut waypoints);
            } else {
                shaping.shape(&targets, &mut waypoints);
            }
            robot.follow(due, &waypoints)?;
            let late = pace.now().saturating_sub(due);
            played.timing.command(late);
            records.target(step, &targets)?;
            records.policy(step, &observation, &action, late)?;
            pace.run_until(robot, due + control_period());
            records.take(robot, &mut played.events, &mut played.timing)?;
            match robot.phase() {
                Phase::Following => {}
                _ => {
                    played.ending = Ending::of(robot);
                    return Ok(());
                }
            }
            played.pressed.push(keys(robot));
            if self.mode.has_simulation() {
                played.simulated.push(self.world.pressed());
            }
            records.step(step, robot, &waypoints[PHYSICS_STEPS - 1])?;
        }
        Ok(())
    }

    fn observed_joints(&self, robot: &Robot) -> [f64; JOINTS] {
        if self.mode.sees_robot_joints() { robot.joints() } else { self.world.joints() }
    }

    /// Lets the simulation play the control step; the robot is to be where its joints were after each physics step.
    fn mirror(&mut self, targets: &[f64; JOINTS], waypoints: &mut [[f64; JOINTS]; PHYSICS_STEPS]) {
        let mut next = waypoints.iter_mut();
        self.world.step_watched(targets, |world| {
            if let Some(waypoint) = next.next() {
                *waypoint = world.joints();
            }
        });
    }
}

/// Starts a robot's devices, waits until it holds still, and, if there is a `pose`, brings it slowly there. What happens
/// goes into the recording, at time 0.
///
/// # Errors
/// If a device does not come up, or the robot does not get there in two minutes, or it is interrupted, or the recording
/// cannot be written. Whoever called lets the robot go then.
pub fn prepare(
    robot: &mut Robot,
    pace: &mut dyn Pace,
    pose: Option<&[f64; JOINTS]>,
    recording: Option<&mut RecordingWriter>,
    interrupt: &AtomicBool,
) -> Result<(), PerformError> {
    robot.start(pace.now());
    let ready = wait_for(robot, pace, interrupt).and_then(|()| match pose {
        Some(pose) => {
            robot.home(pace.now(), pose)?;
            wait_for(robot, pace, interrupt)
        }
        None => Ok(()),
    });
    let mut records = RobotRecords::new(pace.now(), recording);
    records.take(robot, &mut Vec::new(), &mut Timing::default())?;
    ready
}

/// Waits until the robot holds still.
fn wait_for(robot: &mut Robot, pace: &mut dyn Pace, interrupt: &AtomicBool) -> Result<(), PerformError> {
    let begun = pace.now();
    loop {
        let next = pace.now() + WAIT;
        pace.run_until(robot, next);
        match robot.phase() {
            Phase::Holding => return Ok(()),
            Phase::Fault => {
                let reason = robot.fault().map_or_else(String::new, ToString::to_string);
                return Err(PerformError::NotReady(reason));
            }
            _ if interrupt.load(Ordering::Relaxed) => {
                return Err(PerformError::NotReady("it was interrupted".into()));
            }
            Phase::Stopped => return Err(PerformError::NotReady(STOPPED.to_string())),
            phase if next.saturating_sub(begun) > PREPARATION => {
                let waiting = robot.keyboard().state();
                let why = format!("it is still {} after two minutes ({waiting})", phase.name());
                return Err(PerformError::NotReady(why));
            }
            _ => {}
        }
    }
}

/// Keys of the robot that are down.
pub fn keys(robot: &Robot) -> KeySet {
    let mut set = KeySet::EMPTY;
    for key in (0..KEYS).filter(|key| robot.pressed() >> key & 1 == 1) {
        set.insert(key);
    }
    set
}

/// Length of a control step.
pub(crate) fn control_period() -> Duration {
    Duration::from_secs_f64(1.0 / CONTROL_HZ)
}

// One waypoint a physics step is one a set-point, and the joints are the same.
const _: () = assert!(CONTROL_HZ * PHYSICS_STEPS as f64 == etude_robot::rig::SETPOINT_HZ);
const _: () = assert!(JOINTS == etude_robot::joints::DRIVEN && RAIL == etude_robot::joints::RAIL);
