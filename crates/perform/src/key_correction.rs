//! Where a robot's fingers aim at their keys, learned from the keys themselves. Where the keyboard stands otherwise than in the simulation,
//! a finger that follows its path exactly strikes late and lets go early, strikes the key beside it, or stands on a fence.
//! [`Correction`] brings the joints to their path, and this moves the path.

use etude_music::{LOWEST_PITCH, Note};
use etude_stage::geometry::{WHITE_PITCH, key_lateral};
use etude_stage::hand::JOINTS_PER_FINGER;
use etude_stage::kinematics::fingertip;
use etude_stage::{DRIVEN_JOINTS, FINGERS, RAIL, Side, joint_range};
use serde::{Deserialize, Serialize};

use crate::correction::{Correction, grown, ticks};

/// Where the finger of each planned note aims, in the order of the notes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct KeyCorrections(Vec<Aim>);

/// Where a finger aims for a note: the distance from its path in the simulation, m.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Aim {
    /// To the side of the higher keys; negative is to that of the lower keys.
    aside: f64,
    /// Downward; negative is upward.
    deeper: f64,
}

/// The notes of a performance.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlayedNotes {
    /// Those that were planned, at times of the control steps.
    pub planned: Vec<Note>,
    /// Those that were played.
    pub played: Vec<Note>,
    /// When the performance ended, s. A key that was down then was not let go.
    pub end_secs: f64,
}

/// How much deeper a finger aims for each second by which its note was shorter than planned, m/s: a quarter of the speed of a
/// stroke, since a finger that is not deep enough begins the note late and ends it early.
const DEEPER_PER_SECOND: f64 = 0.05;
/// The most by which a finger aims deeper or less deep after a run, and the amount for a note that was not played, m.
const DEEPER: f64 = 0.002;
/// The most by which it aims further aside after a run, and the amount after a stroke of a key beside its own, m.
const ASIDE: f64 = 0.001;
/// The largest aim, aside and deeper, m.
const MOST: [f64; 2] = [0.004, 0.005];
/// A stroke this long before or after its time is not a stroke of the note, s.
const SAME_NOTE_SECS: f64 = 0.15;
/// Time in which a finger moves to its aim before a note, and returns after it, s.
const RAMP_SECS: f64 = 0.1;
/// A tip that moves less than this for each radian by which its finger turns, m, is moved by less than the aim: the angle would be too large.
const LEAST_SLOPE: f64 = 0.02;
/// Angle by which a joint is turned to find how far that moves the fingertip, rad.
const TURN: f64 = 1e-4;

impl KeyCorrections {
    /// The aims for the next run, after one with these. It should have played its notes `late_secs` later than planned. If fewer than half of
    /// them sounded, the aims stay: then something else is wrong than where the fingers aim.
    #[must_use]
    pub fn after(&self, strokes: &PlayedNotes, late_secs: f64) -> Self {
        let heard = Heard { strokes, late_secs };
        let matched: Vec<Option<&Note>> = strokes.planned.iter().map(|note| heard.stroke_of(note)).collect();
        if 2 * matched.iter().flatten().count() < strokes.planned.len() {
            return self.clone();
        }
        let mut next: Vec<Aim> = (strokes.planned.iter().zip(&matched).enumerate())
            .map(|(index, (note, stroke))| {
                let before = self.0.get(index).copied().unwrap_or_default();
                let deeper = match stroke {
                    Some(stroke) => DEEPER_PER_SECOND * heard.shorter_secs(note, stroke),
                    // Its key did not come up before.
                    None if heard.is_held_before(note) => -DEEPER,
                    None => DEEPER,
                };
                let deeper = (before.deeper + deeper.clamp(-DEEPER, DEEPER)).clamp(-MOST[1], MOST[1]);
                Aim { deeper, ..before }
            })
            .collect();
        for wrong in &strokes.played {
            // Of the notes beside which it may be, one that did not sound, and then the nearest.
            let beside = (strokes.planned.iter().zip(&matched).enumerate())
                .filter(|(_, (note, _))| heard.is_beside(note, wrong))
                .min_by(|(_, (a, played_a)), (_, (b, played_b))| {
                    let distances = heard.distance(a, wrong).total_cmp(&heard.distance(b, wrong));
                    played_a.is_some().cmp(&played_b.is_some()).then(distances)
                });
            if let Some((index, (note, _))) = beside
                && !strokes
                    .planned
                    .iter()
                    .any(|other| heard.is_near(other, wrong) && other.pitch == wrong.pitch)
            {
                let away = (f64::from(note.pitch) - f64::from(wrong.pitch)).signum();
                next[index].aside = (next[index].aside + ASIDE * away).clamp(-MOST[0], MOST[0]);
            }
        }
        Self(next)
    }

