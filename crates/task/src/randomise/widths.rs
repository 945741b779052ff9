//! Where the widths come from: the paper's table, or half-widths by the path of the number, such as the 95 % intervals of an
//! identification.

use std::collections::BTreeMap;
use std::fmt;

use etude_stage::params::{Joint, ParamError, World};
use etude_stage::{JOINT_NAMES, JOINTS, RAIL};
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::spread::{Reach, Slot, Spread};
use crate::TaskError;

/// What varies, and how far at full intensity.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Widths {
    /// The paper's seven quantities ([`RANDOMISED`](super::RANDOMISED)); `"paper"` in a configuration.
    #[default]
    Paper,
    /// Half-widths by path, in the unit of the row: uniform within the nominal value plus or minus this, clamped to the row.
    /// `joint.all.<name>` and `joint.fingers.<name>` stand for several joints, each of which is drawn by itself; a
    /// joint's own path goes before `fingers`, and that before `all`.
    Identified(BTreeMap<String, f64>),
}

const PAPER: &str = "paper";

impl Serialize for Widths {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Paper => serializer.serialize_str(PAPER),
            Self::Identified(widths) => widths.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Widths {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = Widths;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("\"paper\", or a table of half-widths by path")
            }

            fn visit_str<E: serde::de::Error>(self, text: &str) -> Result<Widths, E> {
                if text == PAPER {
                    return Ok(Widths::Paper);
                }
                Err(E::invalid_value(serde::de::Unexpected::Str(text), &self))
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Widths, A::Error> {
                let mut widths = BTreeMap::new();
                while let Some((path, width)) = map.next_entry()? {
                    widths.insert(path, width);
                }
                Ok(Widths::Identified(widths))
            }
        }
        deserializer.deserialize_any(Either)
    }
}

/// The numbers that `widths` name, in the order of the rows, whatever the paths are that name them.
pub(super) fn spreads(widths: &BTreeMap<String, f64>) -> Result<Vec<Spread>, TaskError> {
    let world = World::ALL.iter().map(|quantity| Slot::World(*quantity));
    let joints =
        Joint::ALL.iter().flat_map(|quantity| (0..JOINTS).map(|joint| Slot::Joint(*quantity, joint)));
    let mut all: Vec<(Slot, Option<f64>)> = world.chain(joints).map(|slot| (slot, None)).collect();
    // Ascending, so that `all` comes before `fingers`, and both before the name of any joint.
    for (path, &width) in widths {
        if !(width.is_finite() && width >= 0.0) {
            return Err(TaskError::BadWidth(path.clone(), width));
        }
        let mut named =
            all.iter_mut().filter(|(slot, _)| group_paths(*slot).any(|named| named == *path)).peekable();
        if named.peek().is_none() {
            return Err(ParamError::Unknown(path.clone()).into());
        }
        named.for_each(|(_, slot_width)| *slot_width = Some(width));
    }
    let spread = |(slot, width): (Slot, Option<f64>)| Some(Spread { slot, reach: Reach::Around(width?) });
    Ok(all.into_iter().filter_map(spread).collect())
}

/// Every path that stands for this number.
fn group_paths(slot: Slot) -> impl Iterator<Item = String> {
    let groups: &[&str] = match slot {
        Slot::World(_) => &[],
        Slot::Joint(_, RAIL) => &["all"],
        Slot::Joint(..) => &["all", "fingers"],
    };
    let name = match slot {
        Slot::World(_) => "",
        Slot::Joint(quantity, _) => quantity.row().name,
    };
    let of_group = move |group: &&str| format!("joint.{group}.{name}");
    std::iter::once(slot.path()).chain(groups.iter().map(of_group))
}

// The order in which paths are taken rests on it.
const _: () = {
    let mut joint = 0;
    while joint < JOINTS {
        assert!(JOINT_NAMES[joint].as_bytes()[0] > b'f');
        joint += 1;
    }
};
