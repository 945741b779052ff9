//! The observation: joints, previous joints, pressed keys, and the keys due now and in the next
//! control steps. Options add previous actions and a fingering.

use etude_learn::ObservationLayout;
use etude_music::{KEY_COUNT, KeySet, key_is_black};
use etude_stage::geometry::WHITE_PITCH;
use etude_stage::hand::JOINTS_PER_FINGER;
use etude_stage::{DRIVEN_JOINTS, FINGERS, RAIL, joint_range, kinematics};
use serde::{Deserialize, Serialize};

use crate::ACTION_LEN;
use crate::config::{MAX_PREVIOUS_ACTIONS, ObservationScale, ObservationView, TaskConfig};
use crate::fingering::{AHEAD_STEPS, Goal};
use crate::piece::Piece;
use crate::range::TargetRange;
use crate::window::{SLOTS, Window};

/// What an observation shows of earlier control steps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct History {
    /// Joints one control step ago.
    pub joints: [f64; DRIVEN_JOINTS],
    /// Previous actions, the newest first.
    pub actions: [[f32; ACTION_LEN]; MAX_PREVIOUS_ACTIONS],
}

impl History {
    /// The history at rest: `joints` have not moved, and the actions were those that hold them, as
    /// far as the range allows.
    pub fn at_rest(joints: [f64; DRIVEN_JOINTS], range: &TargetRange, step: usize) -> Self {
        Self { joints, actions: [range.action(&joints, step); MAX_PREVIOUS_ACTIONS] }
    }

    /// Adds a control step: `action` was chosen where the encoders read `joints`.
    pub fn push(&mut self, joints: [f64; DRIVEN_JOINTS], action: &[f32; ACTION_LEN]) {
        self.joints = joints;
        self.actions.rotate_right(1);
        self.actions[0] = *action;
    }
}

/// Real columns for each finger's goal, without its velocity: see [`observe`].
const GOAL_COLUMNS: usize = 3;
/// Largest distance from a goal that the observation shows, white keys.
const MAX_DISTANCE_KEYS: f64 = 4.0;

/// Columns of a finger's goal.
fn goal_columns(config: &TaskConfig) -> usize {
    GOAL_COLUMNS + usize::from(config.velocities)
}

/// What a group of columns shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ColumnKind {
    /// Joint readings.
    Joints,
    /// A previous action.
    Action,
    /// Of each finger the position relative to its goal, and the time until its note.
    Goals,
    /// Planned positions of the rail.
    Places,
    /// Keys that sound.
    Sounding,
    /// Keys that are due.
    Due,
    /// Black keys.
    Black,
    /// Fingers that should play.
    Playing,
}

impl ColumnKind {
    fn is_binary(self) -> bool {
        matches!(self, Self::Sounding | Self::Due | Self::Black | Self::Playing)
    }
}

/// Columns of the observation that stand side by side.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct ColumnGroup {
    /// What they show.
    pub kind: ColumnKind,
    /// How many control steps ago (joints, actions) or ahead (keys due, fingers that play).
    pub steps: usize,
    /// How many they are.
    pub columns: usize,
}

/// The groups of columns that `config` asks for, in the order of the observation.
pub fn column_groups(config: &TaskConfig) -> impl Iterator<Item = ColumnGroup> {
    use ColumnKind::{Action, Black, Due, Goals, Joints, Places, Playing, Sounding};
    let group = |kind, steps, columns| ColumnGroup { kind, steps, columns };
    let is_from_hand = config.view == ObservationView::Hand;
    let width = if is_from_hand { SLOTS } else { KEY_COUNT };
    let goals = goal_columns(config) * FINGERS;
    let ahead = 0..=config.lookahead;
    let joints = 0..=usize::from(config.previous_joints);
    joints
        .map(move |ago| group(Joints, ago, DRIVEN_JOINTS))
        .chain((1..=config.previous_actions).map(move |ago| group(Action, ago, ACTION_LEN)))
        .chain(config.fingering.then(|| group(Goals, 0, goals)))
        .chain(is_from_hand.then(|| group(Places, 0, config.lookahead + 1)))
        .chain([group(Sounding, 0, width)])
        .chain(ahead.clone().map(move |ahead| group(Due, ahead, width)))
        .chain(is_from_hand.then(|| group(Black, 0, width)))
        .chain(
            config
                .fingering
                .then_some(ahead)
                .into_iter()
                .flatten()
                .map(move |ahead| group(Playing, ahead, FINGERS)),
        )
}