    /// What the aims add to the set-points `asked` of the planned notes (at the end of each physics step: rad, the rail in m). For a note
    /// over whose key there is no finger, nothing.
    pub fn offsets(&self, asked: &[[f64; DRIVEN_JOINTS]], planned: &[Note], side: Side) -> Correction {
        // For each physics step and finger: the sum of the weights, and of the weighted aims.
        let mut sums = vec![[(0.0, Aim::default()); FINGERS]; asked.len()];
        for (note, aim) in planned.iter().zip(&self.0) {
            let Some(finger) = pressing(asked, note, side) else { continue };
            let [first, last, ramp] = [note.start_secs, note.end_secs, RAMP_SECS].map(ticks);
            let around = first.saturating_sub(ramp)..(last + ramp).min(asked.len());
            for (tick, sums) in sums.iter_mut().enumerate().take(around.end).skip(around.start) {
                let outside = first.saturating_sub(tick).max(tick.saturating_sub(last));
                let weight = 1.0 - outside as f64 / ramp as f64;
                let (weights, sum) = &mut sums[finger];
                *weights += weight;
                sum.aside += weight * aim.aside;
                sum.deeper += weight * aim.deeper;
            }
        }
        let offsets = asked.iter().zip(sums).enumerate().map(|(tick, (pose, sums))| {
            let mut offsets = [0.0; DRIVEN_JOINTS];
            for (finger, (weights, sum)) in
                sums.into_iter().enumerate().filter(|(_, (weights, _))| *weights > 0.0)
            {
                let weights = f64::max(weights, 1.0);
                let aim = Aim { aside: sum.aside / weights, deeper: sum.deeper / weights };
                for (joint, turn) in (finger * JOINTS_PER_FINGER..).zip(turned(pose, finger, side, aim)) {
                    let [low, high] = joint_range(joint);
                    offsets[joint] = (pose[joint] + grown(tick) * turn).clamp(low, high) - pose[joint];
                }
            }
            offsets
        });
        Correction::of(offsets.collect())
    }
}

/// The notes of a run, and how much later than planned they should be.
struct Heard<'a> {
    strokes: &'a PlayedNotes,
    late_secs: f64,
}

impl<'a> Heard<'a> {
    /// How far a stroke is from the time of a note, s.
    fn distance(&self, note: &Note, stroke: &Note) -> f64 {
        (note.start_secs + self.late_secs - stroke.start_secs).abs()
    }

    fn is_near(&self, note: &Note, stroke: &Note) -> bool {
        self.distance(note, stroke) <= SAME_NOTE_SECS
    }

    fn is_beside(&self, note: &Note, stroke: &Note) -> bool {
        self.is_near(note, stroke) && (1..=2).contains(&stroke.pitch.abs_diff(note.pitch))
    }

