//! Which rig each column of the observation comes from, in each execution mode (paper, appendix
//! "Execution Modes").

use std::path::Path;
use std::sync::atomic::AtomicBool;

use etude_music::{KEY_COUNT, LOWEST_PITCH, repertoire};
use etude_perform::{Header, Mode, Recording, RecordingWriter};
use etude_stage::{DRIVEN_JOINTS, RAIL};
use etude_task::{ACTION_LEN, ObservationScale, Piece, ScriptedBaseline, TaskConfig};
use etude_twin::TwinParams;

use crate::bench::{Kind, play};

/// Previous actions that the observation shows.
const ACTIONS: usize = 2;

/// What one rig measured at the end of a control step, as an observation would show it.
struct Seen {
    joints: Vec<f32>,
    keys: Vec<f32>,
}

impl Seen {
    fn new(joints: &[f64], pitches: impl Iterator<Item = u8>) -> Self {
        let mut keys = vec![0.0; KEY_COUNT];
        pitches.for_each(|pitch| keys[usize::from(pitch - LOWEST_PITCH)] = 1.0);
        Self { joints: joints.iter().map(|joint| *joint as f32).collect(), keys }
    }
}

/// The observations of a performance in `mode`; where the robot was sent in each control step, with
/// the keys of the simulation that sent it there, if one did; what the robot measured after each;
/// the piece and who played it.
fn observed(
    mode: Mode,
    rail_set_point: bool,
    folder: &Path,
) -> (Vec<Vec<f32>>, Vec<Seen>, Vec<Seen>, Piece, ScriptedBaseline) {
    // The units of the paper: the columns are then the readings themselves.
    let task = TaskConfig {
        scale: ObservationScale::Si,
        previous_actions: ACTIONS,
        rail_set_point,
        ..TaskConfig::default()
    };
    let song = repertoire::get("twinkle").expect("built in");
    let piece = Piece::new(&song, task.initial_silence_secs).unwrap();
    // A parameter set whose joints and keys differ from the simulation's.
    let twin_params = TwinParams::load("worn").unwrap();
    let file = folder.join(format!("{mode}.mcap"));
    let mut writer = RecordingWriter::create(&file, &Header::default()).unwrap();
    let script = ScriptedBaseline::new(&task, &piece).unwrap();
    let mut observations = Vec::new();
    let mut probe = |step: usize, observation: &[f32], action: &mut [f32; ACTION_LEN]| {
        observations.push(observation.to_vec());
        *action = script.action(step);
    };
    let never = AtomicBool::new(false);
    let played =
        play(Kind::Twin(mode), &twin_params, &task, &piece, &mut probe, Some(&mut writer), &never).unwrap();
    writer.finish().unwrap();

    let recording = Recording::read(&file).unwrap();
    let robot = recording.steps.iter().map(|step| Seen::new(&step.positions, step.pressed.iter().copied()));
    // The robot is sent where the simulation's joints are: the last way-point is their position at
    // the end of the step.
    let simulated = recording.steps.iter().enumerate().map(|(index, step)| {
        let keys = played.simulated.get(index).copied().unwrap_or_default();
        Seen::new(&step.targets, keys.pitches())
    });
    (observations, simulated.collect(), robot.collect(), piece, script)
}

/// Control steps after which the two sources show different values.
fn differences(a: &[Seen], b: &[Seen], of: impl Fn(&Seen) -> &Vec<f32>) -> usize {
    a.iter().zip(b).filter(|(a, b)| of(a) != of(b)).count()
}

#[test]
fn each_column_comes_from_the_rig_that_the_mode_names() {
    let folder = tempfile::tempdir().unwrap();
    for mode in Mode::ALL {
        let (observations, simulated, robot, piece, script) = observed(mode, false, folder.path());
        assert_eq!(observations.len(), piece.steps(), "{mode}");
        let (joints, keys) = match mode {
            Mode::JointMirroring => (&simulated, &simulated),
            Mode::Hybrid => (&simulated, &robot),
            Mode::Real => (&robot, &robot),
        };
        if mode != Mode::Real {
            // Swapped sources could not be noticed if both showed the same.
            let steps = piece.steps();
            assert!(differences(&simulated, &robot, |seen| &seen.joints) > steps / 2, "{mode}");
            assert!(differences(&simulated, &robot, |seen| &seen.keys) > steps / 20, "{mode}");
        }
        // What is observed before a step is what was measured at the end of the one before.
        for step in 2..observations.len() {
            let (now, rest) = observations[step].split_at(DRIVEN_JOINTS);
            let (before, rest) = rest.split_at(DRIVEN_JOINTS);
            let (actions, binary) = rest.split_at(ACTIONS * ACTION_LEN);
            assert_eq!(now, joints[step - 1].joints, "{mode}, step {step}: joints");
            assert_eq!(before, joints[step - 2].joints, "{mode}, step {step}: previous joints");
            for (ago, columns) in actions.chunks_exact(ACTION_LEN).enumerate() {
                assert_eq!(columns, script.action(step - 1 - ago), "{mode}, step {step}: action {ago}");
            }
            let (pressed, sheet) = binary.split_at(KEY_COUNT);
            assert_eq!(pressed, keys[step - 1].keys, "{mode}, step {step}: keys");
            for (ahead, columns) in sheet.chunks_exact(KEY_COUNT).enumerate() {
                let due = piece.due(step + ahead);
                let shown: Vec<usize> = (0..KEY_COUNT).filter(|key| columns[*key] == 1.0).collect();
                assert_eq!(shown, due.iter().collect::<Vec<_>>(), "{mode}, step {step}: sheet {ahead}");
            }
        }
    }
}

/// Where a robot was sent and where a slow arm is differ, and only the rail is shown where it was
/// sent.
#[test]
fn the_rails_set_point_is_shown_if_the_task_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let (observations, sent, robot, ..) = observed(Mode::Real, true, folder.path());
    assert!(differences(&sent, &robot, |seen| &seen.joints) > sent.len() / 2);
    for step in 2..observations.len() {
        let (now, before) = observations[step].split_at(DRIVEN_JOINTS);
        for (shown, ago) in [(now, 1), (before, 2)] {
            assert_eq!(shown[..RAIL], robot[step - ago].joints[..RAIL], "step {step}: fingers");
            assert_eq!(shown[RAIL], sent[step - ago].joints[RAIL], "step {step}: rail");
        }
    }
    let apart = |step: &usize| (sent[*step].joints[RAIL] - robot[*step].joints[RAIL]).abs() > 0.001;
    assert!((0..sent.len()).filter(apart).count() > sent.len() / 10, "the arm of this twin_params is slow");
}
