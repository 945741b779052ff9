//! Bytes and targets that make no sense.

use std::time::Duration;

use etude_emulators::ReportKind;
use etude_robot::xarm::ArmState;
use etude_robot::xarm::codec::{Frame, Register};
use etude_robot::xarm::kinematics::ARM_JOINTS;
use proptest::prelude::*;
use rand::SeedableRng as _;
use rand_pcg::Pcg64;

use super::bench::{Bench, home};

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
        let mut target: [f64; ARM_JOINTS] =
            bench.arm.sent().unwrap_or(home()).map(|angle| angle + random.random_range(-0.02..0.02));
        if random.random_range(0..50) == 0 {
            let odd = [f64::NAN, f64::INFINITY, 7.0, -7.0, 1e300, 0.0];
            target[random.random_range(0..ARM_JOINTS)] = odd[random.random_range(0..odd.len())];
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

proptest! {
    /// Whatever is asked for and whenever, what leaves is within the limits: the bench's ear holds
    /// each frame against them.
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
