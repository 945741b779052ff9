//! A controller by the wall clock, on a twin in another thread, whose bus another program watches.

use std::os::unix::fs::PermissionsExt as _;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use etude_robot::Fault;
use etude_robot::allegro::HandFault;
use etude_robot::can::{self, CanFrame};
use etude_robot::rig_file::{RigConfig, WiresConfig};
use etude_twin::{ArmPorts, TwinParams, TwinServer};

use super::*;
use crate::RecordingWriter;
use crate::session::claim::file;
use crate::session::rig_choice::{controller, load_calibration};
use crate::session::{ready, start_pose};

/// Nothing here should take so long: a test that waits for it fails instead of hanging.
const TEST_TIMEOUT: Duration = Duration::from_secs(60);
/// Longest time between two torques of a busy machine that is no fault yet, twice.
const MAX_GAP: Duration = Duration::from_millis(200);
const SERVO_ON: u16 = 0x100;
const SERVO_OFF: u16 = 0x104;
const ANGLES_OF_FINGER_1: u16 = 0x084;
const TORQUES: [u16; 4] = [0x180, 0x184, 0x188, 0x18C];

/// What another program on the hand's bus has seen since the servo was switched on.
#[derive(Default)]
struct Seen {
    torques: usize,
    /// Whether one of them was not zero.
    driven: bool,
    last: [[u8; 8]; 4],
    last_at: Option<Instant>,
    longest_gap: Duration,
    off: bool,
    /// When finger 1 reported its angles last, and when the servo was switched off after that.
    told_at: Option<Instant>,
    off_after: Option<Duration>,
}

impl Seen {
    fn take(&mut self, frame: &CanFrame) {
        match frame.id() {
            SERVO_ON => *self = Self::default(),
            SERVO_OFF => {
                self.off = true;
                self.off_after = self.off_after.or(self.told_at.map(|at| at.elapsed()));
            }
            ANGLES_OF_FINGER_1 => self.told_at = Some(Instant::now()),
            id => {
                let Some(finger) = TORQUES.iter().position(|torques| *torques == id) else { return };
                self.last[finger] = frame.payload().try_into().unwrap();
                self.driven |= self.last[finger] != [0; 8];
                if finger == 0 && !self.off {
                    self.torques += 1;
                    let gap = self.last_at.replace(Instant::now()).map_or(Duration::ZERO, |at| at.elapsed());
                    self.longest_gap = self.longest_gap.max(gap);
                }
            }
        }
    }

    /// Whether the hand had torque, has none any more, and its servo is off.
    fn is_released(&self) -> bool {
        self.driven && self.off && self.last == [[0; 8]; 4]
    }
}

/// What is watched.
struct Watch<'a> {
    seen: &'a Mutex<Seen>,
}

impl Watch<'_> {
    fn seen(&self) -> std::sync::MutexGuard<'_, Seen> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until something was seen; whether it was.
    fn until(&self, so: impl Fn(&Seen) -> bool) -> bool {
        let begun = Instant::now();
        while !so(&self.seen()) {
            if begun.elapsed() > TEST_TIMEOUT {
                return false;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        true
    }
}

/// Ends the threads of a test, however it ends.
struct Ends<'a>(&'a AtomicBool);

impl Drop for Ends<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// A program that answers as the guard of a rig with these wires does.
fn echo(folder: &Path, wires: &WiresConfig) -> std::path::PathBuf {
    let path = folder.join("guard");
    std::fs::write(
        &path,
        format!("#!/bin/sh\necho $$ > \"$0.pid\"\necho '{}'\nexec cat >&0 2>/dev/null\n", ready(wires)),
    )
    .unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    path
}

#[test]
fn a_guard_of_other_devices_than_the_controllers_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let wires = WiresConfig::default();
    for changed in [
        WiresConfig { can: "can1".into(), ..wires.clone() },
        WiresConfig { arm: "192.168.1.112".into(), ..wires.clone() },
    ] {
        let program = echo(folder.path(), &changed);
        let refused = Guard::start(&program, Path::new("lab.toml"), &wires).unwrap_err().to_string();
        assert!(
            refused.contains("lab.toml") && refused.contains(&changed.can) && refused.contains(&changed.arm),
            "{refused}"
        );
        let pid = std::fs::read_to_string(folder.path().join("guard.pid")).unwrap();
        assert!(!Path::new("/proc").join(pid.trim()).exists(), "the guard of the other devices still runs");
        Guard::start(&program, Path::new("lab.toml"), &changed).unwrap().farewell();
    }
}

