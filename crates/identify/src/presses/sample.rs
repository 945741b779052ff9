//! Means with their 95 % intervals, and the parameters that are measured by them.

use etude_stage::JOINT_NAMES;
use etude_stage::hand::{FINGERS, JOINTS_PER_FINGER};
use etude_stage::params::{JointRow, WorldRow};
use serde::{Deserialize, Serialize};

/// Minimum number of presses of each finger.
pub(super) const MIN_PRESSES: usize = 2;

/// A parameter that was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Its path as in `etude_stage::PhysicalParams::rows`.
    pub path: String,
    /// Its value, in its SI unit.
    pub value: f64,
    /// The 95 % interval of the mean over the keys that were pressed.
    pub interval: [f64; 2],
}

/// A mean and half its 95 % interval.
#[derive(Clone, Copy)]
pub(super) struct Sample {
    pub value: f64,
    pub half: f64,
}

impl Sample {
    /// With an error that all values share.
    pub fn with(self, half: f64) -> Self {
        Self { half: self.half.hypot(half), ..self }
    }

    /// Less the other's value; its own error stays.
    pub fn minus(self, other: Self) -> Self {
        Self { value: self.value - other.value, ..self }
    }

    fn within(self, path: String, [low, high]: [f64; 2]) -> Measured {
        let [value, from, to] =
            [self.value, self.value - self.half, self.value + self.half].map(|value| value.clamp(low, high));
        Measured { path, value, interval: [from, to] }
    }
}

/// A parameter of the keyboard.
pub(super) fn world(quantity: WorldRow, sample: Sample) -> Measured {
    let row = quantity.row();
    sample.within(row.name.to_string(), row.range)
}

/// The encoder bias of a finger's joint, counted from its base.
pub(super) fn bias(finger: usize, joint: usize, sample: Sample) -> Measured {
    let row = JointRow::EncoderBias.row();
    let name = JOINT_NAMES[finger * JOINTS_PER_FINGER + joint];
    sample.within(format!("joint.{name}.{}", row.name), row.range)
}

/// Mean of at least two values.
pub(super) fn mean(values: &[f64]) -> Sample {
    let count = values.len() as f64;
    let value = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|other| (other - value).powi(2)).sum::<f64>() / (count - 1.0);
    Sample { value, half: student(count - 1.0) * (variance / count).sqrt() }
}

/// The mean of each finger's values; `None` if one has too few.
pub(super) fn means_by_finger(values_of: impl Fn(usize) -> Vec<f64>) -> Option<[Sample; FINGERS]> {
    let values: [Vec<f64>; FINGERS] = std::array::from_fn(values_of);
    values.iter().all(|of| of.len() >= MIN_PRESSES).then(|| values.map(|of| mean(&of)))
}

/// What the fingers' measurements of the keyboard's position have in common. A keyboard that is
/// elsewhere and encoders that read too far look the same.
pub(super) fn common(positions: &[Sample; FINGERS]) -> Sample {
    let value = positions.iter().map(|position| position.value).sum::<f64>() / FINGERS as f64;
    let half = positions.iter().map(|position| position.half * position.half).sum::<f64>().sqrt();
    Sample { value, half: half / FINGERS as f64 }
}

/// Student's t for 95 % (Abramowitz and Stegun 26.7.5, three terms): 4 % too small with two degrees
/// of freedom, 0.5 % with eight.
fn student(freedom: f64) -> f64 {
    1.96 + 2.372 / freedom + 2.823 / (freedom * freedom) + 2.556 / freedom.powi(3)
}
