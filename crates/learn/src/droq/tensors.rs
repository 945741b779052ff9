//! The learner's state as named tensors, for checkpoints.
//!
//! Names are `<network>.<kind>.<tensor>`: networks `actor`, `critic0`, `critic1`; kinds
//! `parameters`, `adam_mean`, `adam_square`, `policy` for the actor and `target` for critics;
//! tensors as in [`Shape`](crate::network::Shape), for example `critic0.target.layer1.norm_scale`.
//! Weights are `[inputs, outputs]`; the rows of a first layer are real columns, then (critics) the
//! action, then binary columns. `temperature.log` is `[3]`: value and its two moments.

//! [`LEARNED`] of them are what a training takes over that begins with another one's parameters.

use super::{Droq, critic::Critic};
use crate::{
    buffer::Buffer,
    network::ParameterLayout,
    tensors::{Lookup, NamedTensor, find, find_tensors, name_tensors},
};

const TEMPERATURE: &str = "temperature.log";
/// Temperature for a policy without one, as a share of `initial_temperature`. Trainings converge to
/// about a twentieth (`fast`, C-major scale: from 0.1 to 0.005 after 100,000 steps). With the
/// initial temperature the first updates would undo the policy: its entropy rose from -27 to -3
/// nats in 4,000 steps. A temperature that is too low is corrected by the updates.
const SETTLED_TEMPERATURE: f32 = 0.05;
/// The kinds that are not the optimiser's.
const LEARNED: [&str; 3] = ["parameters", "policy", "target"];

/// A buffer that is saved: the layout of its tensors, its network and its kind.
type SavedBuffer<'a> = (&'a ParameterLayout, String, &'static str, &'a mut Buffer);

impl Droq {
    /// All that is saved except random streams and counts: buffers, and the temperature.
    fn saved(&mut self) -> (Vec<SavedBuffer<'_>>, &mut [f32; 3]) {
        let Self { actor_network, critic_network, actor, policy, critics, log_temperature, .. } = self;
        let actor = [
            ("parameters", &mut actor.parameters),
            ("adam_mean", &mut actor.mean),
            ("adam_square", &mut actor.square),
            ("policy", policy),
        ];
        let layout = &actor_network.parameter_layout;
        let mut buffers: Vec<SavedBuffer<'_>> = Vec::new();
        buffers.extend(actor.map(|(kind, buffer)| (layout, "actor".to_owned(), kind, buffer)));
        let layout = &critic_network.parameter_layout;
        for (index, Critic { trainable, target }) in critics.iter_mut().enumerate() {
            let critic = [
                ("parameters", &mut trainable.parameters),
                ("adam_mean", &mut trainable.mean),
                ("adam_square", &mut trainable.square),
                ("target", target),
            ];
            buffers.extend(critic.map(|(kind, buffer)| (layout, format!("critic{index}"), kind, buffer)));
        }
        (buffers, log_temperature)
    }

    /// All tensors. The random streams and the update count are not among them.
    pub(crate) fn tensors(&mut self) -> Vec<NamedTensor<'_>> {
        let mut out = Vec::new();
        let (buffers, temperature) = self.saved();
        for (layout, network, kind, buffer) in buffers {
            name_tensors(layout, &format!("{network}.{kind}"), buffer, &mut out);
        }
        out.push(NamedTensor { name: TEMPERATURE.to_owned(), shape: vec![3], values: temperature });
        out
    }

    /// Restores saved tensors. After an error the learner must not be used.
    pub(crate) fn load_tensors(&mut self, lookup: &Lookup<'_>) -> Result<(), String> {
        let (buffers, temperature) = self.saved();
        for (layout, network, kind, buffer) in buffers {
            find_tensors(layout, &format!("{network}.{kind}"), lookup, buffer)?;
        }
        temperature.copy_from_slice(&find(lookup, TEMPERATURE, &[3])?);
        Ok(())
    }

    /// Takes over what a saved learner has learned, without its optimiser. After an error the
    /// learner must not be used.
    pub(crate) fn load_learned(&mut self, lookup: &Lookup<'_>) -> Result<(), String> {
        let (buffers, temperature) = self.saved();
        for (layout, network, kind, buffer) in buffers.into_iter().filter(|it| LEARNED.contains(&it.2)) {
            find_tensors(layout, &format!("{network}.{kind}"), lookup, buffer)?;
        }
        temperature[0] = find(lookup, TEMPERATURE, &[3])?[0];
        Ok(())
    }

    /// Takes over the parameters of a policy. The critics stay as they are.
    pub(crate) fn load_policy(&mut self, parameters: &Buffer) {
        self.actor.parameters.copy_from_slice(parameters);
        self.policy.copy_from_slice(parameters);
        self.log_temperature[0] += SETTLED_TEMPERATURE.ln();
    }

    /// The name of a tensor that holds a value that is not finite, if there is one.
    pub(crate) fn not_finite(&mut self) -> Option<String> {
        (self.tensors().into_iter())
            .find(|tensor| !tensor.values.iter().all(|value| value.is_finite()))
            .map(|tensor| tensor.name)
    }
}
