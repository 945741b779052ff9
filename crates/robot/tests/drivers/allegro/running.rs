//! A hand that is ready: the loop, the stop, and every fault.

use std::time::Duration;

use etude_emulators::HandEmulatorConfig;
use etude_robot::allegro::{
    DeviceId, Finger, Hand, HandConfig, HandFault, HandMessage, HandSide, HandState, HostMessage, Request,
    StatusBits, WIRE_JOINTS, counts_from_rad,
};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::{Bench, TICK, ms, zero_torques};

#[test]
fn the_loop_settles_at_a_pose() {
    for (noise_counts, clock_skew) in [(0, 0.0), (8, 0.001), (8, -0.001)] {
        let emulator =
            HandEmulatorConfig { noise_counts, clock_skew, seed: 7, ..HandEmulatorConfig::default() };
        let mut bench = Bench::new(&HandConfig::default(), &emulator);
        bench.start();
        let (ticks, start) = (bench.ticks, bench.now);
        bench.run(ms(3000));
        assert!(bench.worst_error() < 0.002, "{}", bench.worst_error());
        // Quiet: no joint is shaken against its neighbour's noise.
        assert!(bench.free.positions().iter().all(|rad| rad.is_finite()));
        let rate = f64::from(bench.ticks - ticks) / (bench.now - start).as_secs_f64();
        assert!((rate - 1000.0 / 3.0 * (1.0 + clock_skew)).abs() < 1.0, "{rate}");
    }
}

#[test]
fn the_same_inputs_give_the_same_frames() {
    let run = || {
        let emulator = HandEmulatorConfig { noise_counts: 5, seed: 3, ..HandEmulatorConfig::default() };
        let mut bench = Bench::new(&HandConfig::default(), &emulator);
        bench.start();
        bench.run(ms(500));
        bench.sent
    };
    assert_eq!(run(), run());
}

#[test]
fn a_hand_is_told_to_let_go_until_it_confirms_it() {
    let mut bench = Bench::ready();
    // Nothing that is sent is heard for 350 ms.
    let until = bench.now + ms(350);
    bench.heard = Box::new(move |now, _| now >= until);
    let mut out = vec![];
    bench.hand.stop(bench.now, &mut out);
    bench.to_hand.extend(out);
    bench.run(ms(340));
    assert!(!bench.hand.has_confirmed_release() && bench.emulator.servo_on(), "nothing was heard");
    bench.run(ms(160));
    assert!(bench.hand.has_confirmed_release() && !bench.emulator.servo_on());
    bench.sent.clear();
    bench.run(ms(500));
    assert!(bench.sent.is_empty(), "then it is quiet: another controller may come");
}

#[test]
fn lost_frames_neither_stall_nor_shake_the_loop() {
    let mut bench = Bench::ready();
    let mut random = Pcg64::seed_from_u64(5);
    bench.arrives = Box::new(move |_, frame| frame.id() >= 0x100 || random.random_bool(0.9));
    let ticks = bench.ticks;
    bench.run(ms(3000));
    assert_eq!(bench.hand.state(), HandState::Ready);
    assert!((990..=1001).contains(&(bench.ticks - ticks)), "{}", bench.ticks - ticks);
    assert!(bench.worst_error() < 0.002, "{}", bench.worst_error());
}

#[test]
fn stop_is_allowed_always_and_often() {
    let mut stopped = zero_torques(3);
    stopped.extend([
        HostMessage::ServoOff,
        HostMessage::Request(Request::Information),
        HostMessage::Positions(0),
    ]);
    let mut hand = Hand::new(&HandConfig::default()).unwrap();
    for _ in 0..2 {
        let mut out = vec![];
        hand.stop(ms(1), &mut out);
        let said: Vec<_> =
            out.iter().map(|frame| HostMessage::decode(DeviceId::default(), frame).unwrap()).collect();
        assert_eq!((said, hand.state()), (stopped.clone(), HandState::Stopped));
    }
    let mut bench = Bench::ready();
    bench.run(ms(200));
    let mut out = vec![];
    bench.hand.stop(bench.now, &mut out);
    assert!(!bench.hand.has_confirmed_release());
    bench.to_hand.extend(out);
    bench.sent.clear();
    bench.run(ms(500));
    assert!(bench.hand.has_confirmed_release());
    assert_eq!(
        (bench.sent.len(), bench.emulator.pwm(), bench.emulator.servo_on()),
        (0, [0; WIRE_JOINTS], false)
    );
    // And a new start is a new start.
    bench.start();
    assert_eq!(bench.hand.state(), HandState::Ready);
}

