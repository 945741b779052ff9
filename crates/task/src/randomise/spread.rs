//! How far one number goes from its nominal value.

use etude_stage::JOINT_NAMES;
use etude_stage::params::{Joint, PhysicalParams, World};
use rand::RngExt as _;
use rand_pcg::Pcg64;

/// Where one number of [`PhysicalParams`] lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Slot {
    World(World),
    Joint(Joint, usize),
}

/// How far a number goes at full intensity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Reach {
    /// From the first to the second; to the nominal value where that lies outside.
    Between(f64, f64),
    /// The nominal value plus or minus this.
    Around(f64),
    /// The nominal value times one plus or minus this.
    Scaled(f64),
}

/// One number and how far it goes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Spread {
    pub slot: Slot,
    pub reach: Reach,
}

impl Slot {
    /// As [`PhysicalParams::rows`] names it.
    pub(super) fn path(self) -> String {
        match self {
            Self::World(quantity) => quantity.row().name.to_string(),
            Self::Joint(quantity, joint) => format!("joint.{}.{}", JOINT_NAMES[joint], quantity.row().name),
        }
    }

    fn get(self, params: &PhysicalParams) -> f64 {
        match self {
            Self::World(quantity) => params.world(quantity),
            Self::Joint(quantity, joint) => params.joint(quantity, joint),
        }
    }

    /// Clamps to the row.
    fn set(self, params: &mut PhysicalParams, value: f64) {
        match self {
            Self::World(quantity) => params.set_world(quantity, value),
            Self::Joint(quantity, joint) => params.set_joint(quantity, joint, value),
        }
    }
}

impl Spread {
    /// The largest deviation that [`draw`](Self::draw) gives, to either side.
    pub(super) fn widest(&self) -> f64 {
        match self.reach {
            Reach::Between(..) | Reach::Around(_) => 1.0,
            Reach::Scaled(width) => width,
        }
    }

    /// A deviation, uniform to either side.
    pub(super) fn draw(&self, random: &mut Pcg64) -> f64 {
        match self.reach {
            Reach::Between(..) => {
                let below = random.random_bool(0.5);
                let deviation = random.random::<f64>();
                if below { -deviation } else { deviation }
            }
            Reach::Around(_) => random.random_range(-1.0..=1.0),
            Reach::Scaled(width) => random.random_range(-width..=width),
        }
    }

    /// Puts the number, which `params` holds at its nominal value, `deviation` off it.
    pub(super) fn set(&self, params: &mut PhysicalParams, intensity: f64, deviation: f64) {
        let nominal = self.slot.get(params);
        let value = match self.reach {
            Reach::Between(low, high) => {
                let end = if deviation < 0.0 { low.min(nominal) } else { high.max(nominal) };
                nominal + intensity * deviation.abs() * (end - nominal)
            }
            Reach::Around(width) => nominal + intensity * deviation * width,
            Reach::Scaled(_) => nominal * (1.0 + intensity * deviation),
        };
        self.slot.set(params, value);
    }
}
