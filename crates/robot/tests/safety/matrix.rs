//! Each fault in each phase, and where it must end. The table goes to `target/fault-matrix.md`, and
//! what a person meets of it to `docs/robot.md`.

use std::fmt::Write as _;
use std::path::Path;

use etude_emulators::ReportKind;
use etude_robot::joints::{DRIVEN, RAIL};
use etude_robot::{Phase, Refused};
use etude_twin::{TwinParams, calibration};

use crate::bench::Bench;
use crate::faults::End::{self, Fault, GoesOn, Never};
use crate::faults::{Lost, Row, WHENS, When, rows};
use crate::page;
use crate::policy::Policy;

/// The slowest warning is that of a key that stays down, ms.
const WARNED_WITHIN: u32 = 12_000;

/// Brings a stopped robot with nothing wrong into a phase.
pub fn bring(bench: &mut Bench, when: When) {
    if bench.robot.phase() != Phase::Off {
        bench.stop();
        bench.run(300);
    }
    if when == When::Homing {
        bench.place_arm_at_home()
    } else {
        bench.place_arm_at_the_keyboard()
    }
    if when == When::Starting {
        bench.start();
        bench.run(15);
        assert_eq!(bench.robot.phase(), Phase::Starting);
        return;
    }
    bench.start_and_hold();
    bench.run(50);
    let mut goal = bench.robot.joints();
    (goal[1], goal[RAIL]) = (0.4, 0.25);
    match when {
        When::Starting | When::Holding => {}
        When::Homing => {
            bench.robot.home(bench.now(), &goal).unwrap();
            let before = bench.judge.targets;
            assert!(bench.until(5000, |b| b.judge.targets > before).is_some(), "{:?}", bench.notes);
            bench.run(100);
        }
        When::Moving => {
            bench.robot.approach(bench.now(), &goal).unwrap();
            bench.run(300);
        }
        When::Following => {
            bench.follow(Policy::Smooth);
            bench.run(300);
        }
        When::Stopped => {
            bench.stop();
            bench.run(300);
        }
    }
}

/// The phases in which a robot may be that continues.
pub fn expected_phase(when: When) -> &'static [Phase] {
    match when {
        When::Starting => &[Phase::Starting, Phase::Holding],
        When::Holding => &[Phase::Holding],
        When::Homing | When::Moving => &[Phase::Moving, Phase::Holding],
        When::Following => &[Phase::Following],
        When::Stopped => &[Phase::Stopped],
    }
}

/// What happened in one cell of the table.
fn cell(bench: &mut Bench, row: &Row, when: When, says: &mut Option<String>) -> String {
    let end = row.ends[WHENS.iter().position(|other| *other == when).unwrap()];
    if end == Never {
        return "–".into();
    }
    let place = format!("{}, {when:?}", row.name);
    bring(bench, when);
    bench.notes.clear();
    (row.strike)(bench);
    let text = match end {
        Never => String::new(),
        GoesOn => {
            for _ in 0..600 {
                bench.step();
                let phase = bench.robot.phase();
                assert!(expected_phase(when).contains(&phase), "{place}: {phase:?} {:?}", bench.notes);
            }
            if row.ends.iter().all(|end| matches!(end, GoesOn | Never)) && !row.says.is_empty() {
                // A long motion would bend the fingers between the keys.
                if bench.policy == Policy::Smooth {
                    bench.policy = Policy::Still;
                }
                let warning = |b: &Bench| {
                    let mut warnings = b.robot.keyboard().warnings().map(|warning| warning.to_string());
                    warnings.find(|warning| row.is_said(warning))
                };
                let warned = bench.until(WARNED_WITHIN, |b| warning(b).is_some());
                *says = warning(bench);
                let phase = bench.robot.phase();
                assert!(expected_phase(when).contains(&phase), "{place}: {phase:?} {:?}", bench.notes);
                assert!(
                    warned.is_some(),
                    "{place}: {:?}",
                    bench.robot.keyboard().warnings().collect::<Vec<_>>()
                );
            }
            if when == When::Stopped {
                assert!(bench.hand_is_off() && bench.arm_stands(), "{place}");
                "stays stopped".into()
            } else {
                "continues".into()
            }
        }
        End::Stopped => {
            let took = rests(bench, row.lost, 3, &place);
            assert_eq!(bench.robot.phase(), Phase::Stopped, "{place}");
            stands_still(bench, row.lost, &place);
            format!("stopped, {took} ms")
        }
        Fault(within) => {
            let took = rests(bench, row.lost, within, &place);
            let fault = bench.robot.fault().unwrap().to_string();
            assert_eq!(bench.robot.phase(), Phase::Fault, "{place}");
            stands_still(bench, row.lost, &place);
            // Latched, in its final words.
            let fault = bench.robot.fault().map_or(fault, ToString::to_string);
            assert!(row.is_said(&fault), "{place}: {fault}");
            assert!(says.as_ref().is_none_or(|said| *said == fault || !row.says.is_empty()), "{place}");
            *says = Some(fault);
            format!("fault, {took} ms")
        }
    };
    recovers(bench, row, end, when, &place);
    text
}