    /// The stroke that plays this note: of those of its key the nearest, if it is near and no other note is nearer to it.
    fn stroke_of(&self, note: &Note) -> Option<&'a Note> {
        let of_its_key = self.strokes.played.iter().filter(|stroke| stroke.pitch == note.pitch);
        let stroke = of_its_key
            .filter(|stroke| self.is_near(note, stroke))
            .min_by(|a, b| self.distance(note, a).total_cmp(&self.distance(note, b)))?;
        let mut others = self.strokes.planned.iter().filter(|other| other.pitch == note.pitch);
        others.all(|other| self.distance(other, stroke) >= self.distance(note, stroke)).then_some(stroke)
    }

    /// By how much a stroke was shorter than its note, s. What is planned after the end of the performance does not count.
    fn shorter_secs(&self, note: &Note, stroke: &Note) -> f64 {
        let end_secs = (note.end_secs + self.late_secs).min(self.strokes.end_secs);
        end_secs - self.late_secs - note.start_secs - stroke.duration_secs()
    }

    /// Whether the key of this note was down already when it should have been struck.
    fn is_held_before(&self, note: &Note) -> bool {
        let due_secs = note.start_secs + self.late_secs;
        self.strokes.played.iter().any(|stroke| {
            stroke.pitch == note.pitch && stroke.start_secs < due_secs && stroke.end_secs > due_secs
        })
    }
}

/// The finger that presses the key of `note` in the middle of it: of those over the key the lowest.
fn pressing(asked: &[[f64; DRIVEN_JOINTS]], note: &Note, side: Side) -> Option<usize> {
    let pose = asked.get(ticks((note.start_secs + note.end_secs) / 2.0))?;
    let key = usize::from(note.pitch.checked_sub(LOWEST_PITCH)?);
    (0..FINGERS)
        .map(|finger| (finger, fingertip(side, finger, &angles(pose, finger), pose[RAIL])))
        .filter(|(_, tip)| (tip[1] - key_lateral(key)).abs() < WHITE_PITCH / 2.0)
        .min_by(|(_, a), (_, b)| a[2].total_cmp(&b[2]))
        .map(|(finger, _)| finger)
}

/// How far the joints of a finger turn to move its tip to this aim: the first aside, the others down with the least motion.
fn turned(pose: &[f64; DRIVEN_JOINTS], finger: usize, side: Side, aim: Aim) -> [f64; JOINTS_PER_FINGER] {
    let tip = |angles: &[f64; JOINTS_PER_FINGER]| fingertip(side, finger, angles, pose[RAIL]);
    let here = angles(pose, finger);
    // How far the tip goes for each radian by which a joint turns, along `axis`.
    let slope = |joint: usize, axis: usize| {
        let mut turned = here;
        turned[joint] += TURN;
        (tip(&turned)[axis] - tip(&here)[axis]) / TURN
    };
    let lowers: [f64; JOINTS_PER_FINGER] =
        std::array::from_fn(|joint| if joint == 0 { 0.0 } else { -slope(joint, 2) });
    let squares: f64 = lowers.iter().map(|lowers| lowers * lowers).sum();
    let mut turns = lowers.map(|lowers| aim.deeper * lowers / squares.max(LEAST_SLOPE.powi(2)));
    // A finger that turns toward the palm's +y goes to the lower keys.
    turns[0] = aim.aside / slope(0, 1).min(-LEAST_SLOPE);
    turns
}

fn angles(pose: &[f64; DRIVEN_JOINTS], finger: usize) -> [f64; JOINTS_PER_FINGER] {
    std::array::from_fn(|joint| pose[finger * JOINTS_PER_FINGER + joint])
}

#[cfg(test)]
mod tests {
    use etude_music::{KeyEvent, notes_from_key_events};
    use etude_robot::rig::SETPOINT_HZ;
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

    fn deeper(aims: &KeyCorrections) -> Vec<f64> {
        aims.0.iter().map(|aim| aim.deeper).collect()
    }

