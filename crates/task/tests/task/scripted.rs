//! What the scripted baseline plays.

use etude_music::metrics::frame_scores;
use etude_music::{KeySet, Song, repertoire};
use etude_stage::Side;
use etude_task::{Piece, ScriptedBaseline, TaskConfig};

use crate::bench::play_nominal;

fn piece(id: &str) -> Piece {
    Piece::new(&repertoire::get(id).unwrap(), 1.0).unwrap()
}

fn config(side: Side) -> TaskConfig {
    let mut config = TaskConfig::default();
    config.stage.side = side;
    config
}

fn f1(config: &TaskConfig, piece: &Piece) -> f64 {
    let mut player = ScriptedBaseline::new(config, piece).unwrap();
    frame_scores(piece.frames(), &play_nominal(config, piece, &mut player)).f1
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
fn silence_is_kept() {
    let silent = Piece::new(&Song::new("silence", Vec::new(), 2.0).unwrap(), 1.0).unwrap();
    assert!(silent.frames().iter().all(|due| *due == KeySet::EMPTY));
    assert_eq!(f1(&TaskConfig::default(), &silent), 1.0);
}
