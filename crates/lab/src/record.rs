//! Recording a robot that plays no song: at rest, or moved so that a simulator can be fitted to it.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use etude_music::CONTROL_HZ;
use etude_perform::{
    Ending, Excitation, Header, PerformError, RecordingError, RecordingWriter, RobotRecords, Timing, excite,
    prepare,
};
use etude_robot::{Pace as _, Phase};
use etude_stage::{JOINT_NAMES, JOINTS};
use serde_json::json;

use crate::play::PlayError;
use etude_perform::stand::Stand;
use etude_perform::stand::{RigChoice, start_pose};

/// Time between two looks at the records.
const SLICE: Duration = Duration::from_millis(50);

/// What a robot does while it is recorded.
#[derive(Clone, Copy, Debug)]
pub enum Activity {
    /// Holds still, for so long or until it is interrupted.
    Rest(Option<Duration>),
    /// Moves clear of the keyboard.
    Excitation(Excitation),
}

impl Activity {
    fn name(self) -> &'static str {
        match self {
            Self::Rest(_) => "rest",
            Self::Excitation(excitation) => excitation.name(),
        }
    }
}

/// What came of it.
#[derive(Clone, Debug)]
pub struct Recorded {
    /// Messages in the file.
    pub messages: u64,
    /// How it ended.
    pub ending: Ending,
}

/// Brings a robot up (and, with `home`, to the keyboard), lets it do what is to be recorded, and writes down everything
/// that happens. `seed` is added to that of a twin's truth.
///
/// # Errors
/// If the robot does not get ready, or the recording cannot be written. A robot that stops itself is an [`Ending`].
pub fn record_robot(
    rig: &RigChoice,
    activity: Activity,
    home: bool,
    seed: u64,
    path: &Path,
    interrupt: &AtomicBool,
) -> Result<Recorded, PlayError> {
    let side = rig.side();
    let header = Header {
        player: "nobody".to_string(),
        rig: rig.name().to_string(),
        mode: activity.name().to_string(),
        control_hz: CONTROL_HZ,
        joints: JOINT_NAMES.map(str::to_string).to_vec(),
        config: json!({ "rig": rig.config() }),
        ..Header::default()
    };
    let pose = match activity {
        Activity::Rest(_) => start_pose(side).map_err(etude_task::TaskError::from)?,
        Activity::Excitation(excitation) => excitation.start(),
    };
    let mut stand = rig.open(side, seed)?;
    let mut writer = RecordingWriter::create(path, &header)?;
    let ending = act(&mut stand, activity, home.then_some(&pose), &mut writer, interrupt);
    stand.let_go().map_err(PlayError::NotLetGo)?;
    // Nobody needs to watch a robot that was let go while the file is completed.
    drop(stand);
    let ending = ending?;
    let messages = writer.messages();
    writer.finish()?;
    Ok(Recorded { messages, ending })
}

fn act(
    stand: &mut Stand,
    activity: Activity,
    pose: Option<&[f64; JOINTS]>,
    writer: &mut RecordingWriter,
    interrupt: &AtomicBool,
) -> Result<Ending, PerformError> {
    let Stand { robot, pace } = stand;
    prepare(robot, pace, pose, Some(writer), interrupt)?;
    match activity {
        Activity::Rest(longest) => Ok(rest(stand, longest, writer, interrupt)?),
        Activity::Excitation(excitation) => excite(robot, pace, &excitation.targets(), writer, interrupt),
    }
}

fn rest(
    stand: &mut Stand,
    longest: Option<Duration>,
    writer: &mut RecordingWriter,
    interrupt: &AtomicBool,
) -> Result<Ending, RecordingError> {
    let Stand { robot, pace } = stand;
    let begun = pace.now();
    let mut records = RobotRecords::new(begun, Some(writer));
    let (mut events, mut timing) = (Vec::new(), Timing::default());
    loop {
        if longest.is_some_and(|longest| pace.now() >= begun + longest) {
            return Ok(Ending::Complete);
        }
        if interrupt.load(Ordering::Relaxed) {
            return Ok(Ending::Interrupted);
        }
        let next = pace.now() + SLICE;
        pace.run_until(robot, next);
        records.take(robot, &mut events, &mut timing)?;
        events.clear();
        if robot.phase() != Phase::Holding {
            return Ok(Ending::of(robot));
        }
    }
}
