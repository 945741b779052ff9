//! Driver and emulator on sockets.

use std::time::Duration;

use etude_emulators::ReportKind;
use etude_robot::xarm::{Arm, ArmConfig, ArmConnection, ArmState};

use super::bench::apart;
use super::served::ServedArm;

#[test]
fn driver_and_emulator_meet_on_sockets() {
    for reports in [ReportKind::Real, ReportKind::Control] {
        meet_on_sockets(reports);
    }
}

/// With these reports.
fn meet_on_sockets(reports: ReportKind) {
    let mut served = ServedArm::new();
    let ports = served.server.ports().unwrap();
    let host = format!("127.0.0.1:{}:{}", ports.command, ports.of(reports));
    let mut connection = ArmConnection::open(&host).unwrap();
    // A machine that is busy with other tests must not look like a fault.
    let patient = ArmConfig { reply_timeout_secs: 5.0, report_stale_after_secs: 5.0, ..ArmConfig::default() };
    let mut arm = Arm::new(patient).unwrap();
    arm.connected(Duration::ZERO);
    arm.start(Duration::ZERO).unwrap();
    let mut exchange = |served: &mut ServedArm, arm: &mut Arm| {
        let (now, mut bytes) = (served.serve(), Vec::new());
        connection.receive_reports(&mut bytes).unwrap();
        arm.receive_report(now, &bytes);
        bytes.clear();
        connection.commands.receive(&mut bytes).unwrap();
        arm.receive_command(now, &bytes);
        bytes.clear();
        arm.poll(now, &mut bytes);
        connection.commands.send(&bytes).unwrap();
        now
    };
    while arm.state() != ArmState::Ready {
        let now = exchange(&mut served, &mut arm);
        assert!(
            now < Duration::from_secs(60) && !matches!(arm.state(), ArmState::Fault(_)),
            "{:?}",
            arm.state()
        );
    }
    // Somebody else comes, looks and goes.
    drop(ArmConnection::open(&host).unwrap());
    let now = exchange(&mut served, &mut arm);
    let from = arm.joints().unwrap();
    let mut target = from;
    target[0] += 0.005;
    arm.servo(now, target).unwrap();
    while apart(&served.emulator.joints(), &target) > 1e-3 {
        let now = exchange(&mut served, &mut arm);
        assert!(now < Duration::from_secs(60));
    }
    drop(served);
    let mut bytes = Vec::new();
    assert!(connection.commands.receive(&mut bytes).is_err());
    let refused = ArmConnection::open(&host).unwrap_err().to_string();
    assert!(refused.contains("control box"), "{refused}");
}
