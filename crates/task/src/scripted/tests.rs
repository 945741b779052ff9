use etude_music::{Note, Song, repertoire};
use etude_stage::joint_range;

use super::*;
use crate::fingering::UnplayedReason;

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

#[test]
fn the_same_song_gives_the_same_plan() {
    let piece = piece("happy-birthday");
    let config = TaskConfig::default();
    assert_eq!(
        ScriptedBaseline::new(&config, &piece).unwrap(),
        ScriptedBaseline::new(&config, &piece).unwrap()
    );
}

#[test]
fn every_target_lies_in_its_range() {
    for id in repertoire::ids() {
        let piece = piece(id);
        let player = ScriptedBaseline::new(&TaskConfig::default(), &piece).unwrap();
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
        (&[36, 84][..], UnplayedReason::OutOfReach, 1),
        (&[60, 61], UnplayedReason::OutOfReach, 1),
        (&[60, 62, 64, 65, 67], UnplayedReason::TooManyKeys, 2),
        (&[60, 64, 67], UnplayedReason::OutOfReach, 0),
    ] {
        let player = ScriptedBaseline::new(&TaskConfig::default(), &chords(&[chord])).unwrap();
        let found: Vec<_> = player.unplayed().omitted().map(|limit| limit.reason).collect();
        assert!(found.len() >= skipped && found.len() < chord.len(), "{chord:?}: {}", player.unplayed());
        assert!(found.iter().all(|found| *found == kind), "{chord:?}: {}", player.unplayed());
    }
}

#[test]
fn a_jump_across_the_keyboard_is_reported() {
    let player = ScriptedBaseline::new(&TaskConfig::default(), &chords(&[&[36], &[84]])).unwrap();
    let [limit] = player.unplayed().notes[..] else { panic!("{}", player.unplayed()) };
    assert!(matches!(limit.reason, UnplayedReason::RailTooSlow(travel) if travel > 0.5), "{limit}");
    assert_eq!(limit.key, 0);
    assert!(limit.to_string().contains("C2 at 1.00 s is 0.80 s shorter"), "{limit}");
}
