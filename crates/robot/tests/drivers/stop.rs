//! A stop from outside the controller: each device hears it whatever the others do.

use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::ScopedJoinHandle;
use std::time::{Duration, Instant};

use etude_emulators::{
    ArmEmulator, ArmEmulatorConfig, ArmPorts, ArmServer, HandEmulator, HandEmulatorConfig, VirtualBus,
};
use etude_robot::can::{self, CanFrame, CanTransport, SlcanTransport};
use etude_robot::rig_file::RigConfig;
use etude_robot::stop::{Stopped, stop};
use etude_robot::xarm::codec::{Frame, Register, push_floats};

use crate::adapter::Adapter;

/// Nothing here should take so long: a test that waits for it fails instead of hanging.
const TIMEOUT: Duration = Duration::from_secs(20);
const SERVO_ON: u16 = 0x100;
const SERVO_OFF: u16 = 0x104;

fn rig(can: String, arm: &str) -> RigConfig {
    let mut rig = RigConfig { name: "test".into(), ..RigConfig::default() };
    (rig.wires.can, rig.wires.arm) = (can, arm.to_string());
    rig
}

fn bus(path: &Path) -> String {
    format!("bus:{}", path.display())
}

/// An arm that moves, and its server.
fn moving_arm() -> (ArmEmulator, ArmServer, u16) {
    let server = ArmServer::bind(ArmPorts::FREE).unwrap();
    let port = server.ports().unwrap().command;
    let mut arm = ArmEmulator::new(ArmEmulatorConfig::default());
    let id = arm.connect();
    let mut goal = vec![Register::MoveJoints as u8];
    push_floats(&mut goal, &[1.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.1, 1.0, 0.0]);
    let requests: [&[u8]; 4] = [
        &[Register::MotionEnable as u8, 8, 1],
        &[Register::SetMode as u8, 0],
        &[Register::SetState as u8, 0],
        &goal,
    ];
    for (number, body) in (1..).zip(requests) {
        let mut bytes = Vec::new();
        Frame::new(number, 2, &[body]).unwrap().write(&mut bytes);
        arm.receive(Duration::ZERO, id, &bytes);
    }
    arm.advance(Duration::from_millis(20));
    assert_eq!(arm.state(), 1);
    (arm, server, port)
}

fn wait(stopping: ScopedJoinHandle<'_, Stopped>, mut turn: impl FnMut()) -> Stopped {
    let begun = Instant::now();
    while !stopping.is_finished() {
        turn();
        assert!(begun.elapsed() < TIMEOUT);
        std::thread::sleep(Duration::from_micros(100));
    }
    stopping.join().unwrap()
}

/// An emulated hand on a virtual bus.
struct BusHand {
    bus: SlcanTransport<UnixStream>,
    hand: HandEmulator,
    /// Whether the servo was switched off.
    let_go: bool,
}

impl BusHand {
    fn new(path: &Path) -> Self {
        let hand = HandEmulator::new(&HandEmulatorConfig::default());
        Self { bus: SlcanTransport::connect(path).unwrap(), hand, let_go: false }
    }

    fn turn(&mut self, now: Duration, answers: bool) {
        let mut said = Vec::new();
        while let Some(frame) = self.bus.receive().unwrap() {
            self.let_go |= frame.id() == SERVO_OFF;
            self.hand.receive(now, &frame, &mut said);
        }
        for frame in said.into_iter().filter(|_| answers) {
            self.bus.send(frame).unwrap();
        }
    }
}

/// The arm answers only after the hand was let go, and nobody answers at its report port at all.
#[test]
fn the_hand_does_not_wait_for_the_arm_nor_the_arm_for_its_reports() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bus");
    let mut bus_server = VirtualBus::bind(&path).unwrap();
    let mut hand = BusHand::new(&path);
    let (mut arm, mut server, port) = moving_arm();
    // Port 1 refuses.
    let rig = rig(bus(&path), &format!("127.0.0.1:{port}:1"));
    let begun = Instant::now();
    let stopped = std::thread::scope(|scope| {
        wait(scope.spawn(|| stop(&rig)), || {
            bus_server.poll();
            hand.turn(begun.elapsed(), true);
            if hand.let_go {
                arm.advance(begun.elapsed());
                server.serve_once(begun.elapsed(), &mut arm);
            }
        })
    });
    assert!(hand.let_go && stopped.is_sure(), "{stopped:?}");
    assert_eq!(arm.state(), 4);
}

