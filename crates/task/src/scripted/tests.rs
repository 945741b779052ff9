use etude_music::{KeySet, Note, Song, repertoire};
use etude_stage::{Side, joint_range};

use super::*;
use crate::rehearse;

fn piece(id: &str) -> Piece {
    Piece::new(&repertoire::get(id).unwrap(), 1.0).unwrap()
}

fn chords(chords: &[&[u8]]) -> Piece {
    let notes = chords.iter().enumerate().flat_map(|(i, chord)| {
        let start_secs = i as f64;
        chord.iter().map(move |pitch| Note {
            pitch: *pitch,
            velocity: 64,
            start_secs,
            end_secs: start_secs + 1.0,
        })
    });
    Piece::new(&Song::new("chords", notes.collect(), 0.0).unwrap(), 1.0).unwrap()
}

fn config(side: Side) -> TaskConfig {
    let mut config = TaskConfig::default();
    config.stage.side = side;
    config
}

fn f1(config: &TaskConfig, piece: &Piece) -> f64 {
    let player = ScriptedPlayer::new(config, piece).unwrap();
    let mut act = |environment: &crate::Environment, _: &[f32], out: &mut [f32; ACTION_LEN]| {
        *out = player.action(environment.position())
    };
    rehearse(config, piece, 0, &mut act, &mut |_, _, _| {}).unwrap().frame_scores().f1
}

#[test]
fn both_hands_play_the_c_major_scale() {
    for side in [Side::Left, Side::Right] {
        let f1 = f1(&config(side), &piece("c-major-scale"));
        assert!(f1 >= 0.93, "{side:?}: {f1}");
    }
}

#[test]
fn black_keys_and_chords_are_played() {
    for (id, bound) in [("d-major-scale", 0.88), ("chord-progression", 0.9), ("twinkle", 0.95)] {
        let f1 = f1(&TaskConfig::default(), &piece(id));
        assert!(f1 >= bound, "{id}: {f1}");
    }
}

#[test]
fn slower_joints_are_allowed_for() {
    let mut config = TaskConfig::default();
    for (path, value) in [
        ("joint.fingers.jerk_limit", 15_000.0),
        ("joint.fingers.acceleration_limit", 200.0),
        ("joint.rail.jerk_limit", 200.0),
        ("joint.rail.acceleration_limit", 8.0),
    ] {
        config.physics.insert(path.to_string(), value);
    }
    let f1 = f1(&config, &piece("c-major-scale"));
    assert!(f1 >= 0.85, "{f1}");
}

#[test]
fn the_same_song_gives_the_same_plan() {
    let piece = piece("happy-birthday");
    let config = TaskConfig::default();
    assert_eq!(ScriptedPlayer::new(&config, &piece).unwrap(), ScriptedPlayer::new(&config, &piece).unwrap());
}

#[test]
fn every_target_lies_in_its_range() {
    for id in repertoire::ids() {
        let piece = piece(id);
        let player = ScriptedPlayer::new(&TaskConfig::default(), &piece).unwrap();
        for step in 0..piece.steps() + 3 {
            for (joint, target) in player.targets(step).into_iter().enumerate() {
                let [low, high] = joint_range(joint);
                assert!((low..=high).contains(&target), "{id}: joint {joint} at step {step}: {target}");
            }
        }
    }
}

#[test]
fn what_cannot_be_reached_is_reported() {
    for (chord, kind, skipped) in [
        (&[36, 84][..], LimitKind::OutOfReach, 1),
        (&[60, 61], LimitKind::OutOfReach, 1),
        (&[60, 62, 64, 65, 67], LimitKind::TooManyKeys, 2),
        (&[60, 64, 67], LimitKind::OutOfReach, 0),
    ] {
        let player = ScriptedPlayer::new(&TaskConfig::default(), &chords(&[chord])).unwrap();
        let found: Vec<_> = player.limits().skipped().map(|limit| limit.kind).collect();
        assert!(found.len() >= skipped && found.len() < chord.len(), "{chord:?}: {}", player.limits());
        assert!(found.iter().all(|found| *found == kind), "{chord:?}: {}", player.limits());
    }
}

#[test]
fn a_jump_across_the_keyboard_is_reported() {
    let player = ScriptedPlayer::new(&TaskConfig::default(), &chords(&[&[36], &[84]])).unwrap();
    let [limit] = player.limits().notes[..] else { panic!("{}", player.limits()) };
    assert!(matches!(limit.kind, LimitKind::RailTooSlow(travel) if travel > 0.5), "{limit}");
    assert_eq!(limit.key, 0);
    assert!(limit.to_string().contains("C2 at 1.00 s ends"), "{limit}");
}

#[test]
fn silence_is_kept() {
    let silent = Piece::new(&Song::new("silence", Vec::new(), 2.0).unwrap(), 1.0).unwrap();
    assert!(silent.frames().iter().all(|due| *due == KeySet::EMPTY));
    assert_eq!(f1(&TaskConfig::default(), &silent), 1.0);
}
