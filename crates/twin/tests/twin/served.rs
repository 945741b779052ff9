//! A twin on sockets: the faults that its parameters order reach a controller in another thread as
//! they would a real rig's.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use etude_robot::calibration::{Calibration, RailPath};
use etude_robot::rig_file::RigConfig;
use etude_robot::wires::OpenWires;
use etude_robot::xarm::kinematics::PAPER_HOME_DEG;
use etude_robot::{Phase, Robot};
use etude_twin::{ArmPorts, TwinParams, TwinServer};

/// Nothing here should take so long: a test that waits for it fails instead of hanging.
const TIMEOUT: Duration = Duration::from_secs(60);

#[test]
fn ordered_faults_reach_a_controller_over_sockets() {
    let folder = tempfile::tempdir().unwrap();
    let ordered = [
        ("can-bus-off@1+0.5", "can0 down"),
        ("keyboard-unplugged@2.5+0.5", "was unplugged"),
        ("hand-fault=4@4+0.5", "status bits"),
        ("estop@5.5+0.5", "error 1"),
        ("arm-disconnect@7+0.5", "connection"),
    ];
    let faults = ordered.map(|(text, _)| text.parse().unwrap());
    let twin_params = TwinParams::load("mild").unwrap().with_faults(&faults).unwrap();
    let mut server =
        TwinServer::open(&twin_params, &RigConfig::default(), folder.path(), ArmPorts::FREE).unwrap();
    let mut rig = RigConfig::load(server.rig()).unwrap();
    // A machine that is busy with other tests must not look like a fault.
    rig.hand.stale_after_secs = 0.1;
    (rig.arm.report_stale_after_secs, rig.arm.reply_timeout_secs) = (5.0, 5.0);
    let place = Calibration::load(&rig.calibration).unwrap();
    let near = PAPER_HOME_DEG.map(f64::to_radians);
    let path = RailPath::new(&place, rig.limits.rail_range_m, &near).unwrap();
    let mut robot = Robot::new(&rig, path).unwrap();
    let stop = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let serving = scope.spawn(|| server.serve(&stop).unwrap());
        let _stops = StopsAtTheEnd(&stop);
        let mut wires = OpenWires::open(&rig.wires).unwrap();
        let begun = Instant::now();
        let mut poll = |robot: &mut Robot| {
            let now = begun.elapsed();
            assert!(now < TIMEOUT && !serving.is_finished(), "{:?} {:?}", robot.phase(), robot.fault());
            robot.poll(now, &mut wires);
            if let Some(fault) = robot.fault().filter(|_| robot.phase() == Phase::Fault) {
                let fault = fault.to_string();
                // An arm's connection is opened anew by an operator only, until one is taken again.
                if ["connection", "nothing answers"].iter().any(|words| fault.contains(words))
                    && let Ok(anew) = OpenWires::open(&rig.wires)
                {
                    wires = anew;
                }
                robot.start(now);
                return Some(fault);
            }
            if robot.phase() == Phase::Off {
                robot.start(now);
            }
            std::thread::sleep(Duration::from_micros(250));
            None
        };
        for (order, said) in ordered {
            // Started again and again, as an impatient operator does, it names the cause.
            loop {
                if let Some(fault) = poll(&mut robot)
                    && fault.contains(said)
                {
                    println!("{order}: {fault}");
                    break;
                }
            }
        }
        while robot.phase() != Phase::Holding {
            poll(&mut robot);
        }
    });
}

/// Stops a server also when the test fails.
struct StopsAtTheEnd<'a>(&'a AtomicBool);

impl Drop for StopsAtTheEnd<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}
