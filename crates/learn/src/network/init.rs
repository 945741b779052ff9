//! Initial parameters: Xavier-uniform weights (Glorot and Bengio 2010), zero biases, unit LayerNorm
//! scales.

use super::{Network, shape::Role};
use crate::{buffer::Buffer, random::Stream};

impl Network {
    /// Initial parameters; `stream` is drawn in the order of the tensors.
    pub(crate) fn initialise(&self, stream: &mut Stream) -> Buffer {
        let mut parameters = self.parameters();
        for tensor in &self.parameter_layout.tensors {
            let values = &mut parameters[tensor.range.clone()];
            match tensor.role {
                Role::Weight => {
                    let limit = (6.0 / (tensor.shape[0] + tensor.shape[1]) as f32).sqrt();
                    values.fill_with(|| limit * (2.0 * stream.uniform() - 1.0));
                }
                Role::Bias => values.fill(0.0),
                Role::Scale => values.fill(1.0),
            }
        }
        parameters
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{env::ObservationLayout, network::Shape};

    #[test]
    fn weights_fill_their_range_and_the_rest_is_constant() {
        let layout = ObservationLayout { real: 4, binary: 20 };
        let network =
            Network::new(Shape { layout, extra: 3, hidden: vec![64, 32], outputs: 1, normalised: true });
        let parameters = network.initialise(&mut Stream::new(1, "init"));
        for tensor in &network.parameter_layout.tensors {
            let values = &parameters[tensor.range.clone()];
            let (low, high) = values.iter().fold((f32::MAX, f32::MIN), |(l, h), &x| (l.min(x), h.max(x)));
            match tensor.role {
                Role::Weight if values.len() > 500 => {
                    let limit = (6.0 / tensor.shape.iter().sum::<usize>() as f32).sqrt();
                    assert!(low >= -limit && low < -0.98 * limit && high <= limit && high > 0.98 * limit);
                }
                Role::Weight => {}
                Role::Bias => assert!(low == 0.0 && high == 0.0),
                Role::Scale => assert!(low == 1.0 && high == 1.0),
            }
        }
    }
}