/// Runs a ready hand, applies a change, and gives the fault; the hand must have been let go at once
/// and stay so.
fn fault_after(change: impl FnOnce(&mut Bench)) -> HandFault {
    let mut bench = Bench::ready();
    bench.run(ms(300));
    bench.sent.clear();
    change(&mut bench);
    while bench.hand.state() == HandState::Ready && bench.now < ms(5000) {
        bench.step();
    }
    let HandState::Fault(fault) = bench.hand.state() else { panic!("{:?}", bench.hand.state()) };
    // At most one step between the fault and its frames: three times zero, then OFF.
    let at = bench.now;
    bench.step();
    let said = bench.said(at);
    let off = said.iter().position(|message| *message == HostMessage::ServoOff).unwrap();
    assert_eq!(said[..=off][off.saturating_sub(12)..off], zero_torques(3));
    let after = bench.now;
    bench.run(ms(1000));
    assert_eq!(bench.hand.state(), HandState::Fault(fault), "latched");
    // Again and again, and nothing else.
    let said = bench.said(after);
    assert_eq!(said.iter().filter(|message| **message == HostMessage::ServoOff).count(), 10);
    let is_release = |message: &HostMessage| match message {
        HostMessage::ServoOff | HostMessage::Request(Request::Information) => true,
        message => zero_torques(1).contains(message),
    };
    assert!(said.iter().all(is_release));
    let mut out = vec![];
    assert_eq!(bench.hand.send_pwm(bench.now, &[100.0; WIRE_JOINTS], &mut out), [0; WIRE_JOINTS]);
    assert!(out.is_empty());
    assert!(!fault.to_string().is_empty());
    fault
}

#[test]
fn faults_while_running() {
    let stale = fault_after(|bench| bench.arrives = Box::new(|_, frame| frame.id() != 0x88));
    let HandFault::PositionsStale { finger: 2, age } = stale else { panic!("{stale:?}") };
    assert!((ms(15)..=ms(16)).contains(&age), "{age:?}");
    let silent = fault_after(|bench| bench.arrives = Box::new(|_, frame| frame.id() != 0x200));
    assert!(matches!(silent, HandFault::InformationStale { .. }), "{silent:?}");
    let off = fault_after(|bench| {
        let mut none = vec![];
        bench.emulator.receive(bench.now, &HostMessage::ServoOff.encode(DeviceId::default()), &mut none);
    });
    assert_eq!(off, HandFault::ServoOff);
    let hot = fault_after(|bench| bench.emulator.config_mut().board_celsius = 90);
    assert_eq!(hot, HandFault::BoardHot { celsius: 90, limit: 70 });
    let hot = fault_after(|bench| bench.emulator.config_mut().joint_celsius[13] = 80);
    assert_eq!(hot, HandFault::JointHot { joint: 13, celsius: 80, limit: 65 });
    let reported = fault_after(|bench| bench.emulator.config_mut().fault_bits = StatusBits::INTERNAL);
    assert_eq!(reported, HandFault::Reported { bits: StatusBits::INTERNAL });
    // Another hand is plugged in.
    let other = fault_after(|bench| bench.emulator.config_mut().side = HandSide::Right);
    assert_eq!(other, HandFault::WrongSide { found: HandSide::Right });
    // The cable of the whole bus.
    let cut = fault_after(|bench| bench.arrives = Box::new(|_, _| false));
    assert!(matches!(cut, HandFault::PositionsStale { .. }), "{cut:?}");
}

