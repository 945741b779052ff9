//! Multi-layer networks: actor (GELU) and critics (dropout, LayerNorm, GELU), forward and backward.
//!
//! A network is a [`Shape`], a flat parameter buffer and a [`Workspace`] with all buffers except
//! those of the `gemm` crate.

mod backward;
mod forward;
mod init;
mod input;
mod shape;

#[cfg(test)]
mod tests;

pub(crate) use input::Inputs;
pub(crate) use shape::{ParameterLayout, Shape};

use crate::{
    buffer::Buffer,
    config::Arithmetic,
    kernels::{Bf16Products, Matrix, product},
};

/// Dropped units of one pass: for each hidden layer the positions `row * width + unit`, ascending.
/// Empty for actors.
pub(crate) type Drops = [Vec<u32>];

/// A network's shape, and where its tensors are in the parameter buffer.
#[derive(Clone)]
pub(crate) struct Network {
    pub shape: Shape,
    pub parameter_layout: ParameterLayout,
}

/// Intermediate values of one pass over up to `capacity` rows.
#[derive(Clone)]
pub(crate) struct Workspace {
    layers: Vec<LayerValues>,
    /// `[rows, outputs]` of the head.
    output: Buffer,
    /// Two gradients that alternate in the backward pass, `[rows, widest layer]` each.
    errors: [Buffer; 2],
    /// Products between hidden layers in bfloat16, if configured and supported by the processor.
    bf16: Option<Bf16Products>,
}

impl Workspace {
    /// `out = a b` between hidden layers.
    fn product(bf16: &mut Option<Bf16Products>, out: &mut [f32], a: Matrix<'_>, b: Matrix<'_>) {
        match bf16 {
            Some(products) => products.product(out, a, b),
            None => product(out, false, a, b),
        }
    }
}

#[derive(Clone)]
struct LayerValues {
    /// `[rows, outputs]` each.
    out: Buffer,
    slope: Buffer,
    normalised: Buffer,
    /// `[rows]`
    inverse_deviation: Buffer,
}

/// What the backward pass computes.
pub(crate) enum GradientOf<'a> {
    /// The gradient of every parameter, in a buffer laid out like the parameters.
    Parameters(&'a mut [f32]),
    /// The gradient of the extra inputs (the action), `[rows, extra]`, and none of the parameters'.
    Extra(&'a mut [f32]),
}

impl Network {
    pub(crate) fn new(shape: Shape) -> Self {
        let parameter_layout = shape.parameter_layout();
        Self { shape, parameter_layout }
    }

    pub(crate) fn parameters(&self) -> Buffer {
        Buffer::new(self.parameter_layout.len)
    }

    /// Buffers for passes over at most `capacity` rows; without `gradients`, for forward passes
    /// only.
    ///
    /// The first layer and the head are always multiplied in `f32`: rounded joint angles would lose
    /// the small differences between two control steps.
    pub(crate) fn workspace(&self, capacity: usize, gradients: bool, arithmetic: Arithmetic) -> Workspace {
        let kept = |needed: bool, len: usize| Buffer::new(if needed { len } else { 0 });
        let normalised = gradients && self.shape.normalised;
        let widest = self.shape.hidden.iter().copied().max().unwrap_or(0);
        Workspace {
            layers: (self.shape.hidden.iter())
                .map(|&width| LayerValues {
                    out: Buffer::new(capacity * width),
                    slope: kept(gradients, capacity * width),
                    normalised: kept(normalised, capacity * width),
                    inverse_deviation: kept(normalised, capacity),
                })
                .collect(),
            output: Buffer::new(capacity * self.shape.outputs),
            errors: [kept(gradients, capacity * widest), kept(gradients, capacity * widest)],
            bf16: match arithmetic {
                Arithmetic::F32 => None,
                Arithmetic::Bf16 => Bf16Products::new(capacity, widest),
            },
        }
    }
}
