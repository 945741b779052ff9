//! Frames and bytes at random, through every driver, parser and emulator: none of them panics, none
//! grows without bound, and no torque passes the table.

use std::time::Duration;

use etude_emulators::{
    ArmEmulator, ArmEmulatorConfig, ConnectionId, HandEmulator, HandEmulatorConfig, ReportKind,
};
use etude_robot::allegro::{Hand, HandConfig, HandEvent, HandState, JointLoop, JointLoopConfig, PWM_LIMITS};
use etude_robot::can::CanFrame;
use etude_robot::keyboard::{Keyboard, KeyboardConfig, MidiParser};
use etude_robot::xarm::codec::FrameParser;
use etude_robot::xarm::report::ReportParser;
use etude_robot::xarm::{Arm, ArmConfig, ArmState};

use crate::dice::Dice;

/// Frames, and bytes, at random in each test.
const AMOUNT: u64 = 10_000_000;

/// Identifiers of the hand's messages, both ways (Wonik's "CAN Protocol v4.0").
const IDS: [u16; 24] = [
    0x100, 0x104, 0x180, 0x184, 0x188, 0x18C, 0x380, 0x384, 0x388, 0x38C, 0x204, 0x1A0, 0x200, 0x220, 0x080,
    0x084, 0x088, 0x08C, 0x0C0, 0x0E0, 0x0E4, 0x0E8, 0x0EC, 0x040,
];

fn frame(dice: &mut Dice) -> CanFrame {
    let id = match dice.below(8) {
        0 => dice.below(0x800) as u16,
        _ => IDS[dice.below(IDS.len() as u64) as usize] | u16::from(dice.chance(0.02)),
    };
    if dice.chance(0.2) {
        return CanFrame::remote(id).unwrap();
    }
    let length = if dice.chance(0.8) { 8 } else { dice.below(9) as usize };
    let mut data = dice.number().to_le_bytes();
    if dice.chance(0.5) {
        // Small angles and periods: what is believed goes farther into the driver.
        data.iter_mut().skip(1).step_by(2).for_each(|high| *high = 0);
    }
    if id == 0x200 && dice.chance(0.9) {
        // A healthy left hand of the fourth generation.
        data = [0, 4, 1, 1, 1, 30, dice.below(2) as u8, 0];
        return CanFrame::new(id, &data[..7]).unwrap();
    }
    CanFrame::new(id, &data[..length]).unwrap()
}

/// A time that mostly goes on by a little, sometimes stands, leaps, or goes back.
fn pass(now: Duration, dice: &mut Dice) -> Duration {
    match dice.below(1000) {
        0 => now.saturating_sub(Duration::from_millis(dice.below(100))),
        1 => now + Duration::from_millis(dice.below(5000)),
        _ => now + Duration::from_micros(dice.below(400)),
    }
}