#[test]
fn a_hand_that_ignores_off_is_let_go_all_the_same() {
    let config = HandEmulatorConfig { off_cuts: false, ..HandEmulatorConfig::default() };
    let mut bench = Bench::new(&HandConfig::default(), &config);
    bench.start();
    bench.run(ms(20));
    assert_ne!(bench.emulator.pwm(), [0; WIRE_JOINTS]);
    bench.arrives = Box::new(|_, _| false);
    // The frames of the fault are lost too; the repeats are not.
    bench.heard = Box::new(|now, _| now > ms(300));
    bench.run(ms(200));
    assert!(matches!(bench.hand.state(), HandState::Fault(_)));
    assert_ne!(bench.emulator.pwm(), [0; WIRE_JOINTS], "the last torque is held");
    bench.run(ms(200));
    assert_eq!((bench.emulator.pwm(), bench.emulator.servo_on()), ([0; WIRE_JOINTS], true));
}

/// A finger's position frames with one joint replaced.
fn with_joint(hand: &mut Hand, now: Duration, counts: [i16; 4]) -> HandState {
    let message = HandMessage::Position { finger: Finger::Middle, counts };
    let _ = hand.receive(now, &message.encode(DeviceId::default()));
    hand.state()
}

#[test]
fn encoders_that_cannot_be_right() {
    let mut bench = Bench::ready();
    bench.run(ms(1500));
    let rest = bench.hand.positions();
    let counts: [i16; 4] = std::array::from_fn(|joint| counts_from_rad(rest[4 + joint]));
    // One wild reading is left out, and so are two.
    let mut hand = bench.hand.clone();
    for (after, wild) in [(3, 25_000), (6, -20_000)] {
        let now = bench.now + ms(after);
        assert_eq!(with_joint(&mut hand, now, [counts[0], counts[1], wild, counts[3]]), HandState::Ready);
        assert!((hand.positions()[6] - rest[6]).abs() < 1e-3);
    }
    assert_eq!(with_joint(&mut hand, bench.now + ms(9), counts), HandState::Ready);
    // Three in a row are a fault: outside the stops, or a jump.
    for (wild, range) in [(32_000, true), (counts[2] - 9000, false)] {
        let mut hand = bench.hand.clone();
        for n in 1..=3 {
            with_joint(&mut hand, bench.now + ms(3 * n), [counts[0], counts[1], wild, counts[3]]);
        }
        match hand.state() {
            HandState::Fault(HandFault::EncoderRange { joint: 6, rad }) if range => assert!(rad > 2.8),
            HandState::Fault(HandFault::EncoderJump { joint: 6, jump_rad, within }) if !range => {
                assert!((jump_rad + 0.8).abs() < 0.01 && within <= ms(12), "{jump_rad} {within:?}");
            }
            state => panic!("{state:?}"),
        }
        assert!((hand.positions()[6] - rest[6]).abs() < 1e-3, "the last believed angle stands");
    }
    // The fastest motion that any source knows, two periods delivered at once, is believed.
    let mut hand = bench.hand.clone();
    for n in 1..=10i16 {
        let now = bench.now + ms(6 * (n as u64).div_ceil(2));
        with_joint(&mut hand, now, [counts[0], counts[1], counts[2] + n * counts_from_rad(0.039), counts[3]]);
    }
    assert_eq!(hand.state(), HandState::Ready);
    let shift = hand.positions()[6] - rest[6];
    assert!((shift - 0.39).abs() < 2e-3, "every reading counted: {shift}");
}

#[test]
fn a_torque_that_nobody_renews_is_not_held() {
    let mut bench = Bench::ready();
    bench.run(ms(10));
    assert_ne!(bench.emulator.pwm(), [0; WIRE_JOINTS]);
    bench.attended = false;
    let from = bench.now;
    bench.run(ms(60));
    assert_eq!((bench.emulator.pwm(), bench.hand.state()), ([0; WIRE_JOINTS], HandState::Ready));
    let torques =
        bench.said(from + TICK).into_iter().filter(|said| matches!(said, HostMessage::Torque { .. }));
    assert_eq!(torques.collect::<Vec<_>>(), zero_torques(1), "once");
}
