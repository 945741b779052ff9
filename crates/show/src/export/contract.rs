//! What the columns of a model's observation and action mean, and what they are computed from: the
//! song, its plan, the hand. A test computes the observations of a performance from nothing else.

use etude_lab::LoadedPlayer;
use etude_music::{CONTROL_HZ, KEY_COUNT, LOWEST_PITCH, Song, key_is_black};
use etude_stage::geometry::WHITE_PITCH;
use etude_stage::hand::LINKS;
use etude_stage::{DRIVEN_JOINTS, FINGERS, JOINT_NAMES, RAIL, joint_range, kinematics};
use etude_task::fingering::{AHEAD_STEPS, Goal};
use etude_task::window::{self, SLOTS, Window};
use etude_task::{
    ColumnGroup, ColumnKind, Fingering, ObservationView, Piece, TargetRange, TaskConfig, TaskError,
    column_groups,
};
use serde_json::{Value, json};

/// What the columns of the observation and of the action mean.
pub(super) fn contract(player: &LoadedPlayer, song: &Song) -> Result<Value, TaskError> {
    let task = &player.config.task;
    let piece = Piece::for_task(song, task)?;
    let range = TargetRange::new(&piece);
    let unit = |joint: usize| if joint == RAIL { "m" } else { "rad" };
    let joints: Vec<_> = (0..DRIVEN_JOINTS)
        .map(|joint| {
            let [low, high] = range.span(joint);
            let [lowest, highest] = joint_range(joint);
            json!({"name": JOINT_NAMES[joint], "low": low, "high": high, "lowest": lowest, "highest": highest, "unit": unit(joint)})
        })
        .collect();
    let fingering = piece.fingering();
    Ok(json!({
        "schema": 1,
        "song": song.title(),
        "policy": player.name(),
        "control_hz": CONTROL_HZ,
        "observation": {
            "columns": columns(task),
            "lowest_pitch": LOWEST_PITCH,
            "white_key_m": WHITE_PITCH,
            "scales": {
                "si": "rad, the rail in m",
                "normalised": "finger joints from the action's `lowest` … `highest` (the joint's own range) to -1 … 1, the rail in white keys from the middle",
            },
            "window": fingering.filter(|_| task.view == ObservationView::Hand).map(|fingering| window_json(fingering)),
        },
        "action": {"meaning": "targets, -1 at `low` and 1 at `high`; with a fingering, the rail's are relative to its `rail_m`, and those of the fingers to its `pose_rad` if it has one", "joints": joints},
        "due": piece.frames().iter().map(|due| due.pitches().collect()).collect::<Vec<Vec<u8>>>(),
        "fingering": fingering.map(|fingering| fingering_json(fingering, task)),
        "task": task,
    }))
}

/// The groups of columns of the observation, in their order, with what they mean.
fn columns(task: &TaskConfig) -> Vec<Value> {
    let with_name = |group: ColumnGroup| {
        let ColumnGroup { kind, steps, columns } = group;
        json!({"kind": kind, "steps": steps, "columns": columns, "name": column_name(task, kind, steps)})
    };
    column_groups(task).map(with_name).collect()
}

fn column_name(task: &TaskConfig, kind: ColumnKind, steps: usize) -> String {
    let is_from_hand = task.view == ObservationView::Hand;
    let of_window = if is_from_hand { " (see `window`)" } else { "" };
    match kind {
        ColumnKind::Joints if steps == 0 => {
            let reading = if task.rail_set_point {
                "; of the rail its last set-point, not its measured position"
            } else {
                ""
            };
            let rail = if is_from_hand { "; the rail's less `rail_m` of this control step" } else { "" };
            format!("joints (see `scales`: {}){reading}{rail}", scale_name(task))
        }
        ColumnKind::Joints => "joints one control step ago, in the same way".to_string(),
        ColumnKind::Action => format!("action {steps} control steps ago"),
        ColumnKind::Goals => {
            let velocity = if task.velocities { ", velocity of it" } else { "" };
            format!(
                "for each finger: x and y relative to its goal, time until its note{velocity} (see `fingering`)"
            )
        }
        ColumnKind::Places => {
            "planned positions of the rail, white keys: that of this control step less the middle of the window, then those of the \
             next ones less that of this one, clamped to -4 ... 4"
                .to_string()
        }
        ColumnKind::Sounding => format!("keys that sound, 0 or 1{of_window}"),
        ColumnKind::Due => format!("keys due in {steps} control steps, 0 or 1{of_window}"),
        ColumnKind::Black => format!("black keys, 0 or 1{of_window}"),
        ColumnKind::Playing => format!("fingers whose wait is 0 in {steps} control steps, 0 or 1"),
    }
}

