//! The emulator on sockets: for our driver, and for UFACTORY's own client (`scripts/check_xarm.py` and
//! `scripts/check_xarm_calls.py`).

use std::io::{BufRead as _, BufReader, Write as _};
use std::net::{IpAddr, Ipv4Addr};
use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use etude_emulators::{ArmEmulator, ArmEmulatorConfig, ArmPorts, ArmServer, Reach};
use etude_robot::xarm::{Arm, ArmConfig, ArmConnection, ArmState};

use crate::bench::{MS, apart};

/// Environment variable that names a Python with xarm-python-sdk; `make test` sets it.
const PYTHON: &str = "ETUDE_PYTHON";

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

#[test]
fn the_official_client_takes_the_emulator_for_an_arm() {
    println!("{}", run_script("check_xarm.py"));
}

#[test]
fn the_official_clients_calls_are_answered() {
    println!("{}", run_script("check_xarm_calls.py"));
}

/// Runs a script of UFACTORY's client against an emulator, which must end well; what it prints.
fn run_script(name: &str) -> String {
    let Some(python) = std::env::var_os(PYTHON) else {
        // Not through a macro: the test harness would swallow it.
        let _ = writeln!(
            std::io::stderr(),
            "\n*** SKIPPED: the arm's emulator against UFACTORY's client. Set {PYTHON} to a Python with \
             xarm-python-sdk==1.18.4. ***\n"
        );
        return String::new();
    };
    let mut served = Served::new();
    let ports = served.server.ports().unwrap();
    let script = format!("{}/../../scripts/{name}", env!("CARGO_MANIFEST_DIR"));
    let mut child = Command::new(&python)
        .arg(script)
        .args([ports.command, ports.normal, ports.rich, ports.real].map(|port| port.to_string()))
        .stdout(Stdio::piped())
        .spawn()
        .unwrap_or_else(|error| panic!("{PYTHON}={python:?} does not run: {error}"));
    let lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let (send, said) = mpsc::channel();
    let reader =
        std::thread::spawn(move || lines.map_while(Result::ok).for_each(|line| drop(send.send(line))));
    let mut transcript = String::new();
    let status = loop {
        served.serve();
        while let Ok(line) = said.try_recv() {
            // The script orders an error, as a hand on the arm would.
            if let Some(code) = line.strip_prefix("inject ") {
                served.emulator.inject_error(code.parse().unwrap());
            }
            transcript += &line;
            transcript.push('\n');
        }
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if served.begun.elapsed() > Duration::from_secs(120) {
            child.kill().unwrap();
        }
    };
    reader.join().unwrap();
    transcript.extend(said.try_iter());
    assert!(status.success(), "{status}\n{transcript}");
    transcript
}
