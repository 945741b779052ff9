//! From observations to outputs.

use super::{Drops, Inputs, Network, Workspace};
use crate::kernels::{Matrix, add_row, bias_gelu, gather_rows, norm_forward, product};

impl Network {
    /// Computes `[rows, outputs]`, which stays in the workspace until the next pass.
    ///
    /// `drops` are the units to drop (none in an actor), `rate` is their dropout rate. With `keep`,
    /// the workspace keeps what [`backward`](Self::backward) needs.
    pub(crate) fn forward<'w>(
        &self,
        parameters: &[f32],
        inputs: &Inputs,
        drops: &Drops,
        rate: f64,
        keep: bool,
        workspace: &'w mut Workspace,
    ) -> &'w [f32] {
        let rows = inputs.rows();
        for (index, layer) in self.parameter_layout.layers.iter().enumerate() {
            let (before, after) = workspace.layers.split_at_mut(index);
            let values = &mut after[0];
            let len = rows * layer.outputs;
            let out = &mut values.out[..len];
            let weight = &parameters[layer.weight.clone()];
            match before.last() {
                None => self.first_layer(weight, layer.outputs, inputs, out),
                Some(previous) => Workspace::product(
                    &mut workspace.bf16,
                    out,
                    Matrix::new(&previous.out, rows, layer.inputs),
                    Matrix::new(weight, layer.inputs, layer.outputs),
                ),
            }
            let kept = if keep { len } else { 0 };
            let bias = &parameters[layer.bias.clone()];
            if self.shape.normalised {
                norm_forward(
                    out,
                    bias,
                    &parameters[layer.scale.clone()],
                    &parameters[layer.shift.clone()],
                    &drops[index],
                    keep_scale(rate),
                    &mut values.normalised[..kept],
                    &mut values.slope[..kept],
                    &mut values.inverse_deviation[..if keep { rows } else { 0 }],
                );
            } else {
                bias_gelu(out, bias, &mut values.slope[..kept]);
            }
        }
        let head = &self.parameter_layout.head;
        let output = &mut workspace.output[..rows * head.outputs];
        let weight = &parameters[head.weight.clone()];
        let last = &workspace.layers[self.parameter_layout.layers.len() - 1];
        product(
            output,
            false,
            Matrix::new(&last.out, rows, head.inputs),
            Matrix::new(weight, head.inputs, head.outputs),
        );
        add_row(output, &parameters[head.bias.clone()]);
        output
    }

    /// `out = [real, extra] W_dense + Σ rows of W_binary`.
    fn first_layer(&self, weight: &[f32], width: usize, inputs: &Inputs, out: &mut [f32]) {
        let dense = self.shape.dense_inputs();
        let (dense_weight, binary_weight) = weight.split_at(dense * width);
        gather_rows(binary_weight, width, inputs.offsets(), inputs.ones(), out);
        product(
            out,
            true,
            Matrix::strided(inputs.dense(), inputs.rows(), dense, inputs.stride()),
            Matrix::new(dense_weight, dense, width),
        );
    }
}

/// Factor of the units that are not dropped.
pub(super) fn keep_scale(rate: f64) -> f32 {
    (1.0 / (1.0 - rate)) as f32
}
