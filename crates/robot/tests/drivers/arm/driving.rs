//! What the driver does when all is well.

use etude_emulators::{ArmEmulatorConfig, ReportKind};
use etude_robot::xarm::codec::{FEEDBACK, Frame, floats};
use etude_robot::xarm::kinematics::{self, ARM_JOINTS};
use etude_robot::xarm::{Arm, ArmConfig, ArmError, ArmFault, ArmState, SafetyBox, TargetError};

use super::bench::{Bench, MS, apart, flange_m, home, over_keys, smooth};

#[test]
fn it_starts_and_knows_the_arm() {
    let mut bench = Bench::new();
    assert_eq!(bench.arm.state(), ArmState::Stopped);
    bench.run(50);
    assert!(bench.wire.frames.is_empty(), "nothing is sent before it is started");
    bench.arm.start(bench.now).unwrap();
    assert_eq!(bench.arm.state(), ArmState::Starting);
    bench.until(ArmState::Ready);
    let order: Vec<u8> = bench.wire.frames.iter().map(Frame::register).collect();
    assert_eq!(order[..11], [1, 2, 16, 17, 11, 36, 37, 19, 12, 15, 13]);
    let limits = order.iter().position(|register| *register == 31).unwrap();
    assert!(order[11..limits].iter().all(|register| *register == 13), "{order:?}");
    assert_eq!(order[limits..limits + 8], [31, 32, 33, 34, 19, 12, 15, 13]);
    // From firmware 1.8.6 on with keep-alive, as the official SDK does.
    assert!(bench.wire.frames[0].protocol == 2 && bench.wire.frames[1..].iter().all(|f| f.protocol == 3));
    assert_eq!(bench.arm.version().unwrap().firmware, (2, 4, 0));
    assert_eq!(bench.arm.serial(), Some("XS130424A01A08"));
    assert!(apart(&bench.arm.joints().unwrap(), &home()) < 1e-6);
    assert!(bench.now - bench.arm.joints_at().unwrap() <= 10 * MS);
    let pose = bench.arm.pose().unwrap();
    assert!((pose.position_m.x - 0.524494).abs() < 1e-5);
    assert_eq!((bench.emulator.state(), bench.emulator.mode()), (2, 1));
    // What it was told about the payload has arrived.
    let report = bench.reported();
    assert_eq!(floats(&report[115..]), Some([1.091, -9.72, 18.38, 157.69]));
    assert_eq!((report[88], report[131]), (0x7F, 3), "motors, sensitivity to collisions");
}

#[test]
fn limits_and_box_arrive_in_the_arms_units() {
    let config = ArmConfig {
        tcp_jerk_m_s3: 3.0,
        tcp_acceleration_m_s2: 4.0,
        joint_jerk_rad_s3: 50.0,
        joint_acceleration_rad_s2: 1.5,
        box_mm: Some(SafetyBox([[200, 700], [-450, 460], [100, 800]])),
        ..ArmConfig::default()
    };
    let mut bench = Bench::new();
    bench.arm = Arm::new(config).unwrap();
    bench.arm.connected(bench.now);
    bench.arm.start(bench.now).unwrap();
    bench.until(ArmState::Ready);
    // Little-endian floats of mm and rad; six integers of mm, highest and lowest of each axis
    // (registers 52, 35).
    let params = |register: u8| {
        let said = bench.wire.frames.iter().find(|frame| frame.register() == register);
        said.unwrap().params().to_vec()
    };
    let float = |register: u8| f32::from_le_bytes(params(register).try_into().unwrap());
    assert_eq!([31, 32, 33, 34].map(float), [3000.0, 4000.0, 50.0, 1.5]);
    let sides: Vec<u8> = [700_i32, 200, 460, -450, 800, 100].iter().flat_map(|mm| mm.to_le_bytes()).collect();
    assert_eq!((params(52), params(59), params(35)), (sides, vec![1], vec![0; 24]));
    assert!(params(53).is_empty(), "the box is read back");
    let limits: [f32; 10] = floats(&bench.reported()[181..]).unwrap();
    assert_eq!([limits[0], limits[2], limits[5], limits[7]], [3000.0, 4000.0, 50.0, 1.5]);
}

#[test]
fn without_a_box_nothing_is_said_about_one() {
    let bench = Bench::ready();
    assert!(bench.wire.frames.iter().all(|frame| ![35, 52, 53, 59].contains(&frame.register())));
}

