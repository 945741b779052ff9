//! Whatever a rig's file may hold, the controller runs with it or ends in a fault.

use etude_robot::Phase;
use etude_robot::rig_file::RigConfig;

use crate::bench::{Bench, rig};

#[test]
fn any_limits_that_are_sound_can_be_run_with() {
    let mut ran = 0;
    for name in [
        "finger_velocity",
        "finger_acceleration",
        "finger_jerk",
        "rail_velocity",
        "rail_acceleration",
        "rail_jerk",
        "start_finger_rad",
        "start_rail_m",
        "stale_command_secs",
        "following_rad",
        "following_secs",
    ] {
        for value in ["1e300", "1e-300", "5e-324", "1e-9", "0.05", "1.0", "13.0", "2000.0", "400000.0"] {
            let limits = toml::from_str(&format!("{name} = {value}")).unwrap();
            let config = RigConfig { limits, ..rig() };
            if config.check().is_err() {
                continue;
            }
            let mut bench = Bench::with(&config);
            bench.start();
            bench.run(200);
            let mut pose = bench.robot.joints();
            let _ = bench.robot.follow(bench.now(), &[pose; 10]);
            pose[3] = 1e300;
            let _ = bench.robot.follow(bench.now(), &[pose; 10]);
            bench.run(60);
            let _ = bench.robot.home(bench.now(), &pose);
            bench.run(60);
            ran += usize::from(bench.robot.phase() != Phase::Off);
        }
    }
    assert!(ran > 30, "{ran}");
}
