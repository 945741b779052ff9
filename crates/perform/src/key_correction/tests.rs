use etude_music::{KeyEvent, notes_from_key_events};
use etude_robot::rig_file::SETPOINT_HZ;
use etude_stage::geometry::key_target;
use etude_stage::kinematics::reach;

use super::*;
use crate::correction::Tracking;

const SIDE: Side = Side::Left;
const FINGER: usize = 1;
const KEY: usize = 24;
/// Height over its key from which a finger comes down, and where the key sounds, m.
const LIFTED: f64 = 0.012;
const SOUNDS: f64 = -0.004;

fn deeper(corrections: &KeyCorrections) -> Vec<f64> {
    corrections.0.iter().map(|correction| correction.deeper).collect()
}

fn strokes(planned: &[Note], played: &[Note]) -> PlannedAndPlayed {
    PlannedAndPlayed { planned: planned.to_vec(), played: played.to_vec(), end_secs: 10.0 }
}

fn note(pitch: u8, start_secs: f64, end_secs: f64) -> Note {
    Note { pitch, velocity: 64, start_secs, end_secs }
}

/// A note that begins when its key goes down halfway, in a path of 1.5 s.
fn planned() -> [Note; 1] {
    [note(LOWEST_PITCH + KEY as u8, 0.5, 1.0)]
}

/// The path of a finger that strikes the key in 80 ms and holds it.
fn path() -> Vec<[f64; DRIVEN_JOINTS]> {
    let [x, y, z] = key_target(KEY);
    let rail = y - fingertip(SIDE, FINGER, &[0.0, 0.5, 0.8, 0.3], 0.0)[1];
    (0..300)
        .map(|tick| {
            let secs = f64::from(tick) / SETPOINT_HZ;
            let down = ((secs - 0.42) / 0.1).min((1.08 - secs) / 0.1).clamp(0.0, 1.0);
            let mut pose = [0.1; DRIVEN_JOINTS];
            let target = [x, y, z + LIFTED - 0.02 * down];
            let angles = reach(SIDE, FINGER, target, rail).expect("within reach");
            pose[FINGER * JOINTS_PER_FINGER..][..JOINTS_PER_FINGER].copy_from_slice(&angles);
            pose[RAIL] = rail;
            pose
        })
        .collect()
}

fn tips(asked: &[[f64; DRIVEN_JOINTS]], added: &Correction) -> Vec<[f64; 3]> {
    let sent = Tracking { asked: asked.to_vec(), measured: Vec::new() }.asked_for(added).asked;
    sent.iter().map(|pose| fingertip(SIDE, FINGER, &angles(pose, FINGER), pose[RAIL])).collect()
}

/// What a robot plays that follows its set-points exactly, on a keyboard that is `lower`, m.
fn play(asked: &[[f64; DRIVEN_JOINTS]], added: &Correction, lower: f64) -> Vec<Note> {
    let mut sounds = false;
    let mut events = Vec::new();
    for (tick, tip) in tips(asked, added).iter().enumerate() {
        let now = tip[2] < key_target(KEY)[2] + SOUNDS - lower;
        if now != sounds {
            let velocity = if now { 64 } else { 0 };
            events.push(KeyEvent { secs: tick as f64 / SETPOINT_HZ, key: KEY, velocity });
        }
        sounds = now;
    }
    notes_from_key_events(&events, asked.len() as f64 / SETPOINT_HZ)
}

#[test]
fn a_keyboard_that_is_lower_or_higher_is_played_as_long_as_planned() {
    let (asked, planned) = (path(), planned());
    for (lower, silent) in [(0.003, false), (0.006, true), (-0.003, false)] {
        let mut corrections = KeyCorrections::default();
        let first = play(&asked, &Correction::default(), lower);
        assert_eq!(first.is_empty(), silent, "{lower}");
        for _ in 0..15 {
            let mut played = play(&asked, &corrections.offsets(&asked, &planned, SIDE), lower);
            // Another finger plays another note.
            let other = note(planned[0].pitch + 10, 0.5, 1.0);
            played.push(other);
            corrections = corrections.after(&strokes(&[planned[0], other], &played), 0.0);
        }
        let last = play(&asked, &corrections.offsets(&asked, &planned, SIDE), lower);
        assert_eq!(last.len(), 1);
        assert!((last[0].duration_secs() - 0.5).abs() < 0.02, "{lower}: {:?} after {corrections:?}", last[0]);
    }
}