/// Lets a controller act on a twin with these faults. If the machine was too busy for the
/// controller or the echo, which has no real-time priority: once more.
fn on_a_twin(faults: &[&str], act: impl Fn(&mut Session, &Watch<'_>)) {
    for _ in 0..3 {
        let folder = tempfile::tempdir().unwrap();
        let faults: Vec<_> = faults.iter().map(|fault| fault.parse().unwrap()).collect();
        let twin_params = TwinParams::load("mild").unwrap().with_faults(&faults).unwrap();
        let mut server =
            TwinServer::open(&twin_params, &RigConfig::default(), folder.path(), ArmPorts::FREE).unwrap();
        let path = server.rig().to_path_buf();
        let mut rig = RigConfig::load(&path).unwrap();
        // A machine that is busy with other tests must not look like a fault.
        rig.hand.stale_after_secs = MAX_GAP.as_secs_f64() / 2.0;
        (rig.arm.report_stale_after_secs, rig.arm.reply_timeout_secs) = (1.0, 5.0);
        let mut robot = controller(&rig, &load_calibration(&rig).unwrap()).unwrap();
        let (ends, seen) = (AtomicBool::new(false), Mutex::<Seen>::default());
        let was_busy = std::thread::scope(|scope| {
            scope.spawn(|| server.serve(&ends).unwrap());
            scope.spawn(|| {
                let _priority = Priority::of_this_thread(Rank::Controller);
                let mut bus = can::open(&rig.wires.can).unwrap();
                while !ends.load(Ordering::Relaxed) {
                    while let Ok(Some(frame)) = bus.receive() {
                        seen.lock().unwrap().take(&frame);
                    }
                    std::thread::sleep(Duration::from_micros(500));
                }
            });
            let _ends = Ends(&ends);
            let wires = OpenWires::open(&rig.wires).unwrap();
            let guard = Guard::start(&echo(folder.path(), &rig.wires), &path, &rig.wires).unwrap();
            let claim = Arc::new(Claim::new(&rig.wires).unwrap());
            let heat = HeatFile::new(&rig.wires);
            let live = Live::new(wires, guard, claim, heat, Worker::start().unwrap(), &mut robot);
            let mut session = Session { robot, pace: SessionPace::Live(Box::new(live)) };
            let acted = catch_unwind(AssertUnwindSafe(|| act(&mut session, &Watch { seen: &seen })));
            let busy = session.robot.phase() == Phase::Stopped
                || matches!(session.robot.fault(), Some(Fault::Stalled { .. }));
            match acted {
                Err(_) if busy => true,
                Err(panic) => resume_unwind(panic),
                Ok(()) => false,
            }
        });
        // The next program knows of the motors' heat.
        let heat = HeatFile::new(&rig.wires).read(Duration::ZERO).joints(Duration::ZERO);
        std::fs::remove_file(file(&can::device(&rig.wires.can), "heat")).unwrap();
        if !was_busy {
            assert!(heat.iter().any(|heat| *heat > 0.0), "{heat:?}");
            return;
        }
    }
    panic!("the machine is busy again and again");
}

#[test]
fn a_policy_that_hangs_does_not_hold_up_the_hand_and_ends_with_a_fault() {
    let pose = start_pose(etude_stage::Side::default()).unwrap();
    on_a_twin(&[], |session, watch| {
        let Session { robot, pace } = session;
        prepare(robot, pace, Some(&pose), None, &AtomicBool::new(false)).unwrap();
        robot.follow(pace.now(), &[pose; 10]).unwrap();
        let before = {
            let mut seen = watch.seen();
            seen.longest_gap = Duration::ZERO;
            seen.torques
        };
        let mut released = false;
        pace.run_while(robot, &mut || {
            std::thread::sleep(Duration::from_millis(500));
            released = watch.until(Seen::is_released);
        });
        assert!(released, "nothing released the hand while the work hung");
        assert!(matches!(robot.fault(), Some(Fault::StaleCommand { .. })), "{:?}", robot.fault());
        let seen = watch.seen();
        assert!(seen.torques > before + 10 && seen.longest_gap < MAX_GAP, "{:?}", seen.longest_gap);
    });
}

#[test]
fn a_device_that_falls_silent_while_work_hangs_ends_with_a_fault() {
    for silent in ["finger-silent=1@6", "arm-mute@6"] {
        on_a_twin(&[silent], |session, watch| {
            let Session { robot, pace } = session;
            prepare(robot, pace, None, None, &AtomicBool::new(false)).unwrap();
            let mut released = false;
            pace.run_while(robot, &mut || released = watch.until(Seen::is_released));
            assert!(released, "{silent}: nothing released the hand while the work hung");
            let fault = robot.fault();
            let expected = match silent {
                "arm-mute@6" => matches!(fault, Some(Fault::Arm(_))),
                _ => matches!(fault, Some(Fault::Hand(HandFault::PositionsStale { finger: 1, .. }))),
            };
            assert!(expected, "{silent}: {fault:?}");
            if silent.starts_with("finger") {
                // The limit is half of the gap.
                let off_after = watch.seen().off_after.unwrap();
                assert!(off_after < MAX_GAP, "{off_after:?} from the finger's last angles to the release");
            }
            assert!(watch.seen().longest_gap < MAX_GAP, "{:?}", watch.seen().longest_gap);
        });
    }
}

#[test]
fn a_disk_that_hangs_does_not_hold_up_a_start() {
    on_a_twin(&[], |session, watch| {
        let Session { robot, pace } = session;
        let (writer, free) = RecordingWriter::stuck();
        let held = std::thread::scope(|scope| {
            let mut writer = writer;
            let disk = scope.spawn(|| {
                let held = watch.until(|seen| seen.torques > 100);
                free();
                held
            });
            prepare(robot, pace, None, Some(&mut writer), &AtomicBool::new(false)).unwrap();
            drop(writer);
            disk.join().unwrap()
        });
        assert!(held, "the hand was not held while the disk hung: {:?}", robot.fault());
    });
}
