//! A policy: the actor alone, in a small file, acting without exploration.
//!
//! The file is a safetensors file with the tensors `actor.layer0.weight`, `actor.layer0.bias`, …,
//! `actor.head.weight` (`[inputs, 2 · action]`: means, then logarithms of deviations) and
//! `actor.head.bias`, all `f32`, weights `[inputs, outputs]`, inputs in the order of the
//! observation. One metadata entry, `etude`, holds JSON: the [`PolicyHeader`]. Loading a damaged
//! file gives an error and never panics.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::{
    actor_inference::ActorInference,
    buffer::Buffer,
    config::{MAX_LAYER_WIDTH, MAX_LAYERS},
    droq::actor_shape,
    env::ObservationLayout,
    files::{FileError, TensorFile, encode_tensors, read, write},
    network::Network,
    tensors::{find_tensors, name_tensors},
};

const SCHEMA: &str = "etude-policy-2";
/// Rows of one pass; more rows take several passes.
const ROWS: usize = 16;
/// Maximum number of columns that an observation or an action may have in a file.
const MAX_COLUMNS: usize = 1 << 20;
/// Largest weight that training can lead to. Those of the shipped policies are below 4.
const MAX_WEIGHT: f32 = 1e4;
/// Values of the observations for which an action must be a number before the policy plays.
const PROBES: [f32; 2] = [0.0, 1.0];

/// The header of a policy file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicyHeader {
    /// Form and version of the file.
    pub schema: String,
    /// Columns of the observation that the policy reads.
    pub layout: ObservationLayout,
    /// Length of the action that it gives.
    pub action_len: usize,
    /// Widths of the hidden layers.
    pub hidden: Vec<usize>,
    /// The caller's own, for example song, configuration and scores.
    pub notes: serde_json::Value,
}

/// An actor that can be asked for actions.
#[derive(Clone)]
pub struct Policy {
    header: PolicyHeader,
    parameters: Buffer,
    inference: ActorInference,
}

impl std::fmt::Debug for Policy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Policy").field("header", &self.header).finish_non_exhaustive()
    }
}

/// One layer of a policy: `outputs = inputs · weight + bias`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PolicyLayer<'a> {
    /// Rows of the weight.
    pub inputs: usize,
    /// Columns of the weight.
    pub outputs: usize,
    /// `[inputs, outputs]`.
    pub weight: &'a [f32],
    /// `[outputs]`.
    pub bias: &'a [f32],
}

impl Policy {
    pub(crate) fn new(network: &Network, parameters: &[f32], notes: serde_json::Value) -> Self {
        let mut copy = network.parameters();
        copy.copy_from_slice(parameters);
        let header = PolicyHeader {
            schema: SCHEMA.to_owned(),
            layout: network.shape.layout,
            action_len: network.shape.outputs / 2,
            hidden: network.shape.hidden.clone(),
            notes,
        };
        Self { header, parameters: copy, inference: ActorInference::new(network, ROWS) }
    }

    /// What the policy reads and gives, and the caller's notes.
    pub fn header(&self) -> &PolicyHeader {
        &self.header
    }

    pub(crate) fn parameters(&self) -> &Buffer {
        &self.parameters
    }

