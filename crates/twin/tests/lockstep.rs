//! A controller and a twin in lockstep.

use std::time::Duration;

use etude_robot::calibration::RailPath;
use etude_robot::joints::RAIL;
use etude_robot::rig::RigConfig;
use etude_robot::xarm::kinematics::PAPER_HOME_DEG;
use etude_robot::{Pace as _, Phase, Robot};
use etude_stage::{PhysicalParams, StageConfig, World};
use etude_twin::{Lockstep, Truth, Twin, calibration};

fn rig() -> RigConfig {
    RigConfig { name: "twin".into(), ..RigConfig::default() }
}

fn robot() -> Robot {
    let rig = rig();
    let home = PAPER_HOME_DEG.map(f64::to_radians);
    let path = RailPath::new(&calibration("twin"), rig.limits.rail_range_m, &home).unwrap();
    Robot::new(&rig, path).unwrap()
}

fn lockstep(truth: &str) -> Lockstep {
    let truth = Truth::load(truth).unwrap();
    let twin = Twin::new(&truth, rig().hand.side).unwrap();
    Lockstep::new(twin, &truth.links, truth.seed).unwrap()
}

fn run_until_phase(robot: &mut Robot, pace: &mut Lockstep, phase: Phase, secs: u64) {
    let end = pace.now() + Duration::from_secs(secs);
    while robot.phase() != phase && pace.now() < end {
        let next = pace.now() + Duration::from_millis(10);
        pace.run_until(robot, next);
        assert!(phase == Phase::Fault || robot.phase() != Phase::Fault, "{}", robot.fault().unwrap());
    }
    assert_eq!(robot.phase(), phase, "after {:?}", pace.now());
}

#[test]
fn it_starts_goes_to_the_keyboard_and_follows() {
    let (mut robot, mut pace) = (robot(), lockstep("standard"));
    robot.start(pace.now());
    run_until_phase(&mut robot, &mut pace, Phase::Holding, 5);
    println!("holding at {:?}", pace.now());
    let mut pose = World::new(&StageConfig::default(), &PhysicalParams::default()).unwrap().start_pose();
    pose[RAIL] = 0.1;
    robot.home(pace.now(), &pose).unwrap();
    run_until_phase(&mut robot, &mut pace, Phase::Holding, 60);
    println!("at the keyboard at {:?}: {:?}", pace.now(), robot.joints());
    let measured = robot.joints();
    assert!((measured[RAIL] - 0.1).abs() < 1e-3);
    let mut waypoints = [pose; 10];
    for step in 0..40 {
        let now = pace.now();
        for (index, waypoint) in waypoints.iter_mut().enumerate() {
            let secs = f64::from(step) * 0.05 + index as f64 * 0.005;
            waypoint[RAIL] = 0.1 + 0.03 * (1.0 - (2.0 * secs).cos());
        }
        robot.follow(now, &waypoints).unwrap();
        pace.run_until(&mut robot, now + Duration::from_millis(50));
        assert_eq!(robot.phase(), Phase::Following, "{:?}", robot.fault());
    }
    println!("{:?} {}", robot.joints()[RAIL], robot.clamped());
    println!("{:?} {:?}", robot.hand().counters(), robot.arm().counters());
}
