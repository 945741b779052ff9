//! A policy's actor as an ONNX model, with a description of its input and output.

mod contract;
mod proto;

use std::path::Path;

use anyhow::Context as _;
use etude_lab::LoadedPlayer;
use etude_learn::PolicyLayer;
use etude_music::Song;
use etude_perform::write_file;
use etude_task::ACTION_LEN;
use prost::Message as _;

use contract::contract;
use proto::{Attribute, Graph, Model, Node, OpsetId, StringEntry, Tensor, ValueInfo};

/// The first set of operators with GELU.
const OPSET: i64 = 20;
/// The version of the format that goes with it.
const IR_VERSION: i64 = 9;
/// Name of the input.
const OBSERVATION: &str = "observation";
/// Name of the output.
const ACTION: &str = "action";

/// Writes the actor of `player`, which plays `song`, as an ONNX model: `observation` `[batch, o]`
/// to `action` `[batch, 13]` in [-1, 1], without exploration. The entry `etude` of the model's
/// metadata holds JSON that says what each column means.
///
/// # Errors
/// If the player is the scripted baseline, or the file cannot be written.
pub fn export_onnx(player: &LoadedPlayer, song: &Song, path: &Path) -> anyhow::Result<()> {
    let policy = player.policy().context(
        "the scripted baseline has no network that could be exported; train a policy, or name one with --policy",
    )?;
    let contract = contract(player, song)?;
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
