//! Bytes and targets that make no sense.

use std::time::Duration;

use etude_emulators::{ArmEmulator, ArmEmulatorConfig, ReportKind};
use etude_robot::xarm::ArmState;
use etude_robot::xarm::codec::{FEEDBACK, Frame, FrameParser, Register};
use etude_robot::xarm::kinematics::JOINTS;
use proptest::prelude::*;
use rand::SeedableRng as _;
use rand_pcg::Pcg64;

use crate::bench::{Bench, home};

/// Bytes that are sometimes a frame or a report, with a few of them wrong.
fn hostile(random: &mut Pcg64, valid: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = match random.random_range(0..4) {
        0 => (0..random.random_range(0..300)).map(|_| random.random()).collect(),
        _ => valid[random.random_range(0..valid.len())].clone(),
    };
    while !bytes.is_empty() && random.random_range(0..3) == 0 {
        let at = random.random_range(0..bytes.len());
        match random.random_range(0..3) {
            0 => bytes[at] = random.random(),
            1 => bytes.truncate(at),
            _ => bytes.insert(at, random.random()),
        }
    }
    bytes
}

fn valid_frames() -> Vec<Vec<u8>> {
    let mut frames = Vec::new();
    for transaction in 0..30 {
        for &register in Register::ALL {
            for params in [&[][..], &[0, 0], &[1, 2], &[8, 1], &[0; 40], b"\x007,7,XS1304,AC1302,v2.4.0\0"] {
                let mut bytes = Vec::new();
                Frame::new(transaction, 3, &[&[register as u8], params]).unwrap().write(&mut bytes);
                frames.push(bytes);
            }
        }
    }
    frames
}

#[test]
fn millions_of_bytes_break_nothing() {
    let mut random = Pcg64::seed_from_u64(1);
    let frames = valid_frames();
    let (mut bench, mut report) = (Bench::new(), Vec::new());
    bench.emulator.advance(Duration::from_millis(10));
    bench.emulator.take_reports(ReportKind::Real, &mut report);
    let reports: Vec<_> = (0..8)
        .map(|state| {
            let mut report = report.clone();
            report[4] = state | 1 << 4;
            report
        })
        .collect();
    bench = Bench::new();
    let (mut fed, mut starts) = (0, 0);
    while fed < 3_000_000 {
        // Now and then the arm itself, so that the driver gets somewhere.
        if random.random_range(0..3000) == 0 {
            bench = Bench::ready();
        }
        for _ in 0..random.random_range(0..4) {
            bench.step();
        }
        let (frame, report) = (hostile(&mut random, &frames), hostile(&mut random, &reports));
        fed += 2 * frame.len() + report.len();
        bench.emulator.receive(bench.now, bench.id, &frame);
        if random.random() {
            bench.arm.receive_command(bench.now, &frame);
            bench.arm.receive_report(bench.now, &report);
        }
        let mut target: [f64; JOINTS] =
            bench.arm.sent().unwrap_or(home()).map(|angle| angle + random.random_range(-0.02..0.02));
        if random.random_range(0..50) == 0 {
            let odd = [f64::NAN, f64::INFINITY, 7.0, -7.0, 1e300, 0.0];
            target[random.random_range(0..JOINTS)] = odd[random.random_range(0..odd.len())];
        }
        let _ = bench.servo(target);
        match random.random_range(0..400) {
            0 => bench.stop(),
            1 => bench.arm.connected(bench.now),
            2 => bench.arm.disconnected(bench.now),
            3 => drop(bench.arm.manual(bench.now, true)),
            4 => drop(bench.arm.manual(bench.now, false)),
            5..20 => starts += u32::from(bench.arm.start(bench.now).is_ok()),
            _ => {}
        }
    }
    assert!(starts > 10);
}

/// Parameters of a request: bytes, or floats of the size of joints and bytes after them.
fn parameters() -> impl Strategy<Value = Vec<u8>> {
    let floats = prop::collection::vec(-2.0..2.0_f32, 0..16);
    let sized = (floats, prop::collection::vec(0..3_u8, 0..6)).prop_map(|(floats, mut tail)| {
        let mut bytes: Vec<u8> = floats.iter().flat_map(|value| value.to_le_bytes()).collect();
        bytes.append(&mut tail);
        bytes
    });
    prop_oneof![prop::collection::vec(any::<u8>(), 0..130), prop::collection::vec(0..12_u8, 0..4), sized]
}

proptest! {
    /// Each request gets one reply, and the joints stay where an arm's can be.
    #[test]
    fn any_register_with_any_parameters_is_answered(
        mode in 0..8_u8,
        requests in prop::collection::vec((any::<u8>(), parameters()), 1..60),
    ) {
        let mut emulator = ArmEmulator::new(ArmEmulatorConfig::default());
        let (id, mut parser, mut now) = (emulator.connect(), FrameParser::default(), Duration::ZERO);
        let begin = [(11, vec![8, 1]), (19, vec![mode]), (12, vec![0])];
        let again = [(16, vec![]), (12, vec![0])];
        let asked = requests.into_iter().flat_map(|request| [request].into_iter().chain(again.clone()));
        for (transaction, (register, params)) in begin.into_iter().chain(asked).enumerate() {
            let mut bytes = Vec::new();
            Frame::new(transaction as u16, 3, &[&[register], &params]).unwrap().write(&mut bytes);
            emulator.receive(now, id, &bytes);
            now += Duration::from_millis(20);
            emulator.advance(now);
            bytes.clear();
            emulator.take(id, &mut bytes);
            let (mut bytes, mut replies) = (bytes.as_slice(), 0);
            while let Some(frame) = parser.next(&mut bytes) {
                if frame.transaction == transaction as u16 && frame.register() == register {
                    replies += 1;
                } else {
                    prop_assert_eq!(frame.register(), FEEDBACK);
                }
            }
            prop_assert!(replies == 1 || register == FEEDBACK, "{} replies of {}", replies, register);
            prop_assert!(emulator.joints().iter().all(|angle| angle.abs() < 7.0), "{:?}", emulator.joints());
        }
    }

    /// Whatever is asked for and whenever, what leaves is within the limits: the bench's ear holds each frame
    /// against them.
    #[test]
    fn no_target_outside_the_limits_leaves(
        asked in prop::collection::vec((0..30_u64, 0.0..0.06_f64, prop::array::uniform7(-1.0..1.0_f64)), 1..100),
    ) {
        let mut bench = Bench::ready();
        for (pause, size, direction) in asked {
            bench.run(pause);
            let from = bench.arm.sent().or(bench.arm.joints()).unwrap();
            let _ = bench.servo(std::array::from_fn(|joint| from[joint] + size * direction[joint]));
            if bench.fault().is_some() {
                bench.arm.start(bench.now).unwrap();
                bench.until(ArmState::Ready);
            }
        }
    }
}
