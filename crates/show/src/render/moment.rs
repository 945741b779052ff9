//! The scene at a time of a recording: joints, colours of the keys, shadows of the fingertips, the
//! arm.

use etude_music::{KEY_COUNT, LOWEST_PITCH};
use etude_stage::{DRIVEN_JOINTS, SceneGeom};
use nalgebra::{UnitQuaternion, Vector3};

use crate::replay::{Arm, DUE_COLOUR, NoteJudgement, Take};

/// Height of the fingertips' shadows, just above the white keys, m.
const FLOOR: f64 = 0.0229;
/// Radius of a fingertip's shadow when it touches, m, and height at which it vanishes, m.
const SHADOW: [f64; 2] = [0.016, 0.06];
/// Shadows of one fingertip, one in another, which make its edge soft.
const SHADOWS: u32 = 4;
/// Colour of the arm's links, as on the replay page.
const ARM: [f32; 4] = [0.86, 0.87, 0.88, 1.0];

/// Joint positions at `secs`, between the control steps on a straight line.
pub(super) fn joints_at(take: &Take, secs: f64) -> [f64; DRIVEN_JOINTS] {
    let last = take.positions.len() - 1;
    // Row `i` is the end of step `i`; before the first there is the start, if it is known.
    let index = take.step_at(secs).clamp(-1.0, last as f64);
    let row = |index: f64| match &take.start {
        Some(start) if index < 0.0 => start,
        _ => &take.positions[index.max(0.0) as usize],
    };
    let (from, to) = (row(index.floor()), row(index.ceil()));
    let share = index - index.floor();
    std::array::from_fn(|joint| from[joint] + share * (to[joint] - from[joint]))
}

/// The colours of keys that are due or sound, as on the replay page.
pub(super) fn key_colours(take: &Take, secs: f64) -> [Option<[f32; 3]>; KEY_COUNT] {
    let mut colours = [None; KEY_COUNT];
    let mut light = |pitch: u8, colour: [u8; 3]| {
        let key = pitch.checked_sub(LOWEST_PITCH).and_then(|key| colours.get_mut(usize::from(key)));
        if let Some(key) = key {
            *key = Some(colour.map(|value| f32::from(value) / 255.0));
        }
    };
    for note in take.due_notes.iter().filter(|note| (note.start..note.end).contains(&secs)) {
        light(note.pitch, DUE_COLOUR);
    }
    let mut now = take.judged_notes();
    now.retain(|judged| (judged.note.start..judged.note.end).contains(&secs));
    // The last onset counts: a key that is held from the note before does not play the next one.
    now.sort_by(|one, other| one.note.start.total_cmp(&other.note.start));
    for judged in now.iter().filter(|judged| judged.judgement != NoteJudgement::Unjudged) {
        light(judged.note.pitch, judged.judgement.colour());
    }
    colours
}

/// The soft shadow of a fingertip at `tip` on the white keys: smaller and fainter, the higher it
/// is.
pub(super) fn shadow([x, y, z]: [f64; 3]) -> impl Iterator<Item = SceneGeom> {
    let [radius, height] = SHADOW;
    let near = 1.0 - ((z - FLOOR) / height).clamp(0.0, 1.0);
    let layers = if near > 0.0 { SHADOWS } else { 0 };
    (1..=layers).map(move |layer| {
        let radius = radius * f64::from(layer) / f64::from(SHADOWS) * (1.6 - 0.6 * near);
        SceneGeom {
            name: String::new(),
            body: -1,
            kind: "ellipsoid".to_string(),
            size: [radius, radius, 0.0002],
            pos: [x, y, FLOOR + 0.00005 * f64::from(layer)],
            quat: [1.0, 0.0, 0.0, 0.0],
            rgba: [0.0, 0.0, 0.0, 0.12 * near as f32],
        }
    })
}

/// The links of the arm at the end of control step `step`, between two on straight lines, as tubes.
pub(super) fn links(arm: &Arm, step: f64) -> Vec<SceneGeom> {
    let last = arm.points.len().saturating_sub(1) as f64;
    let step = step.clamp(0.0, last);
    let row = |step: f64| arm.points.get(step as usize).map_or(&[][..], Vec::as_slice);
    let (from, to) = (row(step.floor()), row(step.ceil()));
    let share = step - step.floor();
    let row: Vec<f64> = from.iter().zip(to).map(|(from, to)| from + share * (to - from)).collect();
    let points: Vec<Vector3<f64>> = row.chunks_exact(3).map(Vector3::from_column_slice).collect();
    let tube = |(ends, radius): (&[Vector3<f64>], &f64)| {
        let link = ends[1] - ends[0];
        let turn = UnitQuaternion::rotation_between(&Vector3::z(), &link)
            .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
        SceneGeom {
            name: String::new(),
            body: -1,
            kind: "capsule".to_string(),
            size: [*radius, link.norm() / 2.0, 0.0],
            pos: ((ends[0] + ends[1]) / 2.0).into(),
            quat: [turn.w, turn.i, turn.j, turn.k],
            rgba: ARM,
        }
    };
    points.windows(2).zip(&arm.radii).map(tube).collect()
}