#[test]
fn frames_at_random() {
    let mut dice = Dice::new(11);
    let mut hand = Hand::new(&HandConfig::default()).unwrap();
    let mut joints = JointLoop::new(&JointLoopConfig::default()).unwrap();
    let mut emulator = HandEmulator::new(&HandEmulatorConfig::default());
    let (mut now, mut out, mut answers) = (Duration::ZERO, Vec::new(), Vec::new());
    let (mut driven, mut ready, mut said) = (0u64, 0u64, 0u64);
    let (mut count, mut random) = (0u64, 0u64);
    while random < AMOUNT {
        count += 1;
        now = pass(now, &mut dice);
        if count % 4096 == 0 || dice.chance(0.002) {
            hand.start(now);
        }
        let frame = frame(&mut dice);
        // In between a healthy conversation, so that the driver gets to the end of its start.
        let healthy = count % 4096 < 1024;
        random += u64::from(!healthy);
        let event = if healthy {
            let mut last = HandEvent::Nothing;
            answers.clear();
            emulator.tick(now, &mut answers);
            for answer in out.drain(..) {
                emulator.receive(now, &answer, &mut answers);
            }
            for answer in &answers {
                if hand.receive(now, answer) == HandEvent::Positions {
                    last = HandEvent::Positions;
                }
            }
            last
        } else {
            hand.receive(now, &frame)
        };
        out.clear();
        let polled = hand.poll(now, &mut out);
        if event == HandEvent::Positions || polled == HandEvent::Positions {
            let reference = std::array::from_fn(|_| dice.signed() * 2.0);
            let wanted = joints.pwm(now, &hand.positions(), &reference, 1.0);
            let sent = hand.send_pwm(now, &wanted, &mut out);
            driven += u64::from(sent.iter().any(|pwm| *pwm != 0));
            assert!(sent.iter().zip(PWM_LIMITS).all(|(pwm, limit)| pwm.abs() <= limit), "{sent:?}");
        }
        ready += u64::from(hand.state() == HandState::Ready);
        if !healthy {
            emulator.receive(now, &frame, &mut answers);
            emulator.tick(now, &mut answers);
        }
        assert!(emulator.pwm().iter().zip(PWM_LIMITS).all(|(pwm, limit)| pwm.abs() <= limit));
        assert!(out.len() <= 64 && answers.len() <= 4096, "{} {}", out.len(), answers.len());
        said += (out.len() + answers.len()) as u64;
        answers.clear();
        if count % 65_536 == 0 {
            hand.stop(now, &mut out);
            emulator =
                HandEmulator::new(&HandEmulatorConfig { noise_counts: 2, ..HandEmulatorConfig::default() });
        }
    }
    println!(
        "{random} frames to hand and emulator: driver ready at {ready} of {count}, torques at {driven}, \
         {said} frames said"
    );
    assert!(driven > 0 && ready > 0, "the driver never got as far as torques");
}

/// Pieces of bytes that are mostly, but not quite, what an arm or its client says.
fn arm_bytes(dice: &mut Dice, transaction: &mut u16) -> Vec<u8> {
    if dice.chance(0.02) {
        let length = dice.below(64) as usize;
        return dice.bytes(length);
    }
    *transaction = transaction.wrapping_add(1);
    let body_len = 1 + dice.below(48) as usize;
    let mut body = dice.bytes(body_len);
    body[0] = match dice.below(4) {
        0 => dice.number() as u8,
        _ => [1, 2, 11, 12, 13, 14, 15, 16, 19, 21, 23, 25, 29, 30, 36, 41, 42, 43, 44, 254]
            [dice.below(20) as usize],
    };
    // Floats of a sensible size, or states without complaints.
    match dice.below(3) {
        0 => {
            let (values, _) = body[1..].as_chunks_mut::<4>();
            values.iter_mut().for_each(|value| *value = (dice.signed() as f32 * 3.0).to_le_bytes());
        }
        1 if body.len() > 1 => body[1] = dice.below(4) as u8,
        _ => {}
    }
    let protocol = if dice.chance(0.98) { 2 + dice.below(2) as u16 } else { dice.number() as u16 };
    let length = if dice.chance(0.99) { body.len() as u16 } else { dice.number() as u16 };
    let mut bytes: Vec<u8> = [*transaction, protocol, length].map(u16::to_be_bytes).concat();
    bytes.extend(body);
    bytes
}

/// Bytes as they are, or with a few bits flipped.
fn damage(bytes: &mut [u8], dice: &mut Dice) {
    if !bytes.is_empty() && dice.chance(0.1) {
        let at = dice.below(bytes.len() as u64) as usize;
        bytes[at] ^= 1 << dice.below(8);
    }
}

/// A healthy arm, one whose bytes are damaged on their way, and one that says anything.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Talk {
    Healthy,
    Damaged,
    Random,
}

