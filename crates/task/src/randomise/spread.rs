//! How far one parameter is randomised about its nominal value.

use etude_stage::params::{JointRow, ParamId, PhysicalParams};
use rand::RngExt as _;
use rand_pcg::Pcg64;

/// The range of a parameter at full intensity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum SpreadKind {
    /// From the first to the second, extended to the nominal value where that lies outside.
    Between(f64, f64),
    /// The nominal value ± this.
    Around(f64),
    /// The nominal value times (1 ± this).
    Scaled(f64),
    /// The force of a joint's actuator times (1 ± this). The parameter is its stiffness; its torque
    /// limit has the same factor, or a weaker or stronger drive would push as hard as before.
    Force(f64),
}

/// One parameter and its range.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Spread {
    pub id: ParamId,
    pub kind: SpreadKind,
}

impl Spread {
    /// The largest deviation that [`draw`](Self::draw) returns, to either side.
    pub(super) fn widest(&self) -> f64 {
        match self.kind {
            SpreadKind::Between(..) | SpreadKind::Around(_) => 1.0,
            SpreadKind::Scaled(width) | SpreadKind::Force(width) => width,
        }
    }

    /// Draws a deviation, uniform to either side.
    pub(super) fn draw(&self, random: &mut Pcg64) -> f64 {
        match self.kind {
            SpreadKind::Between(..) => {
                let below = random.random_bool(0.5);
                let deviation = random.random::<f64>();
                if below { -deviation } else { deviation }
            }
            SpreadKind::Around(_) => random.random_range(-1.0..=1.0),
            SpreadKind::Scaled(width) | SpreadKind::Force(width) => random.random_range(-width..=width),
        }
    }

    /// Moves the parameter, which `params` holds at its nominal value, by `deviation` times
    /// `intensity`.
    pub(super) fn set(&self, params: &mut PhysicalParams, intensity: f64, deviation: f64) {
        let nominal = params.value(self.id);
        let value = match self.kind {
            SpreadKind::Between(low, high) => {
                let end = if deviation < 0.0 { low.min(nominal) } else { high.max(nominal) };
                nominal + intensity * deviation.abs() * (end - nominal)
            }
            SpreadKind::Around(width) => nominal + intensity * deviation * width,
            SpreadKind::Scaled(_) | SpreadKind::Force(_) => nominal * (1.0 + intensity * deviation),
        };
        if let (SpreadKind::Force(_), ParamId::Joint(_, joint)) = (self.kind, self.id) {
            let limit = ParamId::Joint(JointRow::TorqueLimit, joint);
            params.set_clamped(limit, params.value(limit) * (1.0 + intensity * deviation));
        }
        params.set_clamped(self.id, value);
    }
}
