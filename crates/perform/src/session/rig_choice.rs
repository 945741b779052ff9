//! Which robot: a twin in lockstep, or a rig by its file (which may be a twin in another process).

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

use super::claim::Claim;
use super::error::SessionError;
use super::guard::Guard;
use super::motor_heat_file::HeatFile;
use super::robot_session::{Live, Session, SessionPace};
use super::worker::Worker;
use crate::shaping::limits_for;
use etude_robot::allegro::HandSide;
use etude_robot::calibration::{Calibration, CalibrationError, RailPath};
use etude_robot::rig_file::{LimitsConfig, RigConfig, RigError, WiresConfig};
use etude_robot::wires::OpenWires;
use etude_robot::xarm::kinematics::PAPER_HOME_DEG;
use etude_robot::{Robot, propose_box};
use etude_stage::{DRIVEN_JOINTS, PhysicalParams, Side, StageConfig, StageError, World};
use etude_twin::{Lockstep, Twin, TwinError, TwinParams, calibration, stage_side};

/// Name of the twin on the command line and in recordings.
pub const TWIN: &str = "twin";

/// A robot to play on.
#[derive(Clone, Debug)]
pub enum RigChoice {
    /// A twin with this parameter set, in lockstep.
    Twin(Box<TwinParams>),
    /// The rig that this file describes.
    File {
        /// The file.
        path: PathBuf,
        /// Its content.
        rig: Box<RigConfig>,
        /// The claim on it, from the beginning of the program to its end.
        claim: Arc<Claim>,
    },
}

impl RigChoice {
    /// The rig's name.
    pub fn name(&self) -> &str {
        match self {
            Self::Twin(_) => TWIN,
            Self::File { rig, .. } => &rig.name,
        }
    }

    /// Its name; of a twin with its parameters.
    pub fn label(&self) -> String {
        match self {
            Self::Twin(twin_params) => format!("{TWIN} ({})", twin_params.name()),
            Self::File { rig, .. } => rig.name.clone(),
        }
    }

    /// Its configuration; the default one for a twin.
    pub fn config(&self) -> RigConfig {
        match self {
            Self::Twin(twin_params) => twin_params.rig(),
            Self::File { rig, .. } => (**rig).clone(),
        }
    }

    /// The same robot for a policy that was trained in a simulator with these parameters: the rig
    /// of a twin that has the default limits gets higher ones where that simulator's joints are
    /// quicker. The limits of a rig's file stay.
    pub fn for_simulator(&self, params: &PhysicalParams) -> Self {
        match self {
            Self::Twin(twin_params) if twin_params.rig().limits == LimitsConfig::default() => {
                Self::Twin(Box::new((**twin_params).clone().with_limits(limits_for(params))))
            }
            choice => choice.clone(),
        }
    }

    /// The hand that it has.
    pub fn side(&self) -> Side {
        match self {
            Self::Twin(_) => Side::default(),
            Self::File { rig, .. } => stage_side(rig.hand.side),
        }
    }

    /// Whether it may move to the keyboard without a request: no person stands beside a twin.
    pub fn is_twin(&self) -> bool {
        matches!(self, Self::Twin(_))
    }

    /// Sets the robot up. Nothing moves yet. `seed` is added to that of the twin parameters; `side`
    /// is the hand that the policy plays with.
    ///
    /// # Errors
    /// If the rig's file, its calibration or its wires cannot be used.
    pub fn open(&self, side: Side, seed: u64) -> Result<Session, SessionError> {
        if let (Self::File { rig, .. }, Some(line)) = (self, self.missing_box()?) {
            return Err(SessionError::NoBox { rig: rig.name.clone(), line });
        }
        self.open_at_rest(side, seed)
    }

    /// A box for the arm as a line of the rig's file, if the rig needs one and has none.
    ///
    /// # Errors
    /// If the rig's calibration cannot be used.
    pub fn missing_box(&self) -> Result<Option<String>, SessionError> {
        match self {
            Self::File { rig, .. } if rig.arm.box_mm.is_none() => {
                let path = rail_path(rig, &load_calibration(rig)?)?;
                let safety_box = propose_box(&path, rig.limits.rail_range_m)?;
                Ok(Some(format!("box_mm = {:?}", safety_box.0)))
            }
            Self::File { .. } | Self::Twin(_) => Ok(None),
        }
    }