#[cfg(test)]
pub(super) mod tests {
    use etude_perform::{Activity, DueNote, Header, KeyMessage, Recording, StepMessage};

    use super::*;
    use crate::replay::TakeNote;

    /// Rest in simulation, with the keys that are due, pressed and struck.
    fn take(steps: Vec<StepMessage>, due: Vec<Vec<u8>>, keys: Vec<KeyMessage>) -> Take {
        let due_notes = if due.is_empty() {
            Vec::new()
        } else {
            vec![DueNote { pitch: 60, velocity: 80, start_secs: 0.5, end_secs: 1.0 }]
        };
        let header =
            Header { control_hz: 20.0, activity: Activity::Rest, due, due_notes, ..Header::default() };
        let recording = Recording { header, steps, keys, complete: true, ..Recording::default() };
        Take::new(&recording, "r".to_string()).unwrap()
    }

    #[test]
    fn joints_move_on_straight_lines_between_the_ends_of_steps() {
        // The start pose is known of a simulation only.
        let step =
            |value: f64| StepMessage { positions: vec![value; DRIVEN_JOINTS], ..StepMessage::default() };
        let take = take(vec![step(0.1), step(0.3)], Vec::new(), Vec::new());
        for (secs, value) in [(0.0, 0.1), (0.05, 0.1), (0.075, 0.2), (0.1, 0.3), (9.0, 0.3)] {
            assert!((joints_at(&take, secs)[0] - value).abs() < 1e-9, "{secs}");
        }
    }

    /// A note that is due in the second half of a second, and a stroke of `pitch` at `start`.
    pub fn second(pitch: u8, start: f64) -> Take {
        let step = |index: usize| StepMessage {
            positions: vec![0.0; DRIVEN_JOINTS],
            pressed: if index < 10 { Vec::new() } else { vec![pitch] },
            ..StepMessage::default()
        };
        let due = (0..20).map(|index| if index < 10 { Vec::new() } else { vec![60] }).collect();
        let key = |secs, velocity| KeyMessage { secs, pitch, velocity };
        take((0..20).map(step).collect(), due, vec![key(start, 80), key(1.0, 0)])
    }

    #[test]
    fn keys_are_lit_as_they_are_played() {
        let colour = |take: &Take, secs: f64, pitch: u8| {
            key_colours(take, secs)[usize::from(pitch - LOWEST_PITCH)]
                .map(|colour| colour.map(|value| (255.0 * value).round() as u8))
        };
        // A few milliseconds late are right, and until then the key is due.
        let right = second(60, 0.53);
        assert_eq!(colour(&right, 0.2, 60), None);
        assert_eq!(colour(&right, 0.52, 60), Some(DUE_COLOUR));
        assert_eq!(colour(&right, 0.6, 60), Some(NoteJudgement::Right.colour()));
        assert_eq!(colour(&second(60, 0.6), 0.7, 60), Some(NoteJudgement::OutOfTime.colour()));
        let wrong = second(62, 0.5);
        assert_eq!(colour(&wrong, 0.6, 60), Some(NoteJudgement::Missed.colour()));
        assert_eq!(colour(&wrong, 0.6, 62), Some(NoteJudgement::Wrong.colour()));
        // Down since long before, it plays nothing.
        let mut held = take(Vec::new(), vec![vec![60]], Vec::new());
        held.notes = vec![TakeNote { start: 0.0, ..held.due_notes[0] }];
        assert_eq!(colour(&held, 0.4, 60), Some(NoteJudgement::Wrong.colour()));
        assert_eq!(colour(&held, 0.6, 60), Some(NoteJudgement::Missed.colour()));
    }

    #[test]
    fn the_links_of_an_arm_are_tubes_between_its_points() {
        let row = |x: f64| vec![x, 0.0, 0.0, x, 0.0, 0.4, x, 0.3, 0.4];
        let arm = Arm { radii: vec![0.05, 0.04], points: vec![row(0.0), row(0.2)] };
        assert!(links(&Arm { points: Vec::new(), ..arm.clone() }, 0.0).is_empty());
        let tubes = links(&arm, 0.5);
        assert_eq!(tubes.len(), 2);
        for (tube, (pos, half, axis)) in
            tubes.iter().zip([([0.1, 0.0, 0.2], 0.2, Vector3::z()), ([0.1, 0.15, 0.4], 0.15, Vector3::y())])
        {
            assert!((Vector3::from(tube.pos) - Vector3::from(pos)).norm() < 1e-12, "{tube:?}");
            assert!((tube.size[1] - half).abs() < 1e-12, "{tube:?}");
            let [w, i, j, k] = tube.quat;
            let turned =
                UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, i, j, k)) * Vector3::z();
            assert!((turned - axis).norm() < 1e-9, "{tube:?}");
        }
        assert_eq!(links(&arm, 7.0)[0].pos[0], 0.2);
    }
}
