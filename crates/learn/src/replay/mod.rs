//! The replay buffer: a ring of transitions with packed observations (real columns as `f32`, binary
//! columns as bits).
//!
//! Transitions are numbered from the beginning of the training. Number `k` is in slot `k %
//! capacity`.

mod segment;

pub(crate) use segment::Segment;

use crate::{env::ObservationLayout, network::Inputs, random::Stream};

/// One transition; the slices are `[observation]`, `[action]`, `[observation]`.
#[derive(Clone, Copy)]
pub(crate) struct Transition<'a> {
    pub observation: &'a [f32],
    pub action: &'a [f32],
    pub reward: f32,
    /// Whether the next transition of the same environment begins another episode.
    pub ends: bool,
    pub next_observation: &'a [f32],
}

/// A ring of transitions.
pub(crate) struct Replay {
    layout: ObservationLayout,
    action_len: usize,
    capacity: usize,
    /// Environments that push in turn: transition `k + num_envs` follows transition `k`.
    num_envs: usize,
    /// Transitions ever pushed.
    total: u64,
    /// `[capacity, 2 * real + action + 1]`: observation, next observation, action, reward.
    values: Vec<f32>,
    /// `[capacity, 2 * words]`: observation, next observation.
    words: Vec<u64>,
    flags: Vec<u8>,
}

/// Flag of a transition that ends its episode.
const ENDS: u8 = 2;

/// Number of rewards of an n-step return, and their discount.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Horizon {
    /// Rewards that are summed, at least 1; fewer where the episode or the replay buffer ends
    /// earlier.
    pub steps: usize,
    /// Weight of the next step, per step.
    pub discount: f64,
}

/// A batch drawn from the replay buffer, as the networks read it.
pub(crate) struct Batch {
    pub observation: Inputs,
    pub next_observation: Inputs,
    /// `[batch, action]`
    pub action: Vec<f32>,
    /// `[batch]`: the discounted rewards up to the horizon.
    pub reward: Vec<f32>,
    /// `[batch]`: weight of the value of the next observation.
    pub discount: Vec<f32>,
}

impl Batch {
    pub(crate) fn new(layout: ObservationLayout, action_len: usize, rows: usize) -> Self {
        Self {
            observation: Inputs::new(layout, action_len, rows),
            next_observation: Inputs::new(layout, action_len, rows),
            action: Vec::with_capacity(rows * action_len),
            reward: Vec::with_capacity(rows),
            discount: Vec::with_capacity(rows),
        }
    }

    pub(crate) fn clear(&mut self) {
        self.observation.clear();
        self.next_observation.clear();
        self.action.clear();
        self.reward.clear();
        self.discount.clear();
    }
}

/// Packs 0/1 values into words, bit `i` of the words being value `i`. A value counts as 1 when it
/// is not 0.
fn pack(binary: &[f32], words: &mut [u64]) {
    for (bits, word) in binary.chunks(64).zip(words) {
        *word = bits.iter().enumerate().fold(0, |word, (i, &bit)| word | (u64::from(bit != 0.0) << i));
    }
}

impl Replay {
    pub(crate) fn new(
        layout: ObservationLayout,
        action_len: usize,
        capacity: usize,
        num_envs: usize,
    ) -> Self {
        // Zeroed pages use no memory until they are written, so a short training does not pay for a
        // large capacity.
        Self {
            layout,
            action_len,
            capacity,
            num_envs,
            total: 0,
            values: vec![0.0; capacity * (2 * layout.real + action_len + 1)],
            words: vec![0; capacity * 2 * layout.words()],
            flags: vec![0; capacity],
        }
    }

    /// Whether the system can allocate such a replay buffer.
    pub(crate) fn fits(layout: ObservationLayout, action_len: usize, capacity: usize) -> bool {
        let transition = 4 * (2 * layout.real + action_len + 1) + 8 * 2 * layout.words() + 1;
        let bytes = capacity.checked_mul(transition);
        bytes.is_some_and(|bytes| Vec::<u8>::new().try_reserve_exact(bytes).is_ok())
    }

    /// Number of transitions held.
    pub(crate) fn len(&self) -> usize {
        self.total.min(self.capacity as u64) as usize
    }

    /// Transitions ever pushed.
    pub(crate) fn total(&self) -> u64 {
        self.total
    }

    /// Number of the oldest transition that is still held.
    pub(crate) fn oldest(&self) -> u64 {
        self.total - self.len() as u64
    }

    fn value_stride(&self) -> usize {
        2 * self.layout.real + self.action_len + 1
    }

    fn slot(&self, number: u64) -> usize {
        (number % self.capacity as u64) as usize
    }

    pub(crate) fn push(&mut self, transition: Transition<'_>) {
        let (slot, real, words) = (self.slot(self.total), self.layout.real, self.layout.words());
        let stride = self.value_stride();
        let values = &mut self.values[slot * stride..(slot + 1) * stride];
        values[..real].copy_from_slice(&transition.observation[..real]);
        values[real..2 * real].copy_from_slice(&transition.next_observation[..real]);
        values[2 * real..stride - 1].copy_from_slice(transition.action);
        values[stride - 1] = transition.reward;
        let packed = &mut self.words[slot * 2 * words..(slot + 1) * 2 * words];
        pack(&transition.observation[real..], &mut packed[..words]);
        pack(&transition.next_observation[real..], &mut packed[words..]);
        self.flags[slot] = u8::from(transition.ends) * ENDS;
        self.total += 1;
    }

    /// Fills `batch` with `rows` transitions, uniformly with replacement. The replay must not be
    /// empty.
    pub(crate) fn sample(&self, stream: &mut Stream, rows: usize, horizon: Horizon, batch: &mut Batch) {
        batch.clear();
        let (stride, real, words) = (self.value_stride(), self.layout.real, self.layout.words());
        for _ in 0..rows {
            let first = stream.below(self.len());
            let (mut last, mut reward, mut discount) = (first, 0.0, 1.0);
            for step in 0..horizon.steps {
                reward += discount * f64::from(self.values[(last + 1) * stride - 1]);
                discount *= horizon.discount;
                if step + 1 == horizon.steps || self.flags[last] != 0 || self.age(last) < self.num_envs {
                    break;
                }
                last = (last + self.num_envs) % self.capacity;
            }
            let [values, after] = [first, last].map(|slot| &self.values[slot * stride..(slot + 1) * stride]);
            let [packed, packed_after] =
                [first, last].map(|slot| &self.words[slot * 2 * words..(slot + 1) * 2 * words]);
            batch.observation.push_packed(&values[..real], &packed[..words]);
            batch.next_observation.push_packed(&after[real..2 * real], &packed_after[words..]);
            batch.action.extend_from_slice(&values[2 * real..stride - 1]);
            batch.reward.push(reward as f32);
            batch.discount.push(discount as f32);
        }
    }

    /// Transitions pushed since the one in `slot`.
    fn age(&self, slot: usize) -> usize {
        let newest = self.slot(self.total - 1);
        (newest + self.capacity - slot) % self.capacity
    }
}

#[cfg(test)]
mod tests;
