//! What a recording of a robot begins and ends with.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use etude_perform::{Header, Mode, Recording, RecordingWriter, RobotRig, perform, prepare, record_release};
use etude_task::ScriptedBaseline;
use etude_twin::OrderedFault;

use crate::bench::with_robot;
use crate::contract::{piece, task, twin_params};

/// The order of the messages of a recording: notes, and whether the hand was reported with or
/// without torque.
fn order(path: &Path) -> Vec<String> {
    let bytes = std::fs::read(path).unwrap();
    let mut lines: Vec<String> = Vec::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let value: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
        let line = match message.channel.topic.as_str() {
            "/event" => format!("{} {}", value["kind"].as_str().unwrap(), value["text"].as_str().unwrap()),
            "/hand" => {
                let none = |of: &str| {
                    value[of].as_array().unwrap().iter().all(|number| number.as_f64() == Some(0.0))
                };
                let idle = none("pwm") && none("wanted") && value["reference"] == value["positions"];
                if idle { "idle" } else { "driven" }.to_string()
            }
            _ => continue,
        };
        if lines.last() != Some(&line) {
            lines.push(line);
        }
    }
    lines
}

/// The hand is recorded from its start to the second after its release, whose periods are no part
/// of the timing.
#[test]
fn a_recording_shows_the_hand_before_it_holds_and_after_a_fault() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.mcap");
    let fault: OrderedFault = "arm-error=31@11.5".parse().unwrap();
    let twin_params = twin_params().with_faults(&[fault]).unwrap();
    let (task, piece) = (task(), piece());
    let mut script = ScriptedBaseline::new(&task, &piece).unwrap();
    let mut writer = RecordingWriter::create(&path, &Header::default()).unwrap();
    let never = AtomicBool::new(false);
    let performance = with_robot(&twin_params, &task, |robot, pace, pose| {
        prepare(robot, pace, Some(pose), Some(&mut writer), &never).unwrap();
        let mut rig = Mode::Real.rig(None, RobotRig::new(robot, pace, pose));
        let performance = perform(&mut *rig, &mut script, &task, &piece, Some(&mut writer), &never).unwrap();
        drop(rig);
        record_release(robot, pace, &mut writer).unwrap();
        performance
    });
    writer.finish().unwrap();
    let lines = order(&path);
    let at = |text: &str| lines.iter().position(|line| line.starts_with(text)).unwrap();
    for part in [&lines[..at("phase holding")], &lines[at("fault ")..]] {
        let has = |line: &str| part.contains(&line.to_string());
        assert!(has("idle") && !has("driven"), "{lines:?}");
    }
    let recording = Recording::read(&path).unwrap();
    let ends = recording.events.iter().find(|(_, note)| note.kind == "fault").unwrap().0;
    let after = recording.hand.iter().filter(|(secs, _)| *secs > ends).count();
    assert!((300..340).contains(&after), "{after}");
    let inside = recording.hand.iter().filter(|(secs, _)| *secs > 0.0 && *secs <= ends).count();
    let periods = performance.robot.unwrap().timing.report().hand_periods;
    assert!(inside.abs_diff(periods) <= 2, "{inside} and {periods}");
}
