//! The widths of the randomisation: the paper's table, or half-widths by path, such as the 95 %
//! intervals of an identification.

use std::collections::BTreeMap;

use etude_stage::params::ParamId;
use etude_stage::{DRIVEN_JOINTS, JOINT_NAMES};
use serde::{Deserialize, Serialize};

use super::spread::{Spread, SpreadKind};
use crate::TaskError;

/// What is randomised, and how far at full intensity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected \"paper\", or a table of half-widths by path")]
pub enum Widths {
    /// A set with a name.
    Named(NamedWidths),
    /// Half-widths by path, in the unit of the row: uniform within the nominal value ± this,
    /// clamped to the row's range. `joint.all.<name>` and `joint.fingers.<name>` name several
    /// joints, which are drawn independently. The path of one joint takes precedence over
    /// `fingers`, and `fingers` over `all`.
    Identified(BTreeMap<String, f64>),
}

/// The sets with a name.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NamedWidths {
    /// The paper's seven quantities (`RANDOMISED`).
    Paper,
}

impl Default for Widths {
    fn default() -> Self {
        Self::Named(NamedWidths::Paper)
    }
}

/// The parameters that `widths` names, in the order of the rows of the tables.
pub(super) fn spreads(widths: &BTreeMap<String, f64>) -> Result<Vec<Spread>, TaskError> {
    let mut all: Vec<(ParamId, Option<f64>)> = ParamId::all().map(|id| (id, None)).collect();
    // In ascending order of the paths, `all` comes before `fingers`, and both before the name of
    // any joint.
    for (path, &width) in widths {
        if !(width.is_finite() && width >= 0.0) {
            return Err(TaskError::Value(format!(
                "task.randomisation.widths: {path} = {width} must be a finite number of at least 0, in the unit of the row; \
                 `etude model params` lists the rows"
            )));
        }
        let named = ParamId::named(path)?;
        all.iter_mut()
            .filter(|(id, _)| named.contains(id))
            .for_each(|(_, slot_width)| *slot_width = Some(width));
    }
    let spread = |(id, width): (ParamId, Option<f64>)| Some(Spread { id, kind: SpreadKind::Around(width?) });
    Ok(all.into_iter().filter_map(spread).collect())
}

// `spreads` relies on this order.
const _: () = {
    let mut joint = 0;
    while joint < DRIVEN_JOINTS {
        assert!(JOINT_NAMES[joint].as_bytes()[0] > b'f');
        joint += 1;
    }
};
