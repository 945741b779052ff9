//! Performances in simulation. From presses to scores: a performance that is what was due scores
//! one, and what is missing costs what the paper's measure says.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use etude_learn::{Evaluator as _, Score};
use etude_music::{CONTROL_HZ, KeyEvent, KeySet, Note, Song, Split, melody, repertoire};
use etude_perform::{Ending, Performance, SimRig, TrainingEvaluator, perform};
use etude_stage::hand::{TIP_RADIUS, root_lateral};
use etude_stage::{PhysicalParams, RAIL, World, kinematics};
use etude_task::{
    ACTION_LEN, Corpus, CorpusConfig, Environment, Piece, Player, RandomisationConfig, TargetRange,
    TaskConfig,
};

/// Two notes in a second; performances of thirty-one control steps with half a second of silence.
fn short_piece() -> Piece {
    let note = |pitch, start_secs| Note { pitch, velocity: 80, start_secs, end_secs: start_secs + 0.4 };
    let song = Song::new("short", vec![note(60, 0.0), note(61, 0.5)], 1.0).unwrap();
    Piece::new(&song, 0.5).unwrap()
}

/// The nominal task for [`short_piece`].
fn nominal() -> TaskConfig {
    TaskConfig { initial_silence_secs: 0.5, ..TaskConfig::default() }
}

/// Randomised worlds.
fn restless() -> TaskConfig {
    TaskConfig { randomisation: RandomisationConfig { intensity: 0.5, ..Default::default() }, ..nominal() }
}

/// Plays `piece` once on `rig`.
fn play_on(rig: &mut SimRig, config: &TaskConfig, piece: &Piece, player: &mut dyn Player) -> Performance {
    perform(rig, player, config, piece, None, &AtomicBool::new(false)).unwrap()
}

/// Plays `piece` once in the nominal world.
fn play_nominal(config: &TaskConfig, piece: &Piece, player: &mut dyn Player) -> Performance {
    play_on(&mut SimRig::nominal(config, piece).unwrap(), config, piece, player)
}

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

/// Still hands collide with nothing, whatever the weight of the term.
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
        let mut evaluator = TrainingEvaluator::new(config, &piece).unwrap();
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

#[test]
fn a_performance_is_in_the_world_that_its_seed_draws() {
    let (config, piece) = (restless(), short_piece());
    let drawn = |seed| {
        let mut rig = SimRig::new(&config, &piece, seed).unwrap();
        play_on(&mut rig, &config, &piece, &mut |_: usize, _: &[f32], _: &mut [f32; 13]| {});
        rig.world().params().clone()
    };
    assert!(drawn(5) == drawn(5) && drawn(5) != drawn(6) && drawn(5) != PhysicalParams::default());
}

#[test]
fn a_performance_in_a_world_is_one_where_it_is_nominal() {
    let piece = short_piece();
    let params = {
        let mut environment = Environment::new(&restless(), &piece, 3).unwrap();
        environment.reset();
        environment.world().params().clone()
    };
    let mut fixed = nominal();
    for (path, _, _) in PhysicalParams::rows() {
        fixed.physics.insert(path.clone(), params.get(&path).unwrap());
    }
    let mut press = |_: usize, _: &[f32], action: &mut [f32; 13]| {
        *action = [0.0, 0.3, 0.2, 0.1, 0.0, 0.4, 0.2, 0.1, 0.0, 0.3, 0.2, 0.1, 0.05];
    };
    let mut in_world = SimRig::in_world(&restless(), &piece, &params).unwrap();
    let chosen = play_on(&mut in_world, &restless(), &piece, &mut press);
    let built = play_on(&mut SimRig::nominal(&fixed, &piece).unwrap(), &fixed, &piece, &mut press);
    assert_eq!(
        (chosen.pressed, chosen.events, chosen.simulation),
        (built.pressed, built.events, built.simulation)
    );
}

#[test]
fn learned_pieces_are_scored_beside_those_of_the_validation() {
    let task = TaskConfig { fingering: true, initial_silence_secs: 0.1, ..TaskConfig::default() };
    // The melodies of these seeds, each cut after its first second.
    let short = |seed: u64| {
        let song = melody(seed);
        let notes = song.notes().iter().filter(|note| note.end_secs < 2.5).copied().collect();
        Song::new(song.title(), notes, 0.0).unwrap()
    };
    let of = |part, count| (0..).filter(move |seed| short(*seed).split() == part).take(count);
    let folder = tempfile::tempdir().unwrap();
    for seed in of(Split::Training, 3).chain(of(Split::Validation, 2)) {
        short(seed).save(folder.path().join(format!("{seed:03}.mid"))).unwrap();
    }
    let config = CorpusConfig { folder: Some(folder.path().to_path_buf()), validation_pieces: 2 };
    let corpus = Arc::new(Corpus::new(&config, &task).unwrap());
    let sample = corpus.learned_sample();
    assert_eq!(sample.len(), 2);
    let still = |evaluator: &mut TrainingEvaluator| evaluator.evaluate(&mut |_, actions| actions.fill(0.0));
    let scores = still(&mut TrainingEvaluator::of_corpus(&task, &corpus).unwrap());
    let of = |scores: &[Score], name: &str| scores.iter().find(|score| score.name == name).unwrap().value;
    let mut alone = sample.iter().map(|piece| still(&mut TrainingEvaluator::new(&task, piece).unwrap()));
    let [first, last] = [(); 2].map(|()| alone.next().unwrap());
    for name in ["f1", "onset_f1"] {
        let mean = (of(&first, name) + of(&last, name)) / 2.0;
        assert!((of(&scores, &format!("training_{name}")) - mean).abs() < 1e-12, "{name}");
    }
    assert_ne!(of(&scores, "training_f1"), of(&scores, "f1"));
}
