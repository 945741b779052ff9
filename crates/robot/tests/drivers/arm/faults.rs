//! What the driver does when something is wrong: it sees it, stops the arm, and stays stopped.

use std::time::Duration;

use etude_emulators::ReportKind;
use etude_robot::xarm::codec::{Frame, Register, ReplyState};
use etude_robot::xarm::kinematics::ARM_JOINTS;
use etude_robot::xarm::{Arm, ArmConfig, ArmError, ArmFault, ArmState, SafetyBox, TargetError};

use super::bench::{Bench, home, smooth};

/// What to do to a streaming arm, and the fault that must follow.
type Mischief = (&'static str, fn(&mut Bench), fn(&ArmFault) -> bool);

const MISCHIEF: &[Mischief] = &[
    ("collision", |b| b.emulator.inject_error(31), |f| *f == ArmFault::Controller { code: Some(31) }),
    (
        "silent",
        |b| b.emulator.set_silent(true),
        |f| matches!(f, ArmFault::ReplyTimeout { register: "servo joints" }),
    ),
    ("mute", |b| b.emulator.set_mute(true), |f| *f == ArmFault::ReportStale),
    ("stuck", |b| b.emulator.set_stuck(true), |f| matches!(f, ArmFault::NotFollowing { joint: 1, .. })),
    ("gone", |b| b.arm.disconnected(b.now), |f| *f == ArmFault::Disconnected),
    (
        "another client",
        |b| {
            let other = b.emulator.connect();
            let mut bytes = Vec::new();
            Frame::new(1, 2, &[&[Register::SetMode as u8, 0]]).unwrap().write(&mut bytes);
            b.emulator.receive(b.now, other, &bytes);
        },
        |f| *f == ArmFault::NotReady,
    ),
    (
        "switched off",
        |b| {
            // Without a target on its way, only the reports tell.
            b.arm.manual(b.now, true).unwrap();
            b.until(ArmState::Manual);
            let other = b.emulator.connect();
            let mut bytes = Vec::new();
            Frame::new(1, 2, &[&[Register::MotionEnable as u8, 8, 0]]).unwrap().write(&mut bytes);
            b.emulator.receive(b.now, other, &bytes);
        },
        |f| matches!(f, ArmFault::UnexpectedState { state: 5, mode: 2 }),
    ),
    (
        "odd replies",
        |b| b.arm.receive_command(b.now, b"HTTP/1.1 400 Bad Request\r\n"),
        |f| matches!(f, ArmFault::ProtocolNonsense(_)),
    ),
    (
        "odd reports",
        |b| b.arm.receive_report(b.now, &[0xFF; 200]),
        |f| matches!(f, ArmFault::ProtocolNonsense(_)),
    ),
    (
        "not a number",
        |b| assert!(b.servo([f64::NAN; ARM_JOINTS]).is_err()),
        |f| *f == ArmFault::RefusedTarget(TargetError::NotFinite),
    ),
    (
        "beyond a limit",
        |b| {
            let mut target = b.arm.sent().unwrap();
            target[3] = -0.2;
            assert!(b.servo(target).is_err());
        },
        |f| matches!(f, ArmFault::RefusedTarget(TargetError::BeyondLimit(_))),
    ),
    (
        "too fast a joint",
        |b| {
            let mut target = b.arm.sent().unwrap();
            target[6] += 0.1;
            assert!(b.servo(target).is_err());
        },
        |f| matches!(f, ArmFault::RefusedTarget(TargetError::JointTooFast { joint: 7, .. })),
    ),
    (
        "too fast a flange",
        |b| {
            // 5 ms at 2.5 rad/s, and the flange is 0.52 m from the axis.
            let mut target = b.arm.sent().unwrap();
            target[0] += 0.0125;
            assert!(b.servo(target).is_err());
        },
        |f| matches!(f, ArmFault::RefusedTarget(TargetError::FlangeTooFast { .. })),
    ),
];

#[test]
fn every_fault_is_seen_stops_the_arm_and_stays() {
    for reports in [ReportKind::Real, ReportKind::Control] {
        every_fault_on(reports);
    }
}

fn every_fault_on(reports: ReportKind) {
    for (name, mischief, expected) in MISCHIEF {
        let mut bench = Bench::ready_on(reports);
        let path = |time: f64| {
            let mut joints = home();
            joints[0] += 1.2 * smooth(time / 2.0);
            joints
        };
        bench.stream(1.0, path).unwrap();
        mischief(&mut bench);
        let mut begun = bench.now;
        for tick in 0..200 {
            let _ = bench.servo(path(1.0 + f64::from(tick) * 0.005));
            bench.run(5);
            if bench.fault().is_none() {
                begun = bench.now;
            }
        }
        let fault = bench.fault().unwrap_or_else(|| panic!("{name}: no fault"));
        assert!(expected(&fault), "{name}: {fault:?}");
        assert!(fault.to_string().len() > 40, "{name}: {fault}");
        // Without a connection nothing is sent; otherwise a stop in the same moment.
        if fault != ArmFault::Disconnected {
            assert!(bench.wire.stops() > 0, "{name}");
            let last = bench.wire.frames.iter().rposition(|frame| frame.register() == 29).unwrap();
            assert!(bench.wire.frames[last..].iter().any(|frame| frame.register() == 12), "{name}");
            assert!(bench.emulator.state() >= 4, "{name}");
        }
        assert!(bench.now - begun > Duration::from_millis(100), "{name}");
        assert!(matches!(bench.servo(home()), Err(ArmError::NotNow(ArmState::Fault(_)))), "{name}");
        let frames = bench.wire.frames.iter().filter(|frame| frame.register() == 29).count();
        bench.run(300);
        assert_eq!(frames, bench.wire.frames.iter().filter(|frame| frame.register() == 29).count(), "{name}");

        // The operator mends it, and starts again.
        bench.emulator.set_silent(false);
        bench.emulator.set_mute(false);
        bench.emulator.set_stuck(false);
        if matches!(fault, ArmFault::Disconnected | ArmFault::ProtocolNonsense(_)) {
            if fault == ArmFault::Disconnected {
                assert!(bench.arm.start(bench.now).is_err());
            }
            bench.emulator.disconnect(bench.id);
            bench.id = bench.emulator.connect();
            bench.arm.connected(bench.now);
            assert!(bench.fault().is_some(), "{name}: a new connection does not clear a fault");
        }
        bench.run(50);
        bench.arm.start(bench.now).unwrap();
        bench.until(ArmState::Ready);
    }
}

/// A controller that repeats itself while nothing moves: only a report with a time shows it.
#[test]
fn a_repeated_report_is_none_where_it_carries_a_time() {
    for (reports, size, seen) in [(ReportKind::Real, 87, false), (ReportKind::Control, 784, true)] {
        let mut bench = Bench::ready_on(reports);
        bench.servo(home()).unwrap();
        bench.run(200);
        let mut bytes = Vec::new();
        bench.now += Duration::from_millis(20);
        bench.emulator.advance(bench.now);
        bench.emulator.take_reports(reports, &mut bytes);
        let last = bytes.split_off(bytes.len() - size);
        bench.arm.receive_report(bench.now, &last);
        bench.repeated = Some(last);
        let stops = bench.wire.stops();
        bench.run(98);
        assert_eq!((bench.fault(), bench.wire.stops()), (None, stops));
        bench.run(7);
        let fault = seen.then_some(ArmFault::ReportStale);
        assert_eq!((bench.fault(), bench.wire.stops() > stops), (fault, seen), "{reports:?}");
    }
}

#[test]
fn a_pressed_emergency_button_is_named() {
    let mut bench = Bench::new();
    bench.emulator.inject_error(1);
    bench.arm.start(bench.now).unwrap();
    bench.until(ArmState::Fault(ArmFault::Controller { code: Some(1) }));
    assert!(bench.now < Duration::from_millis(500), "at once");
    assert!(bench.fault().unwrap().to_string().contains("release the button"));
    bench.emulator.inject_error(0);
    bench.arm.start(bench.now).unwrap();
    bench.until(ArmState::Ready);
}

#[test]
fn an_old_report_does_not_make_it_ready() {
    let mut bench = Bench::ready();
    bench.emulator.set_mute(true);
    bench.arm.start(bench.now).unwrap();
    while bench.arm.state() == ArmState::Starting {
        bench.step();
    }
    assert_eq!(bench.fault(), Some(ArmFault::ReportStale));
}

#[test]
fn another_mode_is_seen_even_if_the_arm_is_ready_in_it() {
    let mut bench = Bench::ready();
    let other = bench.emulator.connect();
    let mut bytes = Vec::new();
    Frame::new(1, 2, &[&[Register::SetMode as u8, 0]]).unwrap().write(&mut bytes);
    Frame::new(2, 2, &[&[Register::SetState as u8, 0]]).unwrap().write(&mut bytes);
    bench.emulator.receive(bench.now, other, &bytes);
    bench.until(ArmState::Fault(ArmFault::UnexpectedState { state: 2, mode: 0 }));
}

#[test]
fn a_reply_must_fit_its_request() {
    type Forge = fn(&Frame) -> Option<Frame>;
    type Expected = fn(&ArmFault) -> bool;
    let forgeries: [(Forge, Expected); 4] = [
        (
            |asked| Frame::new(asked.transaction, 2, &[&[29, 0]]),
            |f| matches!(f, ArmFault::ProtocolNonsense(_)),
        ),
        (
            |asked| Frame::new(asked.transaction, 3, &[&[30, 0]]),
            |f| matches!(f, ArmFault::ProtocolNonsense(_)),
        ),
        (|asked| Frame::new(asked.transaction, 3, &[&[29]]), |f| matches!(f, ArmFault::ProtocolNonsense(_))),
        (
            |asked| Frame::new(asked.transaction, 3, &[&[29, 8]]),
            |f| matches!(f, ArmFault::CommandRejected { .. }),
        ),
    ];
    for (forge, expected) in forgeries {
        let mut bench = Bench::ready();
        bench.servo(bench.arm.joints().unwrap()).unwrap();
        bench.held = true;
        bench.step();
        let asked = *bench.wire.frames.last().unwrap();
        let mut bytes = Vec::new();
        forge(&asked).unwrap().write(&mut bytes);
        bench.arm.receive_command(bench.now, &bytes);
        let fault = bench.fault().unwrap();
        assert!(expected(&fault), "{fault:?}");
    }
}

/// From another terminal, in the middle of our own changes of mode.
#[test]
fn a_stop_from_elsewhere_during_a_change_of_mode_is_a_fault() {
    type Begin = fn(&mut Bench);
    let ways: [(&str, usize, Begin); 2] = [
        ("by hand", 1, |b| b.arm.manual(b.now, true).unwrap()),
        ("back", 1, |b| {
            b.arm.manual(b.now, true).unwrap();
            b.until(ArmState::Manual);
            b.arm.manual(b.now, false).unwrap();
        }),
    ];
    for (name, changes, begin) in ways {
        let mut late = 0;
        for millis in 0..1500 {
            let mut bench = Bench::ready();
            begin(&mut bench);
            bench.run(millis);
            let over = !matches!(bench.arm.state(), ArmState::Starting);
            let other = bench.emulator.connect();
            let mut bytes = Vec::new();
            Frame::new(1, 2, &[&[Register::SetState as u8, 4]]).unwrap().write(&mut bytes);
            bench.emulator.receive(bench.now, other, &bytes);
            bench.run(200);
            // An order on its way when the stop comes undoes it, for two round trips of a change of
            // mode: who stops looks twice (`Stopper`).
            if bench.fault().is_none() {
                late += 1;
                continue;
            }
            assert!(
                matches!(
                    bench.fault(),
                    Some(ArmFault::UnexpectedState { state: 4, .. } | ArmFault::NotReady)
                ),
                "{name} after {millis} ms: {:?}",
                bench.fault()
            );
            assert!(bench.emulator.state() >= 4, "{name} after {millis} ms");
            if over {
                break;
            }
        }
        assert!(late <= 2 * changes, "{name}: {late} stops were undone");
    }
}

/// A start ends in a fault that names the register of which the arm would have nothing.
#[test]
fn a_setting_that_is_refused_is_a_failed_start_that_names_it() {
    let safety_box = SafetyBox([[200, 700], [-450, 450], [100, 800]]);
    for (register, name) in [
        (31, "TCP jerk"),
        (32, "TCP acceleration"),
        (33, "joint jerk"),
        (34, "joint acceleration"),
        (36, "payload"),
        (52, "safety box"),
        (59, "safety box on or off"),
    ] {
        // Refused outright, or, of those that wait in the queue, not taken in.
        for bits in [ReplyState::INVALID, ReplyState::NOT_READY] {
            if bits == ReplyState::NOT_READY && !(31..=34).contains(&register) {
                continue;
            }
            let mut bench = Bench::new();
            bench.arm = Arm::new(ArmConfig { box_mm: Some(safety_box), ..ArmConfig::default() }).unwrap();
            bench.arm.connected(bench.now);
            bench.arm.start(bench.now).unwrap();
            bench.spoil = Some((register, bits));
            bench.run(1000);
            assert_eq!(bench.fault(), Some(ArmFault::CommandRejected { register: name }), "{register}");
            assert!(bench.fault().unwrap().to_string().contains(name) && bench.emulator.state() == 4);
            bench.spoil = None;
            bench.arm.start(bench.now).unwrap();
            bench.until(ArmState::Ready);
        }
    }
}

/// A reply proves nothing: another program takes the box away as soon as it is set.
#[test]
fn a_box_that_is_not_there_is_a_failed_start() {
    let safety_box = SafetyBox([[200, 700], [-450, 450], [100, 800]]);
    let off: &[u8] = &[59, 0];
    let other =
        [&[52][..], [700_i32, 200, 450, -450, 800, 101].map(i32::to_le_bytes).as_flattened()].concat();
    for undo in [off, &other] {
        let mut bench = Bench::new();
        bench.arm = Arm::new(ArmConfig { box_mm: Some(safety_box), ..ArmConfig::default() }).unwrap();
        bench.arm.connected(bench.now);
        bench.arm.start(bench.now).unwrap();
        while bench.wire.frames.last().is_none_or(|frame| frame.register() != 59) {
            bench.step();
        }
        let somebody = bench.emulator.connect();
        let mut bytes = Vec::new();
        Frame::new(1, 2, &[undo]).unwrap().write(&mut bytes);
        bench.emulator.receive(bench.now, somebody, &bytes);
        bench.run(200);
        assert_eq!(bench.fault(), Some(ArmFault::CommandRejected { register: "safety box" }));
    }
}
