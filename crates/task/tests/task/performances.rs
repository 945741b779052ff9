//! From presses to scores: a performance that is what was due scores one, and what is missing costs what the paper's
//! measure says.

use etude_learn::Evaluator as _;
use etude_music::{CONTROL_HZ, KeyEvent, KeySet, repertoire};
use etude_perform::{Ending, Performance, SimRig, SongEvaluator};
use etude_stage::hand::{TIP_RADIUS, root_lateral};
use etude_stage::{RAIL, World, kinematics};
use etude_task::{ACTION_LEN, Piece, TargetRange, TaskConfig};

use crate::bench::{nominal, play_nominal, play_on, restless, short_piece};

/// A performance that pressed these keys at these control steps.
fn played(piece: &Piece, pressed: Vec<KeySet>) -> Performance {
    let mut events = Vec::new();
    let mut before = KeySet::EMPTY;
    for (step, now) in pressed.iter().enumerate() {
        let secs = step as f64 / CONTROL_HZ;
        events.extend(now.difference(before).iter().map(|key| KeyEvent { secs, key, velocity: 80 }));
        events.extend(before.difference(*now).iter().map(|key| KeyEvent { secs, key, velocity: 0 }));
        before = *now;
    }
    Performance { pressed, events, ending: Ending::Complete, ..Performance::new(piece) }
}

#[test]
fn playing_what_is_due_is_perfect_for_every_song() {
    for id in repertoire::ids() {
        let piece = Piece::new(&repertoire::get(id).unwrap(), 1.0).unwrap();
        let perfect = played(&piece, piece.frames().to_vec());
        let scores = perfect.scores().frame;
        assert_eq!(
            (scores.f1, scores.pooled_f1, scores.precision, scores.recall),
            (1.0, 1.0, 1.0, 1.0),
            "{id}"
        );
        let notes = perfect.scores().note;
        assert_eq!((notes.onset_f1, notes.missed, notes.wrong), (1.0, 0, 0), "{id}");
        let silent = played(&piece, vec![KeySet::EMPTY; piece.steps()]);
        let rests = piece.frames().iter().filter(|due| due.is_empty()).count();
        let expected = rests as f64 / piece.steps() as f64;
        assert!((silent.scores().frame.f1 - expected).abs() < 1e-12, "silence earns the rests");
        assert_eq!(silent.scores().frame.pooled_recall, 0.0);
        assert_eq!(silent.scores().note.onset_f1, 0.0);
    }
}

#[test]
fn a_performance_holds_every_step_and_event() {
    let piece = short_piece();
    let task = restless();
    let mut rig = SimRig::new(&task, &piece, 7).unwrap();
    let world = World::new(&task.stage, rig.world().params()).unwrap();
    let range = TargetRange::new(&piece);
    let mut watched = 0;
    let mut player = |step: usize, observation: &[f32], act: &mut [f32; ACTION_LEN]| {
        assert_eq!((observation.len(), step), (369, watched));
        watched += 1;
        // A finger over middle C, down every other half second.
        let [x, y, z] = world.key_target(24);
        let side = world.config().side;
        let mut targets = world.start_pose();
        targets[RAIL] = y - root_lateral(side, 1);
        let height = if step % 20 > 10 { -0.01 } else { 0.02 };
        let angles = kinematics::reach(side, 1, [x, y, z + TIP_RADIUS + height], targets[RAIL]);
        targets[4..8].copy_from_slice(&angles.expect("in reach"));
        *act = range.action(&targets, step);
    };
    let performance = play_on(&mut rig, &task, &piece, &mut player);
    assert_eq!((watched, performance.pressed.len(), performance.piece.steps()), (31, 31, 31));
    let mut down = KeySet::EMPTY;
    for event in &performance.events {
        assert_eq!(event.velocity > 0, !down.contains(event.key), "strikes and releases alternate");
        if event.velocity > 0 {
            down.insert(event.key)
        } else {
            down.remove(event.key)
        };
    }
    assert_eq!(Some(&down), performance.pressed.last());
    assert!(!performance.events.is_empty(), "the motion is meant to press something");
    assert!(performance.simulation.unwrap().reward.is_finite());
}

/// Still hands collide with nothing, whatever the reward pays for.
#[test]
fn collisions_are_counted_without_the_collision_term_too() {
    let piece = short_piece();
    for weight in [1.0, 0.0, -1.0] {
        let mut config = nominal();
        config.reward.insert("collision".into(), weight);
        let start = World::new(&config.stage, &config.params().unwrap()).unwrap().start_pose();
        let still = TargetRange::new(&piece).action(&start, 0);
        let mut player = |_: usize, _: &[f32], act: &mut [f32; ACTION_LEN]| *act = still;
        let free = play_nominal(&config, &piece, &mut player).simulation.unwrap().collision_free;
        assert!((free - 1.0).abs() < 1e-9, "weight {weight}: {free}");
    }
}

#[test]
fn evaluation_is_the_nominal_world_and_forgets_nothing_between_calls() {
    let piece = short_piece();
    let still = |config: &TaskConfig| {
        let mut evaluator = SongEvaluator::new(config, &piece).unwrap();
        let mut act = |observations: &[f32], actions: &mut [f32]| {
            assert_eq!(observations.len(), 369);
            actions.fill(0.0);
        };
        let first = evaluator.evaluate(&mut act);
        assert_eq!(evaluator.evaluate(&mut act), first, "two evaluations of one policy agree");
        first
    };
    let scores = still(&nominal());
    assert_eq!(scores[0].name, "f1");
    assert_eq!(still(&restless()), scores, "randomisation is for training");
}
