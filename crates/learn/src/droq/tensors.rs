//! The learner's state as named tensors, for checkpoints.
//!
//! Names are `<network>.<kind>.<tensor>`: networks `actor`, `critic0`, `critic1`; kinds
//! `parameters`, `adam_mean`, `adam_square`, `policy` for the actor and `target` for critics;
//! tensors as in [`Shape`](crate::network::Shape), for example `critic0.target.layer1.norm_scale`.
//! Weights are `[inputs, outputs]`; the rows of a first layer are real columns, then (critics) the
//! action, then binary columns. `temperature.log` is `[3]`: value and its two moments.

use super::Droq;
use crate::tensors::{Lookup, NamedTensor, find, find_tensors, name_tensors};

pub(super) const TEMPERATURE: &str = "temperature.log";

impl Droq {
    /// All tensors. The random streams and the update count are not among them.
    pub(crate) fn tensors(&self) -> Vec<NamedTensor<'_>> {
        let mut out = Vec::new();
        let layout = &self.actor_network.parameter_layout;
        name_tensors(layout, "actor.parameters", &self.actor.parameters, &mut out);
        name_tensors(layout, "actor.adam_mean", &self.actor.mean, &mut out);
        name_tensors(layout, "actor.adam_square", &self.actor.square, &mut out);
        name_tensors(layout, "actor.policy", &self.policy, &mut out);
        let layout = &self.critic_network.parameter_layout;
        for (index, critic) in self.critics.iter().enumerate() {
            name_tensors(
                layout,
                &format!("critic{index}.parameters"),
                &critic.trainable.parameters,
                &mut out,
            );
            name_tensors(layout, &format!("critic{index}.adam_mean"), &critic.trainable.mean, &mut out);
            name_tensors(layout, &format!("critic{index}.adam_square"), &critic.trainable.square, &mut out);
            name_tensors(layout, &format!("critic{index}.target"), &critic.target, &mut out);
        }
        out.push(NamedTensor { name: TEMPERATURE.to_owned(), shape: vec![3], values: &self.log_temperature });
        out
    }

    /// Restores saved tensors. After an error the learner must not be used.
    pub(crate) fn load_tensors(&mut self, lookup: &Lookup<'_>) -> Result<(), String> {
        let layout = &self.actor_network.parameter_layout;
        find_tensors(layout, "actor.parameters", lookup, &mut self.actor.parameters)?;
        find_tensors(layout, "actor.adam_mean", lookup, &mut self.actor.mean)?;
        find_tensors(layout, "actor.adam_square", lookup, &mut self.actor.square)?;
        find_tensors(layout, "actor.policy", lookup, &mut self.policy)?;
        let layout = &self.critic_network.parameter_layout;
        for (index, critic) in self.critics.iter_mut().enumerate() {
            find_tensors(
                layout,
                &format!("critic{index}.parameters"),
                lookup,
                &mut critic.trainable.parameters,
            )?;
            find_tensors(layout, &format!("critic{index}.adam_mean"), lookup, &mut critic.trainable.mean)?;
            find_tensors(
                layout,
                &format!("critic{index}.adam_square"),
                lookup,
                &mut critic.trainable.square,
            )?;
            find_tensors(layout, &format!("critic{index}.target"), lookup, &mut critic.target)?;
        }
        self.log_temperature.copy_from_slice(&find(lookup, TEMPERATURE, &[3])?);
        Ok(())
    }

    /// The name of a tensor that holds a value that is not finite, if there is one.
    pub(crate) fn not_finite(&self) -> Option<String> {
        (self.tensors().into_iter())
            .find(|tensor| !tensor.values.iter().all(|value| value.is_finite()))
            .map(|tensor| tensor.name)
    }
}
