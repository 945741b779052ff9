//! Why a robot cannot be set up.

use etude_robot::RobotError;
use etude_robot::allegro::HandSide;
use etude_robot::calibration::CalibrationError;
use etude_robot::rig_file::RigError;
use etude_stage::Side;
use etude_twin::TwinError;

/// The rig cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// Its file is not valid.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The keyboard's place is not known well enough.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// A wire cannot be opened, or a setting is not valid.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// The twin cannot be made.
    #[error(transparent)]
    Twin(#[from] TwinError),
    /// It is in use.
    #[error("cannot claim the rig {rig}: {source}")]
    Claimed {
        /// Its name.
        rig: String,
        /// Why.
        source: std::io::Error,
    },
    /// Nothing bounds where the arm may go.
    #[error(
        "the rig {rig} has no box for its arm, which nothing else would keep away from people and walls. This one holds the keyboard and \
         the way to it; look at it, then write it into the rig's file under [arm]: {line}"
    )]
    NoBox {
        /// The rig's name.
        rig: String,
        /// A box that fits.
        line: String,
    },
    /// Another process has requested to stop it.
    #[error(
        "the robot was stopped by `etude robot stop` while this program was getting ready: start it again"
    )]
    Stopped,
    /// The guard, which stops the robot if this process ends, cannot be started.
    #[error(
        "the guard of the robot cannot be started: {0}; remove the cause or end other programs, then repeat the command"
    )]
    Guard(std::io::Error),
    /// The rig's file names other devices than when this program read it.
    #[error(
        "{file} was changed since this command began, so the guard would stop another robot ({theirs}) than the one in use ({ours}); \
         put the file back, or start the command again"
    )]
    OtherDevices {
        /// The rig's file.
        file: String,
        /// The devices that the file names now.
        theirs: String,
        /// The devices of this program.
        ours: String,
    },
    /// The thread of the policy cannot be started.
    #[error("the thread of the policy cannot be started: {0}; end other programs, then repeat the command")]
    Worker(#[from] rayon::ThreadPoolBuildError),
    /// The rig has the other hand.
    #[error(
        "the policy plays with the {policy:?} hand, and the rig has the {rig} one; name another policy with --policy, or train one with \
         --set task.stage.side={rig}"
    )]
    Side {
        /// The hand that the policy was trained with.
        policy: Side,
        /// The hand of the rig.
        rig: HandSide,
    },
}
