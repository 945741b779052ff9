//! What every rig promises: it begins in the starting pose, follows targets, shows the keys that it
//! presses, reports them as events, and ends as it was asked to.

use std::sync::atomic::{AtomicBool, Ordering};

use etude_music::{CONTROL_HZ, KeySet, Note, Song, keys_at};
use etude_perform::{Ending, Header, Mode, Recording, RecordingWriter};
use etude_stage::hand::{TIP_RADIUS, root_lateral};
use etude_stage::{DRIVEN_JOINTS, PhysicalParams, RAIL, World, kinematics};
use etude_task::{ACTION_LEN, ObservationScale, Piece, ScriptedBaseline, TargetRange, TaskConfig};
use etude_twin::{OrderedFault, TwinParams};

use crate::bench::{Kind, play, start_pose, with_rig};

/// Middle C and the finger that presses it.
const KEY: usize = 24;
const FINGER: usize = 1;
/// Control steps in which the finger is up, then down.
const UP: usize = 20;
const DOWN: usize = 20;

pub fn twin_params() -> TwinParams {
    TwinParams::load("mild").unwrap()
}

/// Joints in rad and m: the columns of the observation are then the readings themselves.
pub fn task() -> TaskConfig {
    TaskConfig { scale: ObservationScale::Si, ..TaskConfig::default() }
}

/// Middle C, due for a second after a second of silence.
pub fn piece() -> Piece {
    let note = Note { pitch: 60, velocity: 80, start_secs: 0.0, end_secs: 1.0 };
    Piece::new(&Song::new("one note", vec![note], 2.0).unwrap(), 1.0).unwrap()
}

/// Targets that hold a finger over middle C, or on it.
fn targets(down: bool) -> [f64; DRIVEN_JOINTS] {
    let task = task();
    let world = World::new(&task.stage, &PhysicalParams::default()).unwrap();
    let side = task.stage.side;
    let [x, y, z] = world.key_target(KEY);
    let mut targets = start_pose(&task);
    targets[RAIL] = y - root_lateral(side, FINGER);
    let height = if down { -0.01 } else { 0.02 };
    let angles = kinematics::reach(side, FINGER, [x, y, z + TIP_RADIUS + height], targets[RAIL]).unwrap();
    targets[4 * FINGER..4 * FINGER + 4].copy_from_slice(&angles);
    targets
}

#[test]
fn it_begins_in_the_starting_pose_and_follows_targets() {
    for kind in Kind::ALL {
        let (task, piece) = (task(), piece());
        let (start, range) = (start_pose(&task), TargetRange::new(&piece));
        let still = range.action(&start, 0);
        let up = range.action(&targets(false), 0);
        let mut observed: Vec<Vec<f32>> = Vec::new();
        let mut player = |step: usize, observation: &[f32], action: &mut [f32; ACTION_LEN]| {
            observed.push(observation[..DRIVEN_JOINTS].to_vec());
            *action = if step < UP { still } else { up };
        };
        let performance =
            play(kind, &twin_params(), &task, &piece, &mut player, None, &AtomicBool::new(false)).unwrap();
        assert_eq!((performance.ending, observed.len()), (Ending::Complete, piece.steps()), "{kind:?}");
        let far = |joints: &[f32], pose: &[f64; DRIVEN_JOINTS]| {
            joints.iter().zip(pose).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max)
        };
        assert!(far(&observed[0], &start) < 0.02, "{kind:?}: {:?}", observed[0]);
        let last = observed.last().unwrap();
        assert!(far(last, &targets(false)) < 0.05, "{kind:?}: {last:?}");
        // It moves there, and does not jump.
        assert!(
            far(&observed[UP], &start) < 0.02 && far(&observed[UP + 1], &targets(false)) > 0.02,
            "{kind:?}"
        );
    }
}

#[test]
fn it_shows_the_keys_that_it_presses_and_reports_them_as_events() {
    for kind in Kind::ALL {
        let (task, piece) = (task(), piece());
        let range = TargetRange::new(&piece);
        let [up, down] = [false, true].map(|down| range.action(&targets(down), 0));
        let mut seen = Vec::new();
        let mut player = |step: usize, observation: &[f32], action: &mut [f32; ACTION_LEN]| {
            seen.push(observation[2 * DRIVEN_JOINTS + KEY]);
            *action = if (UP..UP + DOWN).contains(&step) { down } else { up };
        };
        let performance =
            play(kind, &twin_params(), &task, &piece, &mut player, None, &AtomicBool::new(false)).unwrap();
        assert!(seen[..=UP].iter().all(|key| *key == 0.0), "{kind:?}: nothing is pressed before: {seen:?}");
        assert!(seen[UP + 10..UP + DOWN].iter().all(|key| *key == 1.0), "{kind:?}: {seen:?}");
        assert_eq!(seen.last(), Some(&0.0), "{kind:?}: it is released");
        let pressed = |step: usize| performance.pressed[step].contains(KEY);
        assert!(!pressed(UP - 1) && pressed(UP + DOWN - 1) && !pressed(piece.steps() - 1), "{kind:?}");
        // Events and keys tell the same, in the order of time.
        assert!(performance.events.is_sorted_by(|one, next| one.secs <= next.secs), "{kind:?}");
        let ends = (1..=performance.pressed.len()).map(|step| step as f64 / CONTROL_HZ);
        assert_eq!(keys_at(KeySet::EMPTY, &performance.events, ends), performance.pressed, "{kind:?}");
        let strike = performance.events.iter().find(|event| event.key == KEY).unwrap();
        let after = strike.secs - UP as f64 / CONTROL_HZ;
        assert!((0.0..0.3).contains(&after) && strike.velocity > 0, "{kind:?}: struck after {after} s");
        assert!(performance.scores().note.matched <= 1 && performance.secs() == 3.05, "{kind:?}");
    }
}

