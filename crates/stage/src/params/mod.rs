//! `PhysicalParams`: the list of all physical parameters that may vary.
//!
//! The model is built from it, randomisation draws from it, identification estimates it, and
//! configurations and reports name its rows. A parameter has a path such as `key.stiffness` or
//! `joint.index_1.damping`. To add one: a row in one of the two tables of `table.rs`, and its use
//! where the world is built or stepped.

mod table;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::hand::DRIVEN_JOINTS;
pub use table::{JointRow, ParamError, ParamId, ParamRow, WorldRow};

/// The physical parameters of one world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PhysicalParams {
    world: [f64; WorldRow::ALL.len()],
    joints: [[f64; DRIVEN_JOINTS]; JointRow::ALL.len()],
}

impl Default for PhysicalParams {
    fn default() -> Self {
        let mut params =
            Self { world: [0.0; WorldRow::ALL.len()], joints: [[0.0; DRIVEN_JOINTS]; JointRow::ALL.len()] };
        ParamId::all().for_each(|id| *params.value_mut(id) = id.default_value());
        params
    }
}

impl PhysicalParams {
    /// A parameter of the world.
    pub fn world(&self, row: WorldRow) -> f64 {
        self.value(ParamId::World(row))
    }

    /// A parameter of one joint.
    pub fn joint(&self, row: JointRow, index: usize) -> f64 {
        self.value(ParamId::Joint(row, index))
    }

    /// The parameter in `id`.
    pub fn value(&self, id: ParamId) -> f64 {
        match id {
            ParamId::World(row) => self.world[row as usize],
            ParamId::Joint(row, joint) => self.joints[row as usize][joint],
        }
    }

    /// Sets a parameter of the world, clamped to its range.
    pub fn set_world(&mut self, row: WorldRow, value: f64) {
        self.set_clamped(ParamId::World(row), value);
    }

    /// Sets a parameter of one joint, clamped to its range.
    pub fn set_joint(&mut self, row: JointRow, index: usize, value: f64) {
        self.set_clamped(ParamId::Joint(row, index), value);
    }

    /// Sets the parameter in `id`, clamped to its range.
    pub fn set_clamped(&mut self, id: ParamId, value: f64) {
        let [low, high] = id.row().range;
        *self.value_mut(id) = value.clamp(low, high);
    }

    fn value_mut(&mut self, id: ParamId) -> &mut f64 {
        match id {
            ParamId::World(row) => &mut self.world[row as usize],
            ParamId::Joint(row, joint) => &mut self.joints[row as usize][joint],
        }
    }

    /// Checks that every parameter lies in the range of its row, which is not sure for numbers that
    /// were deserialised.
    ///
    /// # Errors
    /// Names the first one that does not.
    pub fn check(&self) -> Result<(), ParamError> {
        ParamId::all().try_for_each(|id| id.check(self.value(id), || id.path()))
    }

    /// Every path with its row and default, in a fixed order. The unit is that of the joint.
    pub fn rows() -> impl Iterator<Item = (String, ParamRow, f64)> {
        ParamId::all().map(|id| (id.path(), ParamRow { unit: id.unit(), ..*id.row() }, id.default_value()))
    }

    /// The parameter at `path`; of several, the first.
    ///
    /// # Errors
    /// If no parameter has this path.
    pub fn get(&self, path: &str) -> Result<f64, ParamError> {
        Ok(self.value(ParamId::named(path)?[0]))
    }

    /// Sets the parameter at `path`; `joint.all.<name>` and `joint.fingers.<name>` set several
    /// joints at once.
    ///
    /// # Errors
    /// If no parameter has this path, or `value` is not in its range.
    pub fn set(&mut self, path: &str, value: f64) -> Result<(), ParamError> {
        for id in ParamId::named(path)? {
            id.check(value, || path.to_string())?;
            *self.value_mut(id) = value;
        }
        Ok(())
    }

    /// The same with other values at these paths. They are set in ascending order of the paths, so
    /// that the path of one joint takes precedence over that of all fingers.
    ///
    /// # Errors
    /// Names the first path or value that is refused.
    pub fn with(mut self, rows: &BTreeMap<String, f64>) -> Result<Self, ParamError> {
        rows.iter().try_for_each(|(path, value)| self.set(path, *value))?;
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hand::RAIL;

    #[test]
    fn every_row_can_be_read_and_set_by_its_path() {
        let mut params = PhysicalParams::default();
        let mut seen = std::collections::BTreeSet::new();
        for (path, row, default) in PhysicalParams::rows() {
            assert!(seen.insert(path.clone()), "{path} twice");
            assert_eq!(params.get(&path), Ok(default));
            assert!((row.range[0]..=row.range[1]).contains(&default), "{path}");
            assert!(!row.doc.is_empty() && !row.unit.is_empty());
            params.set(&path, row.range[1]).unwrap();
            assert_eq!(params.get(&path), Ok(row.range[1]));
            assert!(params.set(&path, row.range[1] * 2.0 + 1.0).is_err());
            assert!(params.set(&path, f64::NAN).is_err());
        }
        assert_eq!(seen.len(), WorldRow::ALL.len() + DRIVEN_JOINTS * JointRow::ALL.len());
    }

    #[test]
    fn the_rail_has_units_of_its_own() {
        let of = |path: &str| PhysicalParams::rows().find(|(known, ..)| known == path).unwrap().1.unit;
        assert_eq!([of("joint.rail.stiffness"), of("joint.index_1.stiffness")], ["N/m", "N·m/rad"]);
        assert_eq!([of("joint.rail.jerk_limit"), of("joint.index_1.jerk_limit")], ["m/s³", "rad/s³"]);
        let mut rail = PhysicalParams::rows().filter(|(path, ..)| path.starts_with("joint.rail."));
        assert!(rail.all(|(_, row, _)| !row.unit.contains("rad") && !row.unit.contains("N·m")));
        let refused = PhysicalParams::default().set("joint.rail.stiffness", -1.0).unwrap_err();
        assert!(refused.to_string().ends_with(" N/m"), "{refused}");
    }

    #[test]
    fn groups_set_several_joints() {
        let mut params = PhysicalParams::default();
        params.set("joint.fingers.delay", 0.01).unwrap();
        assert_eq!(params.joint(JointRow::Delay, 3), 0.01);
        assert_eq!(params.joint(JointRow::Delay, RAIL), 0.0);
        assert_eq!(
            params.set("joint.thumb_0.delay", 0.0),
            Err(ParamError::Unknown("joint.thumb_0.delay".into()))
        );
    }
}
