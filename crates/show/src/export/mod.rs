//! A policy's actor as an ONNX model, with a description of its input and output.

mod proto;

use std::path::Path;

use anyhow::Context as _;
use etude_lab::Pianist;
use etude_learn::PolicyLayer;
use etude_music::{CONTROL_HZ, KEYS, LOWEST_PITCH, Song};
use etude_perform::write_file;
use etude_stage::geometry::WHITE_PITCH;
use etude_stage::{FINGERS, JOINT_NAMES, JOINTS, RAIL, joint_range};
use etude_task::fingering::Goal;
use etude_task::{ACTION_LEN, Fingering, Piece, TargetRange, TaskError};
use prost::Message as _;
use serde_json::json;

use proto::{Attribute, Graph, Model, Node, OpsetId, StringEntry, Tensor, ValueInfo};

/// The first set of operators with GELU.
const OPSET: i64 = 20;
/// The version of the format that goes with it.
const IR_VERSION: i64 = 9;
/// Name of the input.
const OBSERVATION: &str = "observation";
/// Name of the output.
const ACTION: &str = "action";

/// Writes the actor of `pianist`, which plays `song`, as an ONNX model: `observation` `[batch, o]` to `action` `[batch, 13]` in [-1, 1],
/// without exploration. The entry `etude` of the model's metadata holds JSON that says what each column means.
///
/// # Errors
/// If the pianist is the scripted player, or the file cannot be written.
pub fn export_onnx(pianist: &Pianist, song: &Song, path: &Path) -> anyhow::Result<()> {
    let policy = pianist.policy().context(
        "the scripted player has no network that could be exported; train a policy, or name one with --policy",
    )?;
    let contract = contract(pianist, song)?;
    let mut graph = Graph {
        name: "actor".to_string(),
        doc_string: "the action's mean through tanh, without exploration".to_string(),
        input: vec![ValueInfo::rows(OBSERVATION, policy.header().layout.len())],
        output: vec![ValueInfo::rows(ACTION, ACTION_LEN)],
        ..Graph::default()
    };
    let layers: Vec<PolicyLayer<'_>> = policy.layers().collect();
    let mut from = OBSERVATION.to_string();
    for (index, layer) in layers.iter().enumerate() {
        let is_head = index + 1 == layers.len();
        let name = if is_head { "head".to_string() } else { format!("layer{index}") };
        // Of the head's columns the first half are means.
        let columns = if is_head { ACTION_LEN } else { layer.outputs };
        let weight = layer.weight.chunks_exact(layer.outputs).flat_map(|row| &row[..columns]).copied();
        let [weights, biases] = ["weight", "bias"].map(|part| format!("actor.{name}.{part}"));
        graph.initializer.push(Tensor::new(&weights, &[layer.inputs, columns], weight));
        graph.initializer.push(Tensor::new(&biases, &[columns], layer.bias[..columns].iter().copied()));
        let linear = format!("{name}.linear");
        graph.node.push(Node::new("Gemm", &[&from, &weights, &biases], &linear, Vec::new()));
        let (activation, attributes, to) = if is_head {
            ("Tanh", Vec::new(), ACTION.to_string())
        } else {
            ("Gelu", vec![Attribute::text("approximate", "tanh")], format!("{name}.out"))
        };
        graph.node.push(Node::new(activation, &[&linear], &to, attributes));
        from = to;
    }
    let model = Model {
        ir_version: IR_VERSION,
        producer_name: "etude".to_string(),
        producer_version: env!("CARGO_PKG_VERSION").to_string(),
        graph: Some(graph),
        opset_import: vec![OpsetId { domain: String::new(), version: OPSET }],
        metadata_props: vec![StringEntry { key: "etude".to_string(), value: contract.to_string() }],
    };
    Ok(write_file(path, &model.encode_to_vec())?)
}

/// For each control step, the place of the rail and the goal of each finger; and how the columns are computed from them.
fn fingering_json(fingering: &Fingering) -> serde_json::Value {
    let goal = |goal: Goal| json!({"key": goal.key, "x_m": goal.over[0], "y_m": goal.over[1], "wait": goal.wait_steps});
    let steps = 0..fingering.rail().len();
    let goals: Vec<_> = steps.map(|step| fingering.goals(step).map(|it| it.map(goal))).collect();
    let meaning = "x and y of the centre of the fingertip, computed from the joint readings, minus those of the goal, in white keys, \
                   clamped to -4 ... 4; then wait / 10. Without a goal 0, 0, 1. After the end there is no goal, and the last rail_m stays.";
    let pose = |step: usize| fingering.poses().map(|poses| poses.at(step));
    let poses: Option<Vec<_>> = (0..goals.len()).map(pose).collect();
    json!({"meaning": meaning, "rail_m": fingering.rail(), "goals": goals, "pose_rad": poses})
}

/// What the columns of the observation and of the action mean.
fn contract(pianist: &Pianist, song: &Song) -> Result<serde_json::Value, TaskError> {
    let task = &pianist.config.task;
    let piece = Piece::for_task(song, task)?;
    let range = TargetRange::new(&piece);
    let mut columns = vec![json!({"name": "joints", "columns": JOINTS, "scale": task.scale})];
    if task.previous_joints {
        columns.push(json!({"name": "joints one control step ago", "columns": JOINTS, "scale": task.scale}));
    }
    for ago in 1..=task.previous_actions {
        columns.push(json!({"name": format!("action {ago} control steps ago"), "columns": ACTION_LEN}));
    }
    if task.fingering {
        let name = "for each finger: x and y relative to its goal, time until its note (see `fingering`)";
        columns.push(json!({"name": name, "columns": 3 * FINGERS}));
    }
    columns.push(json!({"name": "keys that sound, 0 or 1", "columns": KEYS}));
    for ahead in 0..=task.lookahead {
        columns.push(json!({"name": format!("keys due in {ahead} control steps, 0 or 1"), "columns": KEYS}));
    }
    if task.fingering {
        for ahead in 0..=task.lookahead {
            columns.push(json!({"name": format!("fingers that play in {ahead} control steps, 0 or 1"), "columns": FINGERS}));
        }
    }
    let fingering = piece.fingering();
    let unit = |joint: usize| if joint == RAIL { "m" } else { "rad" };
    let joints: Vec<_> = (0..JOINTS)
        .map(|joint| {
            let [low, high] = range.relative(joint);
            let [lowest, highest] = joint_range(joint);
            json!({"name": JOINT_NAMES[joint], "low": low, "high": high, "lowest": lowest, "highest": highest, "unit": unit(joint)})
        })
        .collect();
    Ok(json!({
        "schema": 1,
        "song": song.title(),
        "policy": pianist.name(),
        "control_hz": CONTROL_HZ,
        "observation": {
            "columns": columns,
            "lowest_pitch": LOWEST_PITCH,
            "white_key_m": WHITE_PITCH,
            "scales": {
                "si": "rad, the rail in m",
                "normalised": "finger joints from the action's `lowest` … `highest` (the joint's own range) to -1 … 1, the rail in white keys from the middle",
            },
        },
        "action": {"meaning": "targets, -1 at `low` and 1 at `high`; with a fingering, the rail's are relative to its `rail_m`, and those of the fingers to its `pose_rad` if it has one", "joints": joints},
        "due": piece.frames().iter().map(|due| due.pitches().collect()).collect::<Vec<Vec<u8>>>(),
        "fingering": fingering.map(|fingering| fingering_json(fingering)),
        "task": task,
    }))
}