/// Milliseconds until hand and arm are let go, as far as their wires carry it.
fn rests(bench: &mut Bench, lost: Lost, within: u32, place: &str) -> u32 {
    let took = bench.until(within + 50, |b| {
        let told = matches!(b.robot.phase(), Phase::Fault | Phase::Stopped);
        told && (b.hand_is_off() || lost.hand()) && (b.arm_is_stopped() || lost.arm())
    });
    let took = took.unwrap_or_else(|| {
        let arm = &bench.lockstep.twin.devices.arm;
        panic!(
            "{place}: {:?}, hand off {}, arm in state {}, {:?}",
            bench.robot.phase(),
            bench.hand_is_off(),
            arm.state(),
            bench.notes
        )
    });
    assert!(took <= within, "{place}: {took} ms");
    took
}

/// Nothing moves any more, and nobody may command; what a cut wire cannot prevent is what it is.
fn stands_still(bench: &mut Bench, lost: Lost, place: &str) {
    let phase = bench.robot.phase();
    let held = bench.lockstep.twin.devices.hand.pwm();
    bench.run(if lost.arm() { 6000 } else { 500 });
    match lost {
        Lost::HandHolds | Lost::Both => {
            assert_eq!(bench.lockstep.twin.devices.hand.pwm(), held, "{place}")
        }
        Lost::HandTimesOut => assert!(bench.hand_is_free(), "{place}"),
        Lost::Nothing | Lost::Arm => assert!(bench.hand_is_off(), "{place}"),
    }
    let joints = bench.lockstep.twin.devices.arm.joints();
    bench.run(100);
    assert_eq!(bench.lockstep.twin.devices.arm.joints(), joints, "{place}: the arm moves");
    if !matches!(lost, Lost::HandHolds | Lost::Both) {
        assert!(bench.fastest() < 0.05, "{place}: {:?}", bench.lockstep.twin.joint_velocities());
    }
    if !lost.arm() {
        assert!(bench.arm_is_stopped(), "{place}");
    }
    let (now, pose) = (bench.now(), [0.0; DRIVEN]);
    for refused in
        [bench.robot.follow(now, &[pose; 10]), bench.robot.home(now, &pose), bench.robot.approach(now, &pose)]
    {
        assert!(matches!(refused, Err(Refused::Phase { .. })), "{place}: {refused:?}");
    }
    bench.robot.hold(now);
    bench.run(50);
    assert_eq!(bench.robot.phase(), phase, "{place}: latched");
}

/// A start works when the cause is gone, and not before.
fn recovers(bench: &mut Bench, row: &Row, end: End, when: When, place: &str) {
    if row.stays && matches!((end, when), (Fault(_), When::Following)) {
        bench.start();
        bench.until_phase(Phase::Fault, 7000);
        rests(bench, row.lost, 20, place);
    }
    (row.mend)(bench);
    bench.run(20);
    bench.stop();
    bench.run(200);
    bench.start_and_hold();
    let reached = bench.robot.phase();
    assert_eq!(reached, Phase::Holding, "{place}");
}

fn twin_params(row: &Row) -> TwinParams {
    let twin_params = TwinParams::load("mild").unwrap().with("[keyboard]\nsensing_secs = 0.1").unwrap();
    twin_params.with(row.twin).unwrap()
}

/// The line of a row, and what was said in it.
fn line(row: &Row) -> (String, Option<String>) {
    let mut bench = Bench::new(&twin_params(row), &calibration("twin"));
    if row.timed {
        bench.lockstep.reports = ReportKind::Control;
    }
    let mut says = None;
    let cells = WHENS.map(|when| cell(&mut bench, row, when, &mut says));
    let fault = row.ends.iter().any(|end| matches!(end, Fault(_) | End::Stopped));
    let [hand, arm] = match row.lost {
        _ if !fault => ["–", "–"],
        Lost::Nothing => ["no torque, servo off", "state 4"],
        Lost::HandHolds => ["**holds its last torque**", "state 4"],
        Lost::HandTimesOut => ["no torque after its timeout", "state 4"],
        Lost::Arm => ["no torque, servo off", "**ends its last order, then stands**"],
        Lost::Both => ["**holds its last torque**", "**ends its last order, then stands**"],
    };
    let text = says.clone().unwrap_or_default();
    (format!("| {} | {} | {hand} | {arm} | {text} |", row.name, cells.join(" | ")), says)
}

#[test]
fn every_fault_in_every_phase() {
    let half = rows().count() / 2;
    let lines: Vec<(String, Option<String>)> = std::thread::scope(|scope| {
        let rest = scope.spawn(|| rows().skip(half).map(line).collect::<Vec<_>>());
        let mut lines: Vec<_> = rows().take(half).map(line).collect();
        lines.extend(rest.join().unwrap());
        lines
    });
    let mut table = String::from(
        "| fault | starting | holding | homing | moving | following | stopped \
         | hand | arm | the operator reads |\n\
         |---|---|---|---|---|---|---|---|---|---|\n",
    );
    for (line, _) in &lines {
        writeln!(table, "{line}").unwrap();
    }
    println!("{table}");
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("fault-matrix.md");
    std::fs::write(path, table).unwrap();
    page::compare(rows().zip(lines.into_iter().map(|(_, said)| said)));
}