    /// The layers in the order in which they act: hidden ones, each followed by GELU in its tanh
    /// form, then the head with means (whose `tanh` is the action) and logarithms of deviations.
    pub fn layers(&self) -> impl Iterator<Item = PolicyLayer<'_>> {
        let layout = &self.inference.network().parameter_layout;
        layout.layers.iter().chain([&layout.head]).map(|layer| PolicyLayer {
            inputs: layer.inputs,
            outputs: layer.outputs,
            weight: &self.parameters[layer.weight.clone()],
            bias: &self.parameters[layer.bias.clone()],
        })
    }

    /// Replaces the caller's notes.
    #[cfg(test)]
    pub(crate) fn set_notes(&mut self, notes: serde_json::Value) {
        self.header.notes = notes;
    }

    /// The best action (`tanh` of the mean), without exploration: `[k, observation]` to `[k,
    /// action]` in [-1, 1], any `k`.
    ///
    /// # Panics
    /// If the two slices do not have equally many whole rows.
    pub fn act(&mut self, observations: &[f32], actions: &mut [f32]) {
        self.inference.best(&self.parameters, observations, actions);
    }

    /// Writes the file. An older file of that name is replaced only when the new one is complete.
    pub fn save(&self, path: &Path) -> Result<(), FileError> {
        write(path, &self.to_bytes().map_err(|reason| FileError::content(path, reason))?)
    }

    /// The bytes that [`save`](Self::save) writes.
    pub fn to_bytes(&self) -> Result<Vec<u8>, String> {
        let mut tensors = Vec::new();
        name_tensors(&self.inference.network().parameter_layout, "actor", &self.parameters, &mut tensors);
        encode_tensors(&self.header, &tensors.into_iter().map(Into::into).collect::<Vec<_>>())
    }

    /// Reads a file that [`save`](Self::save) wrote.
    pub fn load(path: &Path) -> Result<Self, FileError> {
        Self::from_bytes(&read(path)?).map_err(|reason| FileError::content(path, reason))
    }

    /// Reads the bytes of such a file. `Err` says what is wrong with them.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        let file = TensorFile::parse(bytes)?;
        let header: PolicyHeader = file.header()?;
        if header.schema != SCHEMA {
            return Err(format!(
                "its schema is `{}`, and this version of Étude reads `{SCHEMA}`; train it again, or use it with the \
                 version that wrote it",
                header.schema
            ));
        }
        let columns = [header.layout.real, header.layout.binary, header.action_len];
        let widths = header.hidden.iter().all(|width| (1..=MAX_LAYER_WIDTH).contains(width));
        let depth = (1..=MAX_LAYERS).contains(&header.hidden.len());
        if !widths
            || !depth
            || columns.iter().any(|&n| n > MAX_COLUMNS)
            || header.action_len == 0
            || header.layout.is_empty()
        {
            return Err("the sizes in its header are out of range".to_owned());
        }
        let network = Network::new(actor_shape(header.layout, header.action_len, &header.hidden));
        // Check that the file is long enough for the sizes in its header before allocating them.
        let claimed: usize =
            network.parameter_layout.tensors.iter().map(|tensor| 4 * tensor.range.len()).sum();
        if claimed > bytes.len() {
            return Err("its header claims larger tensors than the file holds".to_owned());
        }
        let mut parameters = network.parameters();
        find_tensors(&network.parameter_layout, "actor", &|name| file.floats(name), &mut parameters)?;
        let mut policy = Self { header, parameters, inference: ActorInference::new(&network, ROWS) };
        policy.check_numbers()?;
        Ok(policy)
    }

    /// Refuses weights that no training leads to, and actions that are no number: a robot that is
    /// playing is the wrong place to find out.
    fn check_numbers(&mut self) -> Result<(), String> {
        const REMEDY: &str = "it is damaged or was changed; train it again, or name another policy";
        if let Some(weight) = self.parameters.iter().find(|weight| weight.abs() > MAX_WEIGHT) {
            return Err(format!("it holds the weight {weight:e}, and none is above {MAX_WEIGHT}: {REMEDY}"));
        }
        for probe in PROBES {
            let observation = vec![probe; self.header.layout.len()];
            let mut action = vec![0.0; self.header.action_len];
            self.act(&observation, &mut action);
            if action.iter().any(|value| !value.is_finite()) {
                return Err(format!(
                    "its action is not a number where every observation is {probe}: {REMEDY}"
                ));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::random::Stream;

    fn policy() -> Policy {
        let layout = ObservationLayout { real: 3, binary: 5 };
        let network = Network::new(actor_shape(layout, 2, &[8, 4]));
        let parameters = network.initialise(&mut Stream::new(1, "init"));
        Policy::new(&network, &parameters, serde_json::json!({"song": "Twinkle", "score": 0.9}))
    }

    #[test]
    fn survives_the_file_and_acts_alike() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("policy.safetensors");
        let mut policy = policy();
        policy.save(&path).unwrap();
        let mut copy = Policy::load(&path).unwrap();
        assert_eq!(copy.header(), policy.header());
        let rows = 40;
        let observations: Vec<f32> =
            (0..rows * 8).map(|i| if i % 8 < 3 { (i as f32).sin() } else { (i % 2) as f32 }).collect();
        let (mut a, mut b) = (vec![0.0; rows * 2], vec![1.0; rows * 2]);
        policy.act(&observations, &mut a);
        copy.act(&observations, &mut b);
        assert_eq!(a, b);
        assert!(a.iter().all(|x| x.abs() <= 1.0) && a.iter().any(|x| x.abs() > 0.01));
    }

    #[test]
    fn errors_say_what_is_wrong() {
        let mut wrong = policy();
        wrong.header.schema = "etude-policy-9".to_owned();
        assert!(Policy::from_bytes(&wrong.to_bytes().unwrap()).unwrap_err().contains("etude-policy-9"));
        let mut wrong = policy();
        wrong.header.hidden = vec![8, 5];
        assert!(Policy::from_bytes(&wrong.to_bytes().unwrap()).unwrap_err().contains("shape"));
        wrong.header.hidden = vec![8192; 16];
        assert!(Policy::from_bytes(&wrong.to_bytes().unwrap()).unwrap_err().contains("larger tensors"));
        let mut wrong = policy();
        wrong.parameters[0] = f32::NAN;
        assert!(Policy::from_bytes(&wrong.to_bytes().unwrap()).unwrap_err().contains("finite"));
        let mut wrong = policy();
        wrong.parameters.iter_mut().for_each(|weight| *weight *= 1e30);
        let refused = Policy::from_bytes(&wrong.to_bytes().unwrap()).unwrap_err();
        assert!(refused.contains("e29") && refused.contains("train it again"), "{refused}");
        let error = Policy::load(Path::new("/nowhere/policy.safetensors")).unwrap_err().to_string();
        assert!(error.contains("/nowhere/policy.safetensors"), "{error}");
    }

    /// Each weight is one that training might lead to, and their product is none.
    #[test]
    fn a_policy_whose_action_is_not_a_number_is_refused() {
        let layout = ObservationLayout { real: 3, binary: 5 };
        let network = Network::new(actor_shape(layout, 2, &[8; 16]));
        let mut parameters = network.parameters();
        for (index, weight) in parameters.iter_mut().enumerate() {
            *weight = if index % 3 == 0 { -MAX_WEIGHT } else { MAX_WEIGHT };
        }
        let wrong = Policy::new(&network, &parameters, serde_json::Value::Null);
        let refused = Policy::from_bytes(&wrong.to_bytes().unwrap()).unwrap_err();
        assert!(
            refused.contains("its action is not a number") && refused.contains("another policy"),
            "{refused}"
        );
    }

    proptest! {
        #[test]
        fn hostile_bytes_never_panic(edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6), cut in any::<Option<prop::sample::Index>>()) {
            let mut bytes = policy().to_bytes().unwrap();
            for (at, value) in edits {
                let at = at.index(bytes.len());
                bytes[at] = value;
            }
            if let Some(cut) = cut {
                bytes.truncate(cut.index(bytes.len()));
            }
            if let Ok(mut policy) = Policy::from_bytes(&bytes) {
                let header = policy.header().clone();
                policy.act(&vec![0.5; header.layout.len()], &mut vec![0.0; header.action_len]);
            }
        }

        #[test]
        fn noise_is_refused(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            prop_assert!(Policy::from_bytes(&bytes).is_err());
        }
    }
}
