//! A batch of observations as the first layer reads it: real columns dense, binary columns as lists
//! of ones.

use crate::{buffer::Buffer, env::ObservationLayout};

/// Up to `capacity` observations, each with room for the action that a critic also reads.
#[derive(Clone)]
pub(crate) struct Inputs {
    layout: ObservationLayout,
    extra: usize,
    capacity: usize,
    rows: usize,
    /// `[rows, real + extra]`; the extras are written by [`set_extra`](Self::set_extra).
    dense: Buffer,
    /// `[rows + 1]`: row `r` has its ones at `ones[offsets[r]..offsets[r + 1]]`.
    offsets: Vec<u32>,
    /// Indices of binary columns that are 1, ascending within a row.
    ones: Vec<u32>,
}

impl Inputs {
    pub(crate) fn new(layout: ObservationLayout, extra: usize, capacity: usize) -> Self {
        let mut offsets = Vec::with_capacity(capacity + 1);
        offsets.push(0);
        Self {
            layout,
            extra,
            capacity,
            rows: 0,
            dense: Buffer::new(capacity * (layout.real + extra)),
            offsets,
            ones: Vec::with_capacity(capacity * layout.binary),
        }
    }

    pub(crate) fn rows(&self) -> usize {
        self.rows
    }

    pub(crate) fn capacity(&self) -> usize {
        self.capacity
    }

    pub(crate) fn clear(&mut self) {
        self.rows = 0;
        self.offsets.truncate(1);
        self.ones.clear();
    }

    /// Appends an observation from its parts; bit `i` of the words is binary column `i`.
    pub(crate) fn push_packed(&mut self, real: &[f32], words: &[u64]) {
        self.push_real(real);
        for (index, &word) in words.iter().enumerate() {
            let mut rest = word;
            while rest != 0 {
                self.ones.push(index as u32 * 64 + rest.trailing_zeros());
                rest &= rest - 1;
            }
        }
        self.offsets.push(self.ones.len() as u32);
    }

    /// Appends an observation of an environment; a binary column counts as 1 when it is not 0.
    pub(crate) fn push(&mut self, observation: &[f32]) {
        let (real, binary) = observation.split_at(self.layout.real);
        self.push_real(real);
        self.ones
            .extend(binary.iter().enumerate().filter(|(_, x)| **x != 0.0).map(|(index, _)| index as u32));
        self.offsets.push(self.ones.len() as u32);
    }

    fn push_real(&mut self, real: &[f32]) {
        let start = self.rows * self.stride();
        self.dense[start..start + self.layout.real].copy_from_slice(real);
        self.rows += 1;
    }

    /// Writes the extras of all rows from `[rows, extra]`.
    pub(crate) fn set_extra(&mut self, values: &[f32]) {
        let (stride, real, extra) = (self.stride(), self.layout.real, self.extra);
        for (row, values) in
            self.dense.chunks_exact_mut(stride).zip(values.chunks_exact(extra)).take(self.rows)
        {
            row[real..].copy_from_slice(values);
        }
    }

    pub(crate) fn stride(&self) -> usize {
        self.layout.real + self.extra
    }

    pub(crate) fn dense(&self) -> &[f32] {
        &self.dense[..self.rows * self.stride()]
    }

    pub(crate) fn offsets(&self) -> &[u32] {
        &self.offsets
    }

    pub(crate) fn ones(&self) -> &[u32] {
        &self.ones
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ways_in_agree() {
        let layout = ObservationLayout { real: 2, binary: 70 };
        let mut observation = vec![0.5, -0.5];
        observation.extend((0..70).map(|i| if i % 23 == 0 { 1.0 } else { 0.0 }));
        let words = [(1u64) | (1 << 23) | (1 << 46), 1 << (69 - 64)];
        let (mut a, mut b) = (Inputs::new(layout, 1, 2), Inputs::new(layout, 1, 2));
        for _ in 0..2 {
            a.push(&observation);
            b.push_packed(&observation[..2], &words);
        }
        a.set_extra(&[7.0, 8.0]);
        b.set_extra(&[7.0, 8.0]);
        assert_eq!(a.ones(), &[0, 23, 46, 69, 0, 23, 46, 69]);
        assert_eq!((a.dense(), a.ones(), a.offsets()), (b.dense(), b.ones(), b.offsets()));
        assert_eq!(a.dense(), &[0.5, -0.5, 7.0, 0.5, -0.5, 8.0]);
        a.clear();
        assert_eq!((a.rows(), a.ones().len(), a.capacity()), (0, 0, 2));
    }
}
