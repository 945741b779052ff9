//! A network's parameters with their Adam moments.

use crate::{buffer::Buffer, kernels::add_row, network::Network};

/// Values added up at a time, few enough to stay in the first cache.
const BLOCK: usize = 2048;

/// Parameters, their last gradient and the two Adam moments, all laid out alike.
#[derive(Clone)]
pub(crate) struct Trainable {
    pub parameters: Buffer,
    pub gradient: Buffer,
    pub mean: Buffer,
    pub square: Buffer,
}

impl Trainable {
    pub(crate) fn new(network: &Network, parameters: Buffer) -> Self {
        let zeros = || network.parameters();
        Self { parameters, gradient: zeros(), mean: zeros(), square: zeros() }
    }

    /// Makes `gradient` the sum of `parts`, always in their order.
    pub(crate) fn gather<'a>(&mut self, parts: impl Iterator<Item = &'a [f32]> + Clone) {
        for (index, sums) in self.gradient.chunks_mut(BLOCK).enumerate() {
            let columns = index * BLOCK..index * BLOCK + sums.len();
            let mut parts = parts.clone().map(|part| &part[columns.clone()]);
            match parts.next() {
                Some(first) => sums.copy_from_slice(first),
                None => sums.fill(0.0),
            }
            parts.for_each(|part| add_row(sums, part));
        }
    }
}