#[test]
fn a_stroke_beside_the_key_moves_the_finger_to_the_other_side_and_no_joint_of_another() {
    let (asked, planned) = (path(), planned());
    let before = tips(&asked, &Correction::default());
    for (wrong, toward) in [(1, -1.0), (2, -1.0), (-1, 1.0), (-2, 1.0)] {
        let pitch = planned[0].pitch.checked_add_signed(wrong).unwrap();
        // The right key sounds as planned, too: nothing but the side is to be learned.
        let played = [note(pitch, 0.57, 0.6), note(planned[0].pitch, 0.6, 1.1)];
        let offsets =
            KeyCorrections::default().after(&strokes(&planned, &played), 0.1).offsets(&asked, &planned, SIDE);
        let moved = tips(&asked, &offsets)[150][1] - before[150][1];
        assert!((moved - toward * ASIDE_M).abs() < 0.2 * ASIDE_M, "{wrong}: {moved}");
        let others = |joint: &usize| joint / JOINTS_PER_FINGER != FINGER;
        for offsets in offsets.offsets() {
            assert!((0..DRIVEN_JOINTS).filter(others).all(|joint| offsets[joint] == 0.0));
        }
        assert_eq!(offsets.offsets()[60], [0.0; DRIVEN_JOINTS], "long before the note");
    }
    // A stroke that is another planned note, and one at another time, are not wrong.
    let two = [planned[0], note(planned[0].pitch + 2, 0.5, 1.0)];
    for played in [two, [planned[0], note(planned[0].pitch + 1, 0.9, 1.0)]] {
        let corrections = KeyCorrections::default().after(&strokes(&two, &played), 0.0);
        assert!(corrections.0.iter().all(|correction| correction.aside == 0.0), "{corrections:?}");
    }
}

#[test]
fn aims_are_bounded_and_a_song_begins_at_rest() {
    let asked = path();
    let planned = [note(LOWEST_PITCH + KEY as u8, 0.0, 1.0)];
    let played = [note(planned[0].pitch, 0.0, 0.5), note(planned[0].pitch + 1, 0.0, 0.6)];
    let mut corrections = KeyCorrections::default();
    for _ in 0..50 {
        corrections = corrections.after(&strokes(&planned, &played), 0.0);
    }
    assert_eq!(corrections.0, [KeyCorrection { aside: -MAX_CORRECTION[0], deeper: MAX_CORRECTION[1] }]);
    let offsets = corrections.offsets(&asked, &planned, SIDE);
    assert_eq!(offsets.offsets()[0], [0.0; DRIVEN_JOINTS]);
    assert!(offsets.offsets()[100] != [0.0; DRIVEN_JOINTS]);
}

#[test]
fn what_is_no_fault_of_the_aim_changes_nothing() {
    let pitch = LOWEST_PITCH + KEY as u8;
    // The keyboard is silent; the performance ends before the last key could be let go.
    let planned = [note(pitch, 0.5, 1.0), note(pitch + 4, 1.0, 1.5)];
    assert_eq!(KeyCorrections::default().after(&strokes(&planned, &[]), 0.1), KeyCorrections::default());
    let played = [note(pitch, 0.6, 1.1), note(pitch + 4, 1.1, 1.5)];
    let corrections = KeyCorrections::default()
        .after(&PlannedAndPlayed { end_secs: 1.5, ..strokes(&planned, &played) }, 0.1);
    assert!(
        corrections.0.iter().all(|correction| correction.deeper.abs() < 1e-9 && correction.aside == 0.0),
        "{corrections:?}"
    );
}

#[test]
fn a_key_that_stays_down_is_pressed_less_deep_the_next_time_and_a_silent_one_deeper() {
    let pitch = LOWEST_PITCH + KEY as u8;
    let planned = [note(pitch, 0.5, 0.9), note(pitch, 1.0, 1.4), note(pitch + 5, 1.0, 1.4)];
    let played = [note(pitch, 0.5, 1.4), note(pitch + 5, 1.0, 1.4)];
    let corrections = KeyCorrections::default().after(&strokes(&planned, &played), 0.0);
    assert_eq!(deeper(&corrections), [-DEEPER_M, -DEEPER_M, 0.0]);
    let corrections = KeyCorrections::default().after(&strokes(&planned, &[planned[0], planned[2]]), 0.0);
    assert_eq!(deeper(&corrections), [0.0, DEEPER_M, 0.0]);
}

/// Of two notes beside which a wrong key sounded, the one that is missing was aimed wrongly.
#[test]
fn a_stray_stroke_in_a_chord_moves_one_finger() {
    let pitch = LOWEST_PITCH + KEY as u8;
    let planned = [note(pitch, 0.5, 1.0), note(pitch + 4, 0.5, 1.0)];
    let played = [note(pitch, 0.5, 1.0), note(pitch + 2, 0.52, 1.0)];
    let corrections = KeyCorrections::default().after(&strokes(&planned, &played), 0.0);
    assert_eq!(corrections.0.iter().map(|correction| correction.aside).collect::<Vec<_>>(), [0.0, ASIDE_M]);
}