/// Columns of the observation that `config` asks for.
pub fn layout(config: &TaskConfig) -> ObservationLayout {
    column_groups(config).fold(ObservationLayout { real: 0, binary: 0 }, |mut layout, group| {
        *(if group.kind.is_binary() { &mut layout.binary } else { &mut layout.real }) += group.columns;
        layout
    })
}

/// Writes an observation of [`layout`]'s length: `joints` (encoder readings) and those of one
/// control step ago, previous actions, the position of each fingertip relative to its goal; then,
/// each 0 or 1, the keys down, the keys due at `step` and in the next `lookahead` steps, and the
/// fingers that should play in each of these steps.
///
/// A goal has three columns: how far the fingertip is beyond it toward the player (x) and along the
/// keyboard, in white keys from −4 to 4, and the time until the note begins, as a fraction of
/// [`AHEAD_STEPS`]. With [`TaskConfig::velocities`] a fourth is the note's MIDI velocity over 127.
/// A finger without a goal has 0, 0, 1 and 0. The fingertip is the centre of the rounded tip where
/// the readings place it.
///
/// With [`ObservationView::Hand`] the rail's readings are relative to its planned position, the
/// keys are those in a window of 21 half white keys around that position, with one more set of
/// columns for the black keys among them, and after the goals there are: how far the planned
/// position is from the middle of the window, and how far from it the planned positions of the next
/// `lookahead` steps are, in white keys (−4 to 4).
pub fn observe(
    config: &TaskConfig,
    joints: &[f64; DRIVEN_JOINTS],
    history: &History,
    pressed: KeySet,
    piece: &Piece,
    step: usize,
    out: &mut [f32],
) {
    let from_hand = config.view == ObservationView::Hand;
    let rail = if from_hand { piece.planned_rail(step) } else { 0.0 };
    let window = Window::around(rail);
    let show = |keys: KeySet, columns: &mut [f32]| {
        if from_hand {
            window.show(keys.iter(), columns);
        } else {
            keys.iter().for_each(|key| columns[key] = 1.0);
        }
    };
    out.fill(0.0);
    let mut rest = out;
    for ColumnGroup { kind, steps, columns } in column_groups(config) {
        let (columns, others) = rest.split_at_mut(columns);
        rest = others;
        match kind {
            ColumnKind::Joints => {
                let readings = if steps == 0 { joints } else { &history.joints };
                for (joint, column) in columns.iter_mut().enumerate() {
                    let origin = if joint == RAIL { rail } else { 0.0 };
                    *column = scaled(config.scale, joint, readings[joint] - origin);
                }
            }
            ColumnKind::Action => columns.copy_from_slice(&history.actions[steps - 1]),
            ColumnKind::Goals => {
                let columns = columns.chunks_exact_mut(goal_columns(config));
                for (finger, (columns, goal)) in columns.zip(piece.goals(step)).enumerate() {
                    let (position, velocity) = columns.split_at_mut(GOAL_COLUMNS);
                    let relative =
                        goal.map_or([0.0, 0.0, 1.0], |goal| from_goal(config, joints, finger, &goal));
                    position.copy_from_slice(&relative);
                    velocity.fill(goal.map_or(0.0, |goal| f32::from(goal.velocity) / 127.0));
                }
            }
            ColumnKind::Places => {
                for (ahead, column) in columns.iter_mut().enumerate() {
                    let distance = match ahead {
                        0 => window.off_middle(rail),
                        _ => (piece.planned_rail(step + ahead) - rail) / WHITE_PITCH,
                    };
                    *column = distance.clamp(-MAX_DISTANCE_KEYS, MAX_DISTANCE_KEYS) as f32;
                }
            }
            ColumnKind::Sounding => show(pressed, columns),
            ColumnKind::Due => show(piece.due(step + steps), columns),
            ColumnKind::Black => window.show((0..KEY_COUNT).filter(|key| key_is_black(*key)), columns),
            ColumnKind::Playing => {
                for (column, goal) in columns.iter_mut().zip(piece.goals(step + steps)) {
                    *column = f32::from(u8::from(goal.is_some_and(|goal| goal.sounds())));
                }
            }
        }
    }
}

