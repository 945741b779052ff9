//! A twin that is ready to play, and the simulator beside it.

use std::sync::atomic::AtomicBool;

use etude_perform::{
    Mode, PerformError, Performance, RecordingWriter, Rig, RobotRig, SimRig, perform, prepare,
};
use etude_robot::Robot;
use etude_robot::allegro::HandSide;
use etude_robot::calibration::RailPath;
use etude_robot::xarm::kinematics::PAPER_HOME_DEG;
use etude_stage::{DRIVEN_JOINTS, PhysicalParams, World};
use etude_task::{Piece, Player, TaskConfig};
use etude_twin::{Lockstep, Twin, TwinParams, calibration};

/// Which rig a test is run on: the simulator, or the twin in an execution mode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    Simulator,
    Twin(Mode),
}

impl Kind {
    pub const ALL: [Self; 4] =
        [Self::Simulator, Self::Twin(Mode::JointMirroring), Self::Twin(Mode::Hybrid), Self::Twin(Mode::Real)];
}

/// The pose in which every performance begins: rad, the rail in m.
pub fn start_pose(task: &TaskConfig) -> [f64; DRIVEN_JOINTS] {
    World::new(&task.stage, &PhysicalParams::default()).unwrap().start_pose()
}

/// Calls `use_rig` with a rig of this kind that is ready to play.
pub fn with_rig<T>(
    kind: Kind,
    twin_params: &TwinParams,
    task: &TaskConfig,
    piece: &Piece,
    use_rig: impl FnOnce(&mut dyn Rig) -> T,
) -> T {
    let Kind::Twin(mode) = kind else {
        return use_rig(&mut SimRig::nominal(task, piece).unwrap());
    };
    with_robot(twin_params, task, |robot, lockstep, pose| {
        prepare(robot, lockstep, Some(pose), None, &AtomicBool::new(false)).unwrap();
        let simulation = mode.simulation(task).unwrap();
        use_rig(&mut *mode.rig(simulation, RobotRig::new(robot, lockstep, pose)))
    })
}

/// Calls `use_robot` with the controller of a twin that is switched off, the twin, and the pose in
/// which performances begin.
pub fn with_robot<T>(
    twin_params: &TwinParams,
    task: &TaskConfig,
    use_robot: impl FnOnce(&mut Robot, &mut Lockstep, &[f64; DRIVEN_JOINTS]) -> T,
) -> T {
    let rig = twin_params.rig();
    let mut lockstep = Lockstep::new(Twin::new(twin_params, HandSide::Left).unwrap()).unwrap();
    let home = PAPER_HOME_DEG.map(f64::to_radians);
    let path = RailPath::new(&calibration("twin"), rig.limits.rail_range_m, &home).unwrap();
    let mut robot = Robot::new(&rig, path).unwrap();
    use_robot(&mut robot, &mut lockstep, &start_pose(task))
}

/// Plays `piece` once on a rig of this kind.
pub fn play(
    kind: Kind,
    twin_params: &TwinParams,
    task: &TaskConfig,
    piece: &Piece,
    player: &mut dyn Player,
    writer: Option<&mut RecordingWriter>,
    interrupt: &AtomicBool,
) -> Result<Performance, PerformError> {
    with_rig(kind, twin_params, task, piece, |rig| perform(rig, player, task, piece, writer, interrupt))
}
