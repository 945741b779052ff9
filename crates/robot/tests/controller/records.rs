//! What is recorded is what happened.

use etude_emulators::ArmEmulatorConfig;
use etude_robot::joints::RAIL;
use etude_robot::{Phase, Record};

use crate::bench::{Bench, rig};

#[test]
fn clamps_cover_every_difference_between_asked_and_sent() {
    let mut bench = Bench::holding();
    let mut pose = bench.robot.joints();
    bench.follow(&pose, 100);
    for step in 0..60 {
        // Small steps, jumps, and what is out of range.
        let size = [1e-4, 0.003, 0.02, 0.4, 9.0][step % 5];
        for (joint, angle) in pose.iter_mut().enumerate() {
            *angle = if (step + joint) % 3 == 0 { -size } else { size * 0.7 }
                * if joint == RAIL { 0.3 } else { 1.0 };
        }
        bench.follow(&pose, 50);
    }
    assert_eq!(bench.robot.phase(), Phase::Following, "{}", bench.fault());
    let (mut differences, mut named) = (0, 0);
    for record in &bench.records {
        let Record::SetPoint { asked, sent, clamps, .. } = record else { continue };
        for joint in 0..=RAIL {
            if (asked[joint] - sent[joint]).abs() > 1e-8 {
                differences += 1;
                assert!(clamps.iter().any(|(clamped, _)| *clamped == joint), "{joint} in {record:?}");
            }
        }
        named += clamps.len();
    }
    assert!(differences > 1000 && named < 2 * differences, "{differences} differences, {named} named");
}

/// Also on the way, where the rail is not driven.
#[test]
fn nothing_is_asked_of_a_rail_that_is_not_there() {
    let mut bench = Bench::new();
    bench.devices.arm.place([0.0, 0.17, 0.0, 1.87, 3.1, -0.19, -3.92]);
    bench.start();
    bench.until(Phase::Holding, 3000);
    let mut goal = [0.1; 13];
    goal[RAIL] = 0.3;
    bench.robot.home(bench.now(), &goal).unwrap();
    bench.run(500);
    for record in &bench.records {
        if let Record::SetPoint { asked, sent, .. } = record {
            assert_eq!(asked[RAIL], sent[RAIL]);
        }
    }
}

/// The hand's angles are recorded while it starts and for a second after it was released; then it
/// is quiet.
#[test]
fn the_hand_is_observed_before_and_after_it_has_torque() {
    let mut bench = Bench::new();
    bench.devices.guided[5] = Some(0.2);
    bench.run(20);
    bench.start();
    bench.until(Phase::Holding, 3000);
    let idle = |records: &[Record]| -> Vec<f64> {
        let angle = |record: &Record| match record {
            Record::Idle { positions, .. } => Some(positions[5]),
            _ => None,
        };
        records.iter().filter_map(angle).collect()
    };
    let starting = idle(&bench.records);
    assert!(starting.len() > 2 && starting.iter().all(|rad| (rad - 0.2).abs() < 1e-3), "{starting:?}");
    bench.records.clear();
    bench.run(300);
    assert!(idle(&bench.records).is_empty());
    bench.devices.arm.inject_error(31);
    bench.until(Phase::Fault, 100);
    bench.records.clear();
    bench.guide(5, 0.5);
    bench.run(900);
    let first = idle(&bench.records);
    assert!((300..340).contains(&first.len()) && (first[first.len() - 1] - 0.5).abs() < 1e-3, "{first:?}");
    bench.run(100);
    bench.records.clear();
    bench.run(1000);
    assert!(bench.records.iter().all(|record| !matches!(record, Record::Idle { .. } | Record::Hand { .. })));
    let mut frames = Vec::new();
    bench.devices.hand.tick(bench.now() + 10 * crate::bench::MS, &mut frames);
    assert!(frames.is_empty(), "the hand still reports");
}

#[test]
fn what_the_arm_was_not_sent_is_none() {
    let mut bench = Bench::holding();
    let sent = |records: &[Record]| {
        let arms = records.iter().filter_map(|record| match record {
            Record::Arm { sent, .. } => Some(sent.is_some()),
            _ => None,
        });
        arms.collect::<Vec<_>>()
    };
    assert!(sent(&bench.records).iter().all(|sent| !sent), "nothing was sent while it started");
    bench.records.clear();
    bench.run(200);
    assert!(sent(&bench.records)[5..].iter().all(|sent| *sent));
}

/// What the joint loop wanted stands beside what was sent.
#[test]
fn torques_are_recorded_before_and_after_their_limits() {
    let mut bench = Bench::holding();
    bench.guide(1, 0.5);
    bench.run(100);
    let last = bench.records.iter().rev().find_map(|record| match record {
        Record::Hand { wanted, pwm, .. } => Some((wanted[1], pwm[1])),
        _ => None,
    });
    let (wanted, pwm) = last.unwrap();
    assert!((wanted + 1800.0).abs() < 5.0 && pwm == -675, "{wanted} {pwm}");
}

#[test]
fn messages_say_what_may_go_on_pushing() {
    let mut bench = Bench::holding();
    bench.devices.can_cut = true;
    bench.run(10);
    assert!(
        bench.fault().contains("may still push") && bench.fault().contains("hardware stop"),
        "{}",
        bench.fault()
    );
    let mut bench = Bench::holding();
    bench.devices.arm_cut = true;
    bench.run(10);
    assert!(
        bench.fault().contains("may still move") && bench.fault().contains("hardware stop"),
        "{}",
        bench.fault()
    );
    let mut bench = Bench::holding();
    bench.devices.held = true;
    bench.run(50);
    assert!(
        bench.fault().contains("may still push") && bench.fault().contains("hardware stop"),
        "{}",
        bench.fault()
    );
}

#[test]
fn a_firmware_that_was_never_tried_is_named_at_the_start() {
    for (firmware, is_new) in [("v1.5.0", true), ("v3.0.1", true), ("v2.4.9", false), ("v1.8.5", false)] {
        let arm = ArmEmulatorConfig { firmware: firmware.into(), ..ArmEmulatorConfig::default() };
        let mut bench = Bench::with_arm(&rig(), arm);
        bench.start();
        bench.until(Phase::Holding, 3000);
        let said = bench.robot.warnings().join("\n");
        assert_eq!(said.contains(firmware) && said.contains("v1.8.5 and v2.4.0"), is_new, "{said}");
        let noted =
            |record: &Record| matches!(record, Record::Note { kind: "warning", text, .. } if *text == said);
        assert_eq!(bench.records.iter().any(noted), is_new, "{firmware}");
    }
}