/// The columns of a finger's goal.
fn from_goal(
    config: &TaskConfig,
    joints: &[f64; DRIVEN_JOINTS],
    finger: usize,
    goal: &Goal,
) -> [f32; GOAL_COLUMNS] {
    let angles = joints[finger * JOINTS_PER_FINGER..].first_chunk().expect("a finger's joints");
    let tip = kinematics::fingertip(config.stage.side, finger, angles, joints[RAIL]);
    let keys = |distance: f64| (distance / WHITE_PITCH).clamp(-MAX_DISTANCE_KEYS, MAX_DISTANCE_KEYS) as f32;
    let [x, y] = goal.over;
    [keys(tip[0] - x), keys(tip[1] - y), goal.wait_steps as f32 / AHEAD_STEPS as f32]
}

fn scaled(scale: ObservationScale, joint: usize, reading: f64) -> f32 {
    match scale {
        ObservationScale::Si => reading as f32,
        ObservationScale::Normalised if joint == RAIL => (reading / WHITE_PITCH) as f32,
        ObservationScale::Normalised => {
            let [low, high] = joint_range(joint);
            ((reading - low) / (high - low) * 2.0 - 1.0) as f32
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use etude_music::repertoire;

    #[test]
    fn the_parts_lie_in_the_papers_order() {
        let config = TaskConfig { scale: ObservationScale::Si, ..TaskConfig::default() };
        let piece = Piece::new(&repertoire::get("c-major-scale").expect("built in"), 1.0).unwrap();
        assert_eq!(layout(&config).len(), 369);
        let joints = std::array::from_fn(|j| 0.01 * j as f64);
        let previous = std::array::from_fn(|j| -0.01 * j as f64);
        let mut out = vec![9.0; 369];
        let mut pressed = KeySet::EMPTY;
        pressed.insert(48);
        let history = History { joints: previous, actions: [[9.0; ACTION_LEN]; MAX_PREVIOUS_ACTIONS] };
        observe(&config, &joints, &history, pressed, &piece, 18, &mut out);
        assert_eq!((out[1], out[12], out[14], out[25]), (0.01, 0.12, -0.01, -0.12));
        assert_eq!(out[26 + 48], 1.0);
        // The first note, middle C, starts at step 20: two steps ahead of step 18.
        let sheet = &out[26 + 49..];
        assert_eq!((sheet[49 + 24], sheet[2 * 49 + 24], sheet[5 * 49 + 24]), (0.0, 1.0, 1.0));
        assert_eq!(out.iter().skip(26).filter(|v| **v == 1.0).count(), 1 + 4);
    }

    #[test]
    fn previous_actions_follow_the_joints_newest_first() {
        let config = TaskConfig { previous_actions: 2, ..TaskConfig::default() };
        let piece = Piece::new(&repertoire::get("c-major-scale").expect("built in"), 1.0).unwrap();
        let mut history =
            History { joints: [0.0; DRIVEN_JOINTS], actions: [[0.5; ACTION_LEN]; MAX_PREVIOUS_ACTIONS] };
        history.push([0.0; DRIVEN_JOINTS], &[-0.25; ACTION_LEN]);
        let mut out = vec![9.0; layout(&config).len()];
        assert_eq!(out.len(), 369 + 2 * ACTION_LEN);
        observe(&config, &[0.0; DRIVEN_JOINTS], &history, KeySet::EMPTY, &piece, 0, &mut out);
        let actions = &out[2 * DRIVEN_JOINTS..][..2 * ACTION_LEN];
        assert!(actions[..ACTION_LEN].iter().all(|value| *value == -0.25));
        assert!(actions[ACTION_LEN..].iter().all(|value| *value == 0.5));
    }

    #[test]
    fn the_appendix_leaves_out_previous_joints() {
        let config = TaskConfig { previous_joints: false, ..TaskConfig::default() };
        assert_eq!(layout(&config).len(), 356);
    }
}
