//! Records a robot that plays no song: at rest, or in an excitation for a fit of the simulator.

use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use etude_music::CONTROL_HZ;
use etude_perform::session::{RigChoice, Session, start_pose};
use etude_perform::{
    Activity, Ending, Excitation, ExcitationPlayer, Header, PerformError, Recorder, RecordingWriter,
    RobotRig, perform, prepare, record_release,
};
use etude_stage::{JOINT_NAMES, Side};
use etude_task::{TaskConfig, TaskError};

use crate::errors::released;

/// What a robot does while it is recorded.
#[derive(Clone, Copy, Debug)]
pub enum RobotMotion {
    /// It holds still for this time, or until it is interrupted.
    Rest(Option<Duration>),
    /// It moves through a sequence.
    Excitation(Excitation),
}

/// A recording that was made.
#[derive(Clone, Debug)]
pub struct Recorded {
    /// Messages in the file.
    pub messages: u64,
    /// How it ended.
    pub ending: Ending,
}

/// Brings a robot up (and, with `home`, to the keyboard), lets it move, and records everything that
/// happens. `seed` is added to that of the twin parameters.
///
/// # Errors
/// If the robot does not get ready, or the recording cannot be written. A robot that stops itself
/// is an [`Ending`].
pub fn record_robot(
    rig: &RigChoice,
    motion: RobotMotion,
    home: bool,
    seed: u64,
    path: &Path,
    interrupt: &AtomicBool,
) -> anyhow::Result<Recorded> {
    let side = rig.side();
    let activity = match motion {
        RobotMotion::Rest(_) => Activity::Rest,
        RobotMotion::Excitation(excitation) => Activity::Excitation(excitation),
    };
    let header = Header {
        player: "nobody".to_string(),
        rig: rig.label(),
        activity,
        control_hz: CONTROL_HZ,
        joints: JOINT_NAMES.map(str::to_string).to_vec(),
        rig_config: Some(rig.config()),
        ..Header::default()
    };
    let mut writer = RecordingWriter::create(path, &header)?;
    let mut session = rig.open(side, seed)?;
    let ending = act(&mut session, motion, side, home, &mut writer, interrupt).map_err(Into::into);
    let ending = released(&mut session, ending);
    let recorded = record_release(&mut session.robot, &mut session.pace, &mut writer);
    let ending = ending?;
    recorded?;
    // The robot is stopped: its guard is not needed while the file is completed.
    drop(session);
    let messages = writer.messages();
    writer.finish()?;
    Ok(Recorded { messages, ending })
}

fn act(
    session: &mut Session,
    motion: RobotMotion,
    side: Side,
    home: bool,
    writer: &mut RecordingWriter,
    interrupt: &AtomicBool,
) -> Result<Ending, PerformError> {
    let Session { robot, pace } = session;
    let pose = match motion {
        RobotMotion::Rest(_) => start_pose(side).map_err(TaskError::from)?,
        RobotMotion::Excitation(excitation) => excitation.start(),
    };
    prepare(robot, pace, home.then_some(&pose), Some(writer), interrupt)?;
    let mut rig = RobotRig::new(robot, pace, &pose);
    match motion {
        RobotMotion::Rest(longest) => rig.hold(longest, &mut Recorder::new(Some(writer)), interrupt),
        RobotMotion::Excitation(excitation) => {
            let (mut player, piece) = ExcitationPlayer::new(excitation, side);
            let task = TaskConfig::default();
            Ok(perform(&mut rig, &mut player, &task, &piece, Some(writer), interrupt)?.ending)
        }
    }
}
