//! Driver and emulator on sockets.

use std::net::{IpAddr, Ipv4Addr};
use std::time::{Duration, Instant};

use etude_emulators::{ArmEmulator, ArmEmulatorConfig, ArmPorts, ArmServer, Reach};
use etude_robot::xarm::{Arm, ArmConfig, ArmConnection, ArmState};

use super::bench::{MS, apart};

/// An emulator on sockets of this machine, with the time of the wall.
struct Served {
    server: ArmServer,
    emulator: ArmEmulator,
    begun: Instant,
}

impl Served {
    fn new() -> Self {
        let here = IpAddr::V4(Ipv4Addr::LOCALHOST);
        let server = ArmServer::bind(here, ArmPorts::FREE, Reach::ThisMachine).unwrap();
        Self { server, emulator: ArmEmulator::new(ArmEmulatorConfig::default()), begun: Instant::now() }
    }

    fn serve(&mut self) -> Duration {
        std::thread::sleep(MS / 2);
        self.server.serve_once(self.begun.elapsed(), &mut self.emulator);
        self.begun.elapsed()
    }
}

#[test]
fn driver_and_emulator_meet_on_sockets() {
    for reports in [|ports: &ArmPorts| ports.real, |ports: &ArmPorts| ports.control] {
        meet_on_sockets(reports);
    }
}

/// With the reports of this port.
fn meet_on_sockets(reports: fn(&ArmPorts) -> u16) {
    let outside: IpAddr = [0, 0, 0, 0].into();
    assert!(ArmServer::bind(outside, ArmPorts::FREE, Reach::ThisMachine).is_err());

    let mut served = Served::new();
    let ports = served.server.ports().unwrap();
    let host = format!("127.0.0.1:{}:{}", ports.command, reports(&ports));
    let mut connection = ArmConnection::open(&host).unwrap();
    // A machine that is busy with other tests must not look like a fault.
    let patient = ArmConfig { reply_timeout_secs: 5.0, report_stale_after_secs: 5.0, ..ArmConfig::default() };
    let mut arm = Arm::new(patient).unwrap();
    arm.connected(Duration::ZERO);
    arm.start(Duration::ZERO).unwrap();
    let mut exchange = |served: &mut Served, arm: &mut Arm| {
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
