//! How long a robot goes on after its controller, or the guard of it, is killed or hangs: seen on
//! the wires.

use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use etude_robot::can::{self, CanTransport};
use etude_robot::priority::{Priority, Rank};
use etude_robot::rig_file::RigConfig;
use etude_robot::xarm::ArmConnection;
use etude_robot::xarm::report::ReportParser;

use crate::Sandbox;
use crate::processes::{self, children_of, with_arguments};
use crate::served_twin::Served;

/// Frames of torques, one a finger, and the frame that switches the servo off.
const TORQUES: [u16; 4] = [0x180, 0x184, 0x188, 0x18C];
const SERVO_OFF: u16 = 0x104;

/// Longest time until the hand has no torque, and between two reports of the arm, ms.
const FREE_MS: u128 = 100;
const REPORT_MS: u128 = 10;
const TRIES: usize = 5;

/// Another listener on the wires of a rig.
struct Listener {
    bus: Box<dyn CanTransport>,
    arm: ArmConnection,
    reports: ReportParser,
}

/// Milliseconds until something was on the wires.
#[derive(Debug)]
struct Times {
    /// Each finger's torques were zero, and stayed so.
    no_torque: u128,
    servo_off: u128,
    /// A report of the arm, which come every 10 ms, has state 4.
    arm_stopped: u128,
}

impl Listener {
    fn join(rig: &RigConfig) -> Self {
        let arm = ArmConnection::open(&rig.wires.arm).unwrap();
        Self { bus: can::join(&rig.wires.can).unwrap(), arm, reports: ReportParser::default() }
    }

    /// Does `act` and watches what the wires carry then.
    fn times(&mut self, act: impl FnOnce()) -> Times {
        // Where it is permitted, other programs do not delay what is seen.
        let _priority = Priority::of_this_thread(Rank::Controller).ok();
        let mut bytes = Vec::new();
        while self.bus.receive().unwrap().is_some() {}
        self.arm.receive_reports(&mut bytes).unwrap();
        let begun = Instant::now();
        act();
        let mut free = [None; 4];
        let (mut servo_off, mut arm_stopped) = (None, None);
        while begun.elapsed() < Duration::from_millis(1500) {
            let now = begun.elapsed().as_millis();
            while let Some(frame) = self.bus.receive().unwrap() {
                if let Some(finger) = TORQUES.iter().position(|id| *id == frame.id()) {
                    let is_free = frame.payload().iter().all(|byte| *byte == 0);
                    free[finger] = if is_free { free[finger].or(Some(now)) } else { None };
                } else if frame.id() == SERVO_OFF && !frame.is_remote() {
                    servo_off = servo_off.or(Some(now));
                }
            }
            bytes.clear();
            self.arm.receive_reports(&mut bytes).unwrap();
            let mut rest = &bytes[..];
            while let Some(report) = self.reports.next(&mut rest) {
                arm_stopped = arm_stopped.or((report.state == 4).then_some(now));
            }
            std::thread::sleep(Duration::from_micros(200));
        }
        let no_torque = free.into_iter().max().flatten().expect("each finger is freed");
        Times {
            no_torque,
            servo_off: servo_off.expect("servo off"),
            arm_stopped: arm_stopped.expect("state 4"),
        }
    }
}

#[test]
#[ignore = "takes minutes: `make test-heavy`, which .ci/run calls"]
fn a_robot_stops_soon_after_its_controller_or_guard() {
    let sandbox = Sandbox::new();
    let twin = Served::start(&sandbox);
    let rig = RigConfig::load(&twin.rig).unwrap();
    let path = twin.rig.display().to_string();
    println!("| what ends, after | hand without torque | servo off | arm in state 4 |\n|---|---|---|---|");
    let ends = [
        ("controller killed (SIGKILL)", false, "KILL"),
        ("controller hangs (SIGSTOP)", false, "STOP"),
        ("Ctrl-C", false, "INT"),
        ("guard killed (SIGKILL)", true, "KILL"),
        ("guard hangs (SIGSTOP)", true, "STOP"),
    ];
    // The way first: afterwards the arm stands at the keyboard.
    for homing in [true, false] {
        for (what, of_guard, signal) in ends {
            let phase = if homing { "on the way" } else { "playing" };
            // A busy machine gives the listener, the guard or the controller its turn late: the
            // best of five counts.
            let in_time = (0..TRIES).any(|_| {
                let mut controller = begin(&sandbox, &path, homing);
                let guards = with_arguments(&["robot", "guard", "--robot", &path]);
                let guard = children_of(controller.id()).into_iter().find(|id| guards.contains(id)).unwrap();
                let times = Listener::join(&rig).times(|| {
                    processes::signal(if of_guard { guard } else { controller.id() }, signal);
                });
                println!(
                    "| {what}, {phase} | {} ms | {} ms | {} ms |",
                    times.no_torque, times.servo_off, times.arm_stopped
                );
                if signal == "STOP" && !of_guard {
                    processes::signal(controller.id(), "KILL");
                }
                let _ = controller.wait();
                std::thread::sleep(Duration::from_millis(500));
                times.no_torque <= FREE_MS && times.arm_stopped <= FREE_MS + REPORT_MS
            });
            assert!(in_time, "{what}, {phase}: later than {FREE_MS} ms, {TRIES} times");
        }
    }
}

/// A controller on its way to the keyboard, or one that plays.
fn begin(sandbox: &Sandbox, rig: &str, homing: bool) -> Child {
    let file = sandbox.path("p/1/run-1.mcap");
    // The next performance has number 1 again.
    let _ = std::fs::remove_dir_all(sandbox.path("p"));
    let mut command =
        sandbox.command(&format!("perform ode-to-joy --mode real --scripted --home --robot {rig} -o p"));
    let controller = command.stdout(Stdio::null()).spawn().unwrap();
    let phase: &[u8] = if homing { b"\"moving\"" } else { b"\"following\"" };
    let until = Instant::now() + Duration::from_secs(60);
    while !std::fs::read(&file).is_ok_and(|bytes| bytes.windows(phase.len()).any(|window| window == phase)) {
        assert!(Instant::now() < until, "it never came so far");
        std::thread::sleep(Duration::from_millis(20));
    }
    std::thread::sleep(Duration::from_millis(1000));
    controller
}
