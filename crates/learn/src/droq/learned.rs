//! A network's parameters together with what Adam keeps about them.

use crate::{buffer::Buffer, network::Network};

/// Parameters, their last gradient and the two Adam moments, all laid out alike.
#[derive(Clone)]
pub(crate) struct Learned {
    pub parameters: Buffer,
    pub gradient: Buffer,
    pub mean: Buffer,
    pub square: Buffer,
}

impl Learned {
    pub(crate) fn new(network: &Network, parameters: Buffer) -> Self {
        let zeros = || network.parameters();
        Self { parameters, gradient: zeros(), mean: zeros(), square: zeros() }
    }
}