#[test]
fn fingers_at_the_ends_of_their_ranges_ask_for_no_more() {
    for kind in Kind::ALL {
        let (task, piece) = (task(), piece());
        let still = TargetRange::new(&piece).action(&start_pose(&task), 0);
        let mut player = |step: usize, _: &[f32], action: &mut [f32; ACTION_LEN]| {
            // Against the stops at both ends, which yield in a simulation.
            *action = still;
            if (UP..UP + DOWN / 4).contains(&step) {
                action[..RAIL].fill(-1.0);
            } else if (UP + DOWN / 2..UP + DOWN).contains(&step) {
                action[..RAIL].fill(1.0);
            }
        };
        let performance =
            play(kind, &twin_params(), &task, &piece, &mut player, None, &AtomicBool::new(false)).unwrap();
        let clamped = performance.robot.as_ref().map(|robot| robot.clamped);
        let expected = (kind != Kind::Simulator).then_some(0);
        assert_eq!((performance.ending, clamped), (Ending::Complete, expected), "{kind:?}");
    }
}

#[test]
fn it_ends_where_it_is_interrupted_and_begins_anew_after_that() {
    for kind in Kind::ALL {
        let (task, piece) = (task(), piece());
        let interrupt = AtomicBool::new(false);
        let script = ScriptedBaseline::new(&task, &piece).unwrap();
        let mut player = |step: usize, _: &[f32], action: &mut [f32; ACTION_LEN]| {
            interrupt.store(step == 9, Ordering::Relaxed);
            *action = script.action(step);
        };
        let performance = play(kind, &twin_params(), &task, &piece, &mut player, None, &interrupt).unwrap();
        assert_eq!((performance.ending.clone(), performance.pressed.len()), (Ending::Interrupted, 10));
        assert_eq!(performance.keys_heard().len(), piece.steps(), "what was not played counts as silence");
        // The simulator may play again, from the beginning.
        if kind == Kind::Simulator {
            let run = |rig: &mut dyn etude_perform::Rig| {
                let mut script = script.clone();
                let never = AtomicBool::new(false);
                etude_perform::perform(rig, &mut script, &task, &piece, None, &never).unwrap()
            };
            with_rig(kind, &twin_params(), &task, &piece, |rig| {
                let (first, second) = (run(rig), run(rig));
                assert_eq!((first.pressed, first.events), (second.pressed, second.events));
                assert_eq!(first.simulation, second.simulation);
            });
        }
    }
}

#[test]
fn a_robot_that_stops_itself_ends_with_its_fault_and_the_recording_is_whole() {
    let folder = tempfile::tempdir().unwrap();
    for mode in Mode::ALL {
        let (task, piece) = (task(), piece());
        // Starting and homing take some ten seconds; the fault comes in the middle of the piece or
        // a little before.
        let fault: OrderedFault = "can-silent@11.5".parse().unwrap();
        let twin_params = twin_params().with_faults(&[fault]).unwrap();
        let mut script = ScriptedBaseline::new(&task, &piece).unwrap();
        let path = folder.path().join(format!("{mode}.mcap"));
        let mut writer = RecordingWriter::create(&path, &Header::default()).unwrap();
        let never = AtomicBool::new(false);
        let kind = Kind::Twin(mode);
        let performance =
            play(kind, &twin_params, &task, &piece, &mut script, Some(&mut writer), &never).unwrap();
        writer.finish().unwrap();
        assert!(matches!(&performance.ending, Ending::Fault(reason) if !reason.is_empty()), "{mode}");
        assert!(performance.pressed.len() < piece.steps(), "{mode}");
        let recording = Recording::read(&path).unwrap();
        assert!(recording.complete && recording.steps.len() == performance.pressed.len(), "{mode}");
        assert!(recording.events.iter().any(|(_, note)| note.kind == "fault"), "{mode}");
    }
}

#[test]
fn a_player_without_a_target_ends_with_a_fault() {
    const LOST: usize = 12;
    for kind in Kind::ALL {
        let (task, piece) = (task(), piece());
        let mut player = |step: usize, _: &[f32], action: &mut [f32; ACTION_LEN]| {
            action[0] = if step == LOST { f32::NAN } else { 0.0 };
        };
        let never = AtomicBool::new(false);
        let performance = play(kind, &twin_params(), &task, &piece, &mut player, None, &never).unwrap();
        assert!(matches!(performance.ending, Ending::Fault(_)), "{kind:?}: {:?}", performance.ending);
        assert_eq!(performance.pressed.len(), LOST, "{kind:?}");
    }
}