#[test]
fn one_that_cannot_be_reached_does_not_save_the_other() {
    let folder = tempfile::tempdir().unwrap();
    let (mut arm, mut server, port) = moving_arm();
    let begun = Instant::now();
    let without_a_bus = rig(bus(&folder.path().join("none")), &format!("127.0.0.1:{port}:1"));
    let stopped = std::thread::scope(|scope| {
        wait(scope.spawn(|| stop(&without_a_bus)), || {
            arm.advance(begun.elapsed());
            server.serve_once(begun.elapsed(), &mut arm);
        })
    });
    assert!(stopped.hand.is_err() && stopped.arm.is_ok() && arm.state() == 4, "{stopped:?}");
    let path = folder.path().join("bus");
    let mut bus_server = VirtualBus::bind(&path).unwrap();
    let without_an_arm = rig(bus(&path), "127.0.0.1:1:1");
    // A hand that does not answer was told, and is not called stopped.
    for answers in [true, false] {
        let mut hand = BusHand::new(&path);
        let stopped = std::thread::scope(|scope| {
            wait(scope.spawn(|| stop(&without_an_arm)), || {
                bus_server.poll();
                hand.turn(begun.elapsed(), answers);
            })
        });
        assert!(hand.let_go && stopped.hand.is_ok() == answers && stopped.arm.is_err(), "{stopped:?}");
    }
}

/// Emulated hand and adapter on a pseudo terminal; what the hand was told.
fn serve(device: &mut Adapter, done: &AtomicBool) -> Vec<CanFrame> {
    let mut hand = HandEmulator::new(&HandEmulatorConfig::default());
    let (begun, mut told) = (Instant::now(), Vec::new());
    while !done.load(Ordering::Relaxed) {
        assert!(begun.elapsed() < TIMEOUT);
        let mut answers = Vec::new();
        while let Some(frame) = device.receive().unwrap() {
            told.push(frame);
            hand.receive(begun.elapsed(), &frame, &mut answers);
        }
        for frame in answers {
            device.send(frame).unwrap();
        }
        std::thread::sleep(Duration::from_micros(100));
    }
    told
}

/// Runs `act` beside the hand behind an adapter; what the hand was told.
fn beside_a_hand(act: impl FnOnce(&str)) -> Vec<CanFrame> {
    let (mut device, path) = Adapter::new();
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let serving = scope.spawn(|| serve(&mut device, &done));
        act(&format!("slcan:{path}"));
        // What was sent last is on its way.
        std::thread::sleep(Duration::from_millis(50));
        done.store(true, Ordering::Relaxed);
        serving.join().unwrap()
    })
}

fn count(told: &[CanFrame], id: u16) -> usize {
    told.iter().filter(|frame| frame.id() == id).count()
}

#[test]
fn a_joined_adapter_keeps_its_channel() {
    let on = CanFrame::new(SERVO_ON, &[]).unwrap();
    let told = beside_a_hand(|spec| {
        let mut controller = can::open(spec).unwrap();
        controller.send(on).unwrap();
        let stopped = stop(&rig(spec.into(), "127.0.0.1:1:1"));
        assert!(stopped.hand.is_ok(), "{stopped:?}");
        // The channel is still open, so that a controller that runs on can let go as well.
        controller.send(on).unwrap();
    });
    assert_eq!((count(&told, SERVO_ON), count(&told, SERVO_OFF)), (2, 2), "{told:?}");
}

#[test]
fn an_adapter_whose_channel_nobody_has_opened_is_opened() {
    let told = beside_a_hand(|spec| {
        // A controller that ended has closed it.
        drop(can::open(spec).unwrap());
        let stopped = stop(&rig(spec.into(), "127.0.0.1:1:1"));
        assert!(stopped.hand.is_ok(), "{stopped:?}");
    });
    assert!(count(&told, SERVO_OFF) >= 1, "{told:?}");
}