#[test]
fn bytes_at_random_at_the_arm() {
    let mut dice = Dice::new(12);
    let new = || ArmEmulator::new(ArmEmulatorConfig::default());
    let mut emulator = new();
    let mut client: ConnectionId = emulator.connect();
    let mut arm = Arm::new(ArmConfig::default()).unwrap();
    let mut frames = FrameParser::default();
    let mut reports = ReportParser::default();
    let (mut now, mut bytes, mut sent) = (Duration::ZERO, 0u64, 0u64);
    let (mut transaction, mut round, mut ready, mut parsed, mut faults) = (0, 0u64, 0u64, 0u64, 0u64);
    let (mut out, mut back) = (Vec::new(), Vec::new());
    while bytes < AMOUNT {
        let talk = [Talk::Healthy, Talk::Damaged, Talk::Random, Talk::Random][(round / 512 % 4) as usize];
        if round % 2048 == 0 {
            emulator = new();
            client = emulator.connect();
        }
        if round % 2048 == 0 || talk != Talk::Healthy && dice.chance(0.02) {
            faults += u64::from(matches!(arm.state(), ArmState::Fault(_)));
            arm.disconnected(now);
            arm.connected(now);
            arm.start(now).unwrap();
        }
        round += 1;
        now = pass(now, &mut dice) + Duration::from_micros(500);
        let piece = arm_bytes(&mut dice, &mut transaction);
        let mut rest = &piece[..];
        while frames.next(&mut rest).is_some() {
            parsed += 1;
        }
        let mut rest = &piece[..];
        while reports.next(&mut rest).is_some() {
            parsed += 1;
        }
        if talk == Talk::Random {
            bytes += piece.len() as u64;
            emulator.receive(now, client, &piece);
            if dice.chance(0.5) { arm.receive_command(now, &piece) } else { arm.receive_report(now, &piece) }
        }
        if talk == Talk::Damaged {
            damage(&mut out, &mut dice);
        }
        emulator.receive(now, client, &out);
        for port in [None, Some(ReportKind::Real)] {
            back.clear();
            match port {
                None => emulator.take(client, &mut back),
                Some(kind) => emulator.take_reports(kind, &mut back),
            }
            if talk == Talk::Damaged {
                damage(&mut back, &mut dice);
            }
            if port.is_none() { arm.receive_command(now, &back) } else { arm.receive_report(now, &back) }
        }
        if arm.state() == ArmState::Ready {
            ready += 1;
            let mut joints = arm.sent().or(arm.joints()).unwrap();
            joints[dice.below(7) as usize] += 0.002 * dice.signed();
            let _ = arm.servo(now, joints);
        }
        out.clear();
        arm.poll(now, &mut out);
        if dice.chance(0.0005) {
            arm.stop(now, &mut out);
        }
        sent += out.len() as u64;
        assert!(out.len() < 512, "{}", out.len());
        assert!(emulator.joints().iter().all(|angle| angle.is_finite()), "{:?}", emulator.joints());
    }
    println!(
        "{bytes} bytes to arm and emulator: {parsed} frames and reports parsed, driver ready at {ready} of \
         {round}, {faults} faults, sent {sent} bytes"
    );
    assert!(ready > 1000 && parsed > 1000 && faults > 1000);
}

#[test]
fn bytes_at_random_at_the_keyboard() {
    let mut dice = Dice::new(13);
    let mut parser = MidiParser::new();
    let mut keyboard = Keyboard::new(&KeyboardConfig::default()).unwrap();
    let (mut now, mut bytes, mut events, mut changes) = (Duration::ZERO, 0u64, 0u64, Vec::new());
    let mut presses = 0u64;
    let mut down = [false; 49];
    while bytes < AMOUNT {
        now = pass(now, &mut dice);
        let length = dice.below(12) as usize;
        let mut piece = dice.bytes(length);
        if dice.chance(0.5) {
            // Mostly notes of the keyboard's own range.
            piece.iter_mut().for_each(|byte| *byte = if *byte < 40 { 0x90 } else { 30 + *byte % 64 });
        }
        bytes += piece.len() as u64;
        events += piece.iter().filter_map(|byte| parser.push(*byte)).count() as u64;
        changes.clear();
        match dice.below(2000) {
            0 => keyboard.disconnected(now, &mut changes),
            1 => keyboard.connected(now, &mut changes),
            2 => keyboard.acknowledge(),
            _ => keyboard.receive(now, &piece, &mut changes),
        }
        keyboard.poll(now, &mut changes);
        for change in &changes {
            // Presses and releases of a key alternate, whatever comes.
            let pressed = change.velocity > 0;
            presses += u64::from(pressed);
            assert_ne!(std::mem::replace(&mut down[change.key], pressed), pressed, "{change:?}");
        }
        let mask = (0..49).filter(|key| down[*key]).fold(0u64, |mask, key| mask | 1 << key);
        assert_eq!(keyboard.pressed(), mask);
        assert!(keyboard.warnings().count() < 64);
    }
    println!("{bytes} bytes to the keyboard's driver: {events} events, {presses} presses");
    assert!(presses > 0);
}
