//! From the gradient of the outputs to that of the parameters or of the action.

use super::{Drops, GradientOf, Inputs, Network, Workspace, forward::keep_scale};
use crate::kernels::{Matrix, column_sums, multiply, norm_backward, product, scatter_rows};

impl Network {
    /// Propagates `output_error` (`[rows, outputs]`, the gradient of the loss) back through the
    /// last pass of the workspace.
    ///
    /// `inputs`, `drops` and `rate` must be those of that pass, which must have been run with
    /// `keep`.
    #[allow(clippy::too_many_arguments)] // One call site each for critic, actor through critic, and actor.
    pub(crate) fn backward(
        &self,
        parameters: &[f32],
        inputs: &Inputs,
        drops: &Drops,
        rate: f64,
        output_error: &[f32],
        mut of: GradientOf<'_>,
        workspace: &mut Workspace,
    ) {
        let rows = inputs.rows();
        let Workspace { layers, errors: [error, next_error], bf16, .. } = workspace;
        let head = &self.parameter_layout.head;
        let last = &layers[self.parameter_layout.layers.len() - 1].out[..rows * head.inputs];
        if let GradientOf::Parameters(gradient) = &mut of {
            column_sums(output_error, &mut gradient[head.bias.clone()]);
            let errors = Matrix::new(output_error, rows, head.outputs);
            product(
                &mut gradient[head.weight.clone()],
                false,
                Matrix::new(last, rows, head.inputs).transposed(),
                errors,
            );
        }
        product(
            &mut error[..rows * head.inputs],
            false,
            Matrix::new(output_error, rows, head.outputs),
            Matrix::new(&parameters[head.weight.clone()], head.inputs, head.outputs).transposed(),
        );
        let (mut error, mut next_error) = (error, next_error);
        for (index, layer) in self.parameter_layout.layers.iter().enumerate().rev() {
            let len = rows * layer.outputs;
            let values = &layers[index];
            let current = &mut error[..len];
            if self.shape.normalised {
                let [bias, scale, shift] = match &mut of {
                    GradientOf::Parameters(gradient) => gradient
                        .get_disjoint_mut([layer.bias.clone(), layer.scale.clone(), layer.shift.clone()])
                        .expect("the tensors of a layer do not overlap"),
                    GradientOf::Extra(_) => [&mut [][..], &mut [][..], &mut [][..]],
                };
                norm_backward(
                    current,
                    &parameters[layer.scale.clone()],
                    &drops[index],
                    keep_scale(rate),
                    &values.normalised[..len],
                    &values.slope[..len],
                    &values.inverse_deviation[..rows],
                    bias,
                    scale,
                    shift,
                );
            } else {
                multiply(current, &values.slope[..len]);
                if let GradientOf::Parameters(gradient) = &mut of {
                    column_sums(current, &mut gradient[layer.bias.clone()]);
                }
            }
            let current = Matrix::new(&error[..len], rows, layer.outputs);
            let weight = &parameters[layer.weight.clone()];
            if index == 0 {
                self.first_layer_backward(weight, layer.outputs, inputs, &error[..len], &mut of);
                break;
            }
            if let GradientOf::Parameters(gradient) = &mut of {
                let previous = &layers[index - 1].out[..rows * layer.inputs];
                Workspace::product(
                    bf16,
                    &mut gradient[layer.weight.clone()],
                    Matrix::new(previous, rows, layer.inputs).transposed(),
                    current,
                );
            }
            Workspace::product(
                bf16,
                &mut next_error[..rows * layer.inputs],
                current,
                Matrix::new(weight, layer.inputs, layer.outputs).transposed(),
            );
            std::mem::swap(&mut error, &mut next_error);
        }
    }

    fn first_layer_backward(
        &self,
        weight: &[f32],
        width: usize,
        inputs: &Inputs,
        error: &[f32],
        of: &mut GradientOf<'_>,
    ) {
        let (rows, dense) = (inputs.rows(), self.shape.dense_inputs());
        let errors = Matrix::new(error, rows, width);
        match of {
            GradientOf::Parameters(gradient) => {
                let gradient = &mut gradient[self.parameter_layout.layers[0].weight.clone()];
                let (dense_gradient, binary_gradient) = gradient.split_at_mut(dense * width);
                let inputs_dense = Matrix::strided(inputs.dense(), rows, dense, inputs.stride());
                product(dense_gradient, false, inputs_dense.transposed(), errors);
                scatter_rows(binary_gradient, width, inputs.offsets(), inputs.ones(), error);
            }
            GradientOf::Extra(gradient) => {
                let extra_weight = &weight[self.shape.layout.real * width..dense * width];
                product(
                    gradient,
                    false,
                    errors,
                    Matrix::new(extra_weight, self.shape.extra, width).transposed(),
                );
            }
        }
    }
}