    fn strokes(planned: &[Note], played: &[Note]) -> PlayedNotes {
        PlayedNotes { planned: planned.to_vec(), played: played.to_vec(), end_secs: 10.0 }
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
            let mut aims = KeyCorrections::default();
            let first = play(&asked, &Correction::default(), lower);
            assert_eq!(first.is_empty(), silent, "{lower}");
            for _ in 0..15 {
                let mut played = play(&asked, &aims.offsets(&asked, &planned, SIDE), lower);
                // Another finger plays another note.
                let other = note(planned[0].pitch + 10, 0.5, 1.0);
                played.push(other);
                aims = aims.after(&strokes(&[planned[0], other], &played), 0.0);
            }
            let last = play(&asked, &aims.offsets(&asked, &planned, SIDE), lower);
            assert_eq!(last.len(), 1);
            assert!((last[0].duration_secs() - 0.5).abs() < 0.02, "{lower}: {:?} after {aims:?}", last[0]);
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
            let offsets = KeyCorrections::default()
                .after(&strokes(&planned, &played), 0.1)
                .offsets(&asked, &planned, SIDE);
            let moved = tips(&asked, &offsets)[150][1] - before[150][1];
            assert!((moved - toward * ASIDE).abs() < 0.2 * ASIDE, "{wrong}: {moved}");
            let others = |joint: &usize| joint / JOINTS_PER_FINGER != FINGER;
            for offsets in offsets.offsets() {
                assert!((0..DRIVEN_JOINTS).filter(others).all(|joint| offsets[joint] == 0.0));
            }
            assert_eq!(offsets.offsets()[60], [0.0; DRIVEN_JOINTS], "long before the note");
        }
        // A stroke that is another planned note, and one at another time, are not wrong.
        let two = [planned[0], note(planned[0].pitch + 2, 0.5, 1.0)];
        for played in [two, [planned[0], note(planned[0].pitch + 1, 0.9, 1.0)]] {
            let aims = KeyCorrections::default().after(&strokes(&two, &played), 0.0);
            assert!(aims.0.iter().all(|aim| aim.aside == 0.0), "{aims:?}");
        }
    }

    #[test]
    fn aims_are_bounded_and_a_song_begins_at_rest() {
        let asked = path();
        let planned = [note(LOWEST_PITCH + KEY as u8, 0.0, 1.0)];
        let played = [note(planned[0].pitch, 0.0, 0.5), note(planned[0].pitch + 1, 0.0, 0.6)];
        let mut aims = KeyCorrections::default();
        for _ in 0..50 {
            aims = aims.after(&strokes(&planned, &played), 0.0);
        }
        assert_eq!(aims.0, [Aim { aside: -MOST[0], deeper: MOST[1] }]);
        let offsets = aims.offsets(&asked, &planned, SIDE);
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
        let aims = KeyCorrections::default()
            .after(&PlayedNotes { end_secs: 1.5, ..strokes(&planned, &played) }, 0.1);
        assert!(aims.0.iter().all(|aim| aim.deeper.abs() < 1e-9 && aim.aside == 0.0), "{aims:?}");
    }

    #[test]
    fn a_key_that_stays_down_is_pressed_less_deep_the_next_time_and_a_silent_one_deeper() {
        let pitch = LOWEST_PITCH + KEY as u8;
        let planned = [note(pitch, 0.5, 0.9), note(pitch, 1.0, 1.4), note(pitch + 5, 1.0, 1.4)];
        let played = [note(pitch, 0.5, 1.4), note(pitch + 5, 1.0, 1.4)];
        let aims = KeyCorrections::default().after(&strokes(&planned, &played), 0.0);
        assert_eq!(deeper(&aims), [-DEEPER, -DEEPER, 0.0]);
        let aims = KeyCorrections::default().after(&strokes(&planned, &[planned[0], planned[2]]), 0.0);
        assert_eq!(deeper(&aims), [0.0, DEEPER, 0.0]);
    }

    /// Of two notes beside which a wrong key sounded, the one that is missing was aimed wrongly.
    #[test]
    fn a_stray_stroke_in_a_chord_moves_one_finger() {
        let pitch = LOWEST_PITCH + KEY as u8;
        let planned = [note(pitch, 0.5, 1.0), note(pitch + 4, 0.5, 1.0)];
        let played = [note(pitch, 0.5, 1.0), note(pitch + 2, 0.52, 1.0)];
        let aims = KeyCorrections::default().after(&strokes(&planned, &played), 0.0);
        assert_eq!(aims.0.iter().map(|aim| aim.aside).collect::<Vec<_>>(), [0.0, ASIDE]);
    }
}