#[test]
fn nothing_is_sent_outside_the_box() {
    // The paper's home is at x 524, y 0, z 585 mm.
    let safety_box = SafetyBox([[300, 700], [-200, 200], [100, 700]]);
    let has_box = || {
        let mut bench = Bench::new();
        bench.arm = Arm::new(ArmConfig { box_mm: Some(safety_box), ..ArmConfig::default() }).unwrap();
        bench.arm.connected(bench.now);
        bench.arm.start(bench.now).unwrap();
        bench
    };
    let mut bench = has_box();
    bench.until(ArmState::Ready);
    let mut outside = home();
    outside[0] += 0.5;
    // A stream out of the box ends before the controller minds.
    let led = bench.stream(2.0, |time| {
        let mut joints = home();
        joints[0] += 0.8 * smooth(time / 2.0);
        joints
    });
    let Err(ArmError::Fault(fault @ ArmFault::RefusedTarget(TargetError::OutsideBox(_)))) = led else {
        panic!("{led:?}");
    };
    assert!(fault.to_string().contains("y of the flange"), "{fault}");
    bench.run(1000);
    assert_eq!((bench.emulator.error(), bench.emulator.state()), (0, 4));
    // From outside nothing starts, and it says why.
    let mut bench = has_box();
    bench.emulator.place(outside);
    bench.run(6000);
    let fault = bench.fault().unwrap();
    assert!(
        matches!(fault, ArmFault::OutsideBox(_))
            && fault.to_string().contains("guide it inside with UFACTORY Studio"),
        "{fault}"
    );
    assert!(bench.wire.targets.is_empty() && bench.wire.frames.iter().all(|frame| frame.register() != 59));
}

#[test]
fn old_firmware_is_spoken_to_in_the_old_way() {
    let mut bench =
        Bench::with(ArmEmulatorConfig { firmware: "v1.8.5".into(), ..ArmEmulatorConfig::default() });
    bench.arm.start(bench.now).unwrap();
    bench.until(ArmState::Ready);
    assert!(bench.wire.frames.iter().all(|frame| frame.protocol == 2));
    let modes = bench.wire.frames.iter().filter(|frame| frame.register() == 19);
    assert_eq!(modes.map(|mode| mode.params().to_vec()).collect::<Vec<_>>(), [[0], [1]]);
}

#[test]
fn it_follows_the_slide() {
    let mut bench = Bench::new();
    let near = kinematics::inverse(&over_keys(0.5), &home()).unwrap();
    let mut begin = kinematics::inverse(&over_keys(0.0), &near).unwrap();
    bench.emulator.place(begin);
    bench.arm.start(bench.now).unwrap();
    bench.until(ArmState::Ready);
    let sent = bench.wire.streamed();
    // C1 to C5 and back, the fastest moment at 0.84 m/s.
    let (mut worst, mut joints) = (0.0_f64, bench.arm.joints().unwrap());
    begin = joints;
    for tick in 0..620 {
        let time = f64::from(tick) * 0.005 / 1.5;
        let share = if time < 1.0 { smooth(time) } else { 1.0 - smooth(time - 1.0) };
        joints = kinematics::inverse(&over_keys(share), &joints).unwrap();
        bench.servo(joints).unwrap();
        bench.run(5);
        worst = worst.max(apart(&joints, &bench.emulator.joints()));
    }
    bench.run(500);
    assert_eq!(bench.arm.state(), ArmState::Ready);
    assert!(apart(&bench.emulator.joints(), &begin) < 1e-3, "it came back");
    assert!((0.02..0.3).contains(&worst), "{worst}");
    // One at each tick, and the last one again and again.
    assert_eq!((bench.wire.streamed() - sent, bench.wire.stops()), (620 + 100, 0));
    assert!(apart(&bench.arm.sent().unwrap(), &joints) < 1e-9);
}

#[test]
fn it_is_led_by_hand() {
    let mut bench = Bench::ready();
    let mut elsewhere = home();
    elsewhere[1] += 0.4;
    bench.arm.manual(bench.now, true).unwrap();
    assert!(matches!(bench.servo(home()), Err(ArmError::NotNow(ArmState::Starting))));
    bench.until(ArmState::Manual);
    bench.emulator.place(elsewhere);
    bench.run(100);
    assert!(apart(&bench.arm.joints().unwrap(), &elsewhere) < 1e-6);
    assert!(bench.arm.manual(bench.now, true).is_err());
    bench.arm.manual(bench.now, false).unwrap();
    bench.until(ArmState::Ready);
    bench.run(50);
    bench.servo(elsewhere).unwrap();
    bench.run(50);
    assert_eq!(bench.arm.state(), ArmState::Ready);
}