fn scale_name(task: &TaskConfig) -> String {
    serde_json::to_value(task.scale)
        .ok()
        .and_then(|name| Some(name.as_str()?.to_string()))
        .unwrap_or_default()
}

/// The part of the keyboard that an observation relative to the hand shows, for each control step.
fn window_json(fingering: &Fingering) -> Value {
    let middle: Vec<i32> = fingering.rail().iter().map(|place| Window::around(*place).middle()).collect();
    let slots: Vec<i32> = (0..KEY_COUNT).map(window::slot_of_key).collect();
    let black: Vec<usize> = (0..KEY_COUNT).filter(|key| key_is_black(*key)).collect();
    let meaning = "A slot is half a white key wide. Key k, 0 is the lowest, stands in column key_slot[k] - middle[step] + slots_to_a_side of \
                   its group, and nowhere if there is no such column. After the end the last middle stays. The middle of the window is \
                   middle / 2 white keys from that of the keyboard.";
    json!({"meaning": meaning, "slots_to_a_side": SLOTS / 2, "middle": middle, "key_slot": slots, "black_keys": black})
}

/// For each control step, the place of the rail and the goal of each finger; and how the columns
/// are computed from them.
fn fingering_json(fingering: &Fingering, task: &TaskConfig) -> Value {
    let goal = |goal: Goal| json!({"key": goal.key, "x_m": goal.over[0], "y_m": goal.over[1], "wait": goal.wait_steps, "velocity": goal.velocity});
    let steps = 0..fingering.rail().len();
    let goals: Vec<_> = steps.map(|step| fingering.goals(step).map(|it| it.map(goal))).collect();
    let (velocity, none) =
        if task.velocities { ("; then velocity / 127", "0, 0, 1, 0") } else { ("", "0, 0, 1") };
    let meaning = format!(
        "x and y of the centre of the fingertip, computed from the joint readings (see `hand`), minus those of the goal, in white keys, \
         clamped to -4 ... 4; then wait / {AHEAD_STEPS}{velocity}. Without a goal {none}. After the end there is no goal, and the last rail_m stays."
    );
    let pose = |step: usize| fingering.poses().map(|poses| poses.at(step));
    let poses: Option<Vec<_>> = (0..goals.len()).map(pose).collect();
    json!({"meaning": meaning, "rail_m": fingering.rail(), "goals": goals, "pose_rad": poses, "hand": hand_json(task)})
}

/// How the centre of a fingertip is computed from joint readings.
fn hand_json(task: &TaskConfig) -> Value {
    let fingers: Vec<_> = (0..FINGERS)
        .map(|finger| {
            let ([x, y, _], tilt) = kinematics::root(task.stage.side, finger, 0.0);
            json!({"x_m": x, "y_m": y, "tilt_rad": tilt})
        })
        .collect();
    let meaning = "With the readings q0, q1, q2, q3 of a finger, its links L0 ... L3 and the rail's reading (or set-point, see `columns`): along = L0 + L1 cos(q1) + \
                   L2 cos(q1 + q2) + L3 cos(q1 + q2 + q3); aside = -sin(q0) (L1 sin(q1) + L2 sin(q1 + q2) + L3 sin(q1 + q2 + q3)); \
                   x = x_m - along cos(tilt) + aside sin(tilt); y = y_m + rail + along sin(tilt) + aside cos(tilt).";
    json!({"meaning": meaning, "links_m": LINKS, "fingers": fingers})
}
