//! The shape of a network, and where each of its tensors is in one contiguous parameter buffer.
//!
//! With one buffer, the optimiser is a single pass and the checkpoint a table. Every tensor starts
//! on a cache line; the gaps between them stay zero (zero gradient, zero moments).

use std::ops::Range;

use crate::env::ObservationLayout;

const LINE: usize = 16;

/// What a network computes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Shape {
    /// Columns of the observation that comes in.
    pub layout: ObservationLayout,
    /// Further real-valued inputs (the critic's action), placed after the real columns.
    pub extra: usize,
    /// Widths of the hidden layers, of which there is at least one.
    pub hidden: Vec<usize>,
    /// Outputs of the linear head.
    pub outputs: usize,
    /// Whether hidden layers have dropout and LayerNorm before the activation (critics) or not
    /// (actor).
    pub normalised: bool,
}

/// Kind of a tensor, which determines its initialisation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    Weight,
    Bias,
    Scale,
}

/// One named tensor inside the parameter buffer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Tensor {
    /// For example `layer0.weight`.
    pub name: String,
    /// `[inputs, outputs]` for weights, `[outputs]` for the rest.
    pub shape: Vec<usize>,
    pub role: Role,
    pub range: Range<usize>,
}

/// Ranges of one hidden layer's tensors; `scale` and `shift` are empty without LayerNorm.
#[derive(Clone, Debug)]
pub(crate) struct Layer {
    pub inputs: usize,
    pub outputs: usize,
    pub weight: Range<usize>,
    pub bias: Range<usize>,
    pub scale: Range<usize>,
    pub shift: Range<usize>,
}

/// All ranges of a network.
#[derive(Clone, Debug)]
pub(crate) struct ParameterLayout {
    pub layers: Vec<Layer>,
    pub head: Layer,
    pub tensors: Vec<Tensor>,
    pub len: usize,
}

impl Shape {
    /// Real-valued inputs, which come first in the rows of the first weight: real columns, then
    /// extras, then the binary columns.
    pub(crate) fn dense_inputs(&self) -> usize {
        self.layout.real + self.extra
    }

    pub(crate) fn inputs(&self) -> usize {
        self.dense_inputs() + self.layout.binary
    }

    pub(crate) fn parameter_layout(&self) -> ParameterLayout {
        let mut builder = Builder { tensors: Vec::new(), len: 0 };
        let mut inputs = self.inputs();
        let mut layers = Vec::with_capacity(self.hidden.len());
        for (index, &outputs) in self.hidden.iter().enumerate() {
            layers.push(builder.layer(&format!("layer{index}"), inputs, outputs, self.normalised));
            inputs = outputs;
        }
        let head = builder.layer("head", inputs, self.outputs, false);
        ParameterLayout { layers, head, tensors: builder.tensors, len: builder.len }
    }
}

struct Builder {
    tensors: Vec<Tensor>,
    len: usize,
}

impl Builder {
    fn layer(&mut self, name: &str, inputs: usize, outputs: usize, normalised: bool) -> Layer {
        let weight = self.tensor(format!("{name}.weight"), vec![inputs, outputs], Role::Weight);
        let bias = self.tensor(format!("{name}.bias"), vec![outputs], Role::Bias);
        let (scale, shift) = if normalised {
            let scale = self.tensor(format!("{name}.norm_scale"), vec![outputs], Role::Scale);
            (scale, self.tensor(format!("{name}.norm_shift"), vec![outputs], Role::Bias))
        } else {
            (0..0, 0..0)
        };
        Layer { inputs, outputs, weight, bias, scale, shift }
    }

    fn tensor(&mut self, name: String, shape: Vec<usize>, role: Role) -> Range<usize> {
        let range = self.len..self.len + shape.iter().product::<usize>();
        self.len = range.end.next_multiple_of(LINE);
        self.tensors.push(Tensor { name, shape, role, range: range.clone() });
        range
    }
}