#[test]
fn stop_stops_whatever_is_going_on() {
    // Before the start, while starting, ready, streaming, by hand, and after a fault.
    for case in 0..6 {
        let mut bench = if case < 2 { Bench::new() } else { Bench::ready() };
        match case {
            1 => bench.arm.start(bench.now).unwrap(),
            3 => bench
                .stream(0.2, |time| {
                    [home()[0] + time, home()[1], 0.0, home()[3], home()[4], home()[5], home()[6]]
                })
                .unwrap(),
            4 => bench.arm.manual(bench.now, true).unwrap(),
            5 => assert!(bench.servo([f64::NAN; ARM_JOINTS]).is_err()),
            _ => {}
        }
        // So that a reply is outstanding.
        bench.emulator.set_silent(true);
        bench.run(7);
        bench.emulator.set_silent(false);
        let before = bench.wire.stops();
        bench.stop();
        bench.stop();
        assert_eq!(bench.wire.stops(), before + 2, "case {case}: at once, and each time");
        assert_eq!(bench.emulator.state(), 4, "case {case}");
        bench.run(1000);
        let rests = bench.emulator.joints();
        bench.run(200);
        assert_eq!(rests, bench.emulator.joints(), "case {case}");
        assert!(bench.wire.stops() <= before + 4, "case {case}: the reports show it");
        assert_eq!(bench.fault().is_some(), case == 5, "case {case}");
        if case != 5 {
            assert_eq!(bench.arm.state(), ArmState::Stopped, "case {case}");
        }
        bench.arm.start(bench.now).unwrap();
        bench.until(ArmState::Ready);
    }
}

#[test]
fn a_stop_that_is_not_obeyed_is_repeated() {
    let mut bench = Bench::ready();
    let mut bytes = Vec::new();
    bench.arm.stop(bench.now, &mut bytes);
    // That one got lost.
    bench.run(450);
    assert_eq!(bench.wire.stops(), 1, "the second one arrived, and the reports show it");
    assert_eq!((bench.emulator.state(), bench.arm.state()), (4, ArmState::Stopped));
}

/// What to do to a streaming arm, and the fault that must follow.

#[test]
fn slow_replies_skip_ticks_and_one_request_is_outstanding() {
    let mut bench = Bench::ready();
    let mut held = Vec::new();
    let before = bench.wire.streamed();
    bench.servo(bench.arm.joints().unwrap()).unwrap();
    let mut outstanding = 0;
    for tick in 0..2000_u64 {
        bench.now += MS;
        bench.emulator.advance(bench.now);
        let mut bytes = Vec::new();
        bench.emulator.take_reports(ReportKind::Real, &mut bytes);
        bench.arm.receive_report(bench.now, &bytes);
        bench.emulator.take(bench.id, &mut held);
        if tick % 12 == 0 {
            outstanding -= i32::from(!held.is_empty());
            bench.arm.receive_command(bench.now, &held);
            held.clear();
        }
        bytes.clear();
        bench.arm.poll(bench.now, &mut bytes);
        outstanding += i32::from(!bytes.is_empty());
        assert!((0..=1).contains(&outstanding));
        bench.send(&bytes);
    }
    assert_eq!(bench.arm.state(), ArmState::Ready);
    // Of 400 ticks.
    let sent = bench.wire.streamed() - before;
    assert!((125..=170).contains(&sent), "{sent}");
}

#[test]
fn late_replies_are_caught_up_with() {
    let mut bench = Bench::ready();
    let (mut worst, mut before) = (0.0_f64, bench.arm.joints().unwrap());
    // A smooth second at 0.6 m/s, in which the network holds everything back for 80 ms.
    for tick in 0..300 {
        let mut target = home();
        target[0] += 0.6 * smooth(f64::from(tick) * 0.005);
        bench.servo(target).unwrap();
        for _ in 0..5 {
            bench.held = (100..116).contains(&tick);
            bench.step();
            let sent = bench.wire.targets.last().copied().unwrap_or(before);
            worst = worst.max(flange_m(&before, &sent));
            before = sent;
        }
    }
    assert_eq!(bench.arm.state(), ArmState::Ready);
    let sent = bench.wire.streamed();
    assert!((280..=290).contains(&sent), "{sent} of 300 ticks");
    // Never more than 5 ms at 1 m/s, though it was 48 mm behind.
    assert!(worst < 0.0051, "{worst}");
    assert!(apart(&bench.arm.sent().unwrap(), &bench.emulator.joints()) < 0.02, "and there in the end");
}

#[test]
fn feedback_frames_are_swallowed() {
    let mut bench = Bench::ready();
    let feedback = [FEEDBACK, 0, 2, 23, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 5];
    let mut bytes = Vec::new();
    // Even one that looks like the answer to what is outstanding.
    for transaction in 0..200 {
        Frame::new(transaction, 3, &[&feedback]).unwrap().write(&mut bytes);
    }
    bench.arm.receive_command(bench.now, &bytes);
    bench.run(300);
    assert_eq!(bench.arm.state(), ArmState::Ready);
}

#[test]
fn the_same_inputs_give_the_same_bytes() {
    let run = || {
        let mut bench = Bench::ready();
        bench.stream(0.5, |time| std::array::from_fn(|joint| home()[joint] + 0.1 * smooth(time))).unwrap();
        bench.emulator.inject_error(31);
        bench.run(500);
        bench.wire.frames
    };
    assert_eq!(run(), run());
}