    /// As [`open`](Self::open), also without a box for the arm: for a robot that is not to move.
    ///
    /// # Errors
    /// If the rig's file, its calibration or its wires cannot be used.
    pub fn open_at_rest(&self, side: Side, seed: u64) -> Result<Session, SessionError> {
        let wanted = hand_side(side);
        match self {
            Self::Twin(twin_params) => {
                let mut rig = self.config();
                rig.hand.side = wanted;
                let lockstep = Lockstep::new(Twin::new(&twin_params.with_seed_added(seed), wanted)?)?;
                let robot = controller(&rig, &calibration(TWIN))?;
                Ok(Session { robot, pace: SessionPace::Lockstep(Box::new(lockstep)) })
            }
            Self::File { path, rig, claim } => {
                if rig.hand.side != wanted {
                    return Err(SessionError::Side { policy: side, rig: rig.hand.side });
                }
                let place = load_calibration(rig)?;
                let mut robot = controller(rig, &place)?;
                if claim.is_stop_requested() {
                    return Err(SessionError::Stopped);
                }
                let wires = OpenWires::open(&rig.wires)?;
                let worker = Worker::start()?;
                // Last of all: it acts if it is not told that all is well.
                let guard = start_guard(path, &rig.wires)?;
                let heat = HeatFile::new(&rig.wires);
                let live = Live::new(wires, guard, claim.clone(), heat, worker, &mut robot);
                Ok(Session { robot, pace: SessionPace::Live(Box::new(live)) })
            }
        }
    }
}

/// The rig's calibration, if it belongs to this rig and is recent.
///
/// # Errors
/// If it does not, or is missing.
pub fn load_calibration(rig: &RigConfig) -> Result<Calibration, CalibrationError> {
    let place = Calibration::load(&rig.calibration)?;
    place.check(&rig.name, unix_secs(), rig.limits.calibration_days)?;
    Ok(place)
}

pub(super) fn controller(rig: &RigConfig, place: &Calibration) -> Result<Robot, SessionError> {
    Ok(Robot::new(rig, rail_path(rig, place)?)?)
}

fn rail_path(rig: &RigConfig, place: &Calibration) -> Result<RailPath, CalibrationError> {
    RailPath::new(place, rig.limits.rail_range_m, &PAPER_HOME_DEG.map(f64::to_radians))
}

/// Claims the robot of a rig for this process.
///
/// # Errors
/// If another process has it.
pub fn claim(rig: &RigConfig) -> Result<Claim, SessionError> {
    Claim::new(&rig.wires).map_err(|source| SessionError::Claimed { rig: rig.name.clone(), source })
}

/// Starts the guard of the rig in the file `rig`, which stops the robot at `wires` if this process
/// ends or hangs.
///
/// # Errors
/// If it cannot be started, or the file has other devices by now.
pub fn start_guard(rig: &Path, wires: &WiresConfig) -> Result<Guard, SessionError> {
    let program = std::env::current_exe().map_err(SessionError::Guard)?;
    Guard::start(&program, rig, wires)
}

/// Seconds since 1970.
pub fn unix_secs() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

fn hand_side(side: Side) -> HandSide {
    match side {
        Side::Left => HandSide::Left,
        Side::Right => HandSide::Right,
    }
}

/// The rig that `--robot` names: `twin`, or a file, whose robot is claimed. To be called before any
/// long work.
///
/// # Errors
/// If another process has the robot, or the parameter set of the twin or the rig's file is not
/// valid.
pub fn rig_choice(robot: &str, twin_params: &str) -> Result<RigChoice, SessionError> {
    if robot == TWIN {
        return Ok(RigChoice::Twin(Box::new(TwinParams::load(twin_params).map_err(TwinError::from)?)));
    }
    let path = Path::new(robot).to_path_buf();
    if !path.exists() {
        let message = format!("there is no such file; `--robot {TWIN}` is a robot in software");
        return Err(RigError::Read { path, message }.into());
    }
    let rig = Box::new(RigConfig::load(&path)?);
    Ok(RigChoice::File { claim: Arc::new(claim(&rig)?), rig, path })
}

/// The pose in which every song begins, in the nominal world: rad, the rail in m.
///
/// # Errors
/// If the world cannot be built.
pub fn start_pose(side: Side) -> Result<[f64; DRIVEN_JOINTS], StageError> {
    let stage = StageConfig { side, ..StageConfig::default() };
    Ok(World::new(&stage, &PhysicalParams::default())?.start_pose())
}
