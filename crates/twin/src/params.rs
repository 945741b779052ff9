//! The parameter set of a twin: the physical numbers of its world, its drives and its links, hidden
//! from the controller.
//!
//! A [`TwinParams`] cannot be read outside this crate: it has a name and can be passed to a twin.

use std::fmt;
use std::path::Path;

use etude_emulators::faults::OrderedFault;
use etude_robot::rig_file::{LimitsConfig, RigConfig};

use crate::error::TwinParamsError;
use crate::hidden_params::HiddenParams;
use crate::random;

/// The parameter set of one twin. Its numbers are for the twin alone:
///
/// ```compile_fail,E0616
/// let twin_params = etude_twin::TwinParams::load("standard").unwrap();
/// let _ = &twin_params.hidden; // a private field
/// ```
/// ```compile_fail,E0277
/// let twin_params = etude_twin::TwinParams::load("standard").unwrap();
/// let _ = toml::to_string(&twin_params); // it cannot be serialised
/// ```
/// ```
/// let twin_params = etude_twin::TwinParams::load("standard")?;
/// assert_eq!(twin_params.name(), "standard");
/// assert_eq!(format!("{twin_params:?}"), r#"TwinParams { name: "standard", .. }"#);
/// # Ok::<(), etude_twin::TwinParamsError>(())
/// ```
#[derive(Clone)]
pub struct TwinParams {
    pub(crate) hidden: HiddenParams,
    /// Added to the seed of what changes from run to run.
    run: u64,
    /// Limits of its rig, which everybody may know.
    limits: LimitsConfig,
}

/// The parameter sets that come with Étude, by name.
const BUILT_IN: [(&str, &str); 4] = [
    ("standard", include_str!("../../../configs/twin-params/standard.toml")),
    ("mild", include_str!("../../../configs/twin-params/mild.toml")),
    ("ideal", include_str!("../../../configs/twin-params/ideal.toml")),
    ("worn", include_str!("../../../configs/twin-params/worn.toml")),
];

impl TwinParams {
    /// The parameter set called `name`: a built-in one, `random:SEED`, or a file.
    ///
    /// # Errors
    /// If there is none of these, or it is not sound.
    pub fn load(name: &str) -> Result<Self, TwinParamsError> {
        if let Some(seed) = random::seed(name) {
            return Ok(Self { hidden: random::draw(seed?)?, run: 0, limits: LimitsConfig::default() });
        }
        let fail = |message: String| TwinParamsError::Read { path: Path::new(name).to_path_buf(), message };
        let text = match BUILT_IN.iter().find(|(built_in, _)| *built_in == name) {
            Some((_, text)) => (*text).to_string(),
            None => std::fs::read_to_string(name).map_err(|error| {
                fail(format!("{error}; built in are {}, and random:SEED draws one", Self::names().join(", ")))
            })?,
        };
        Self::parse(&text).map_err(|error| match error {
            TwinParamsError::Text(message) => fail(message),
            error => error,
        })
    }

    /// Names of the built-in parameter sets.
    pub fn names() -> Vec<&'static str> {
        BUILT_IN.iter().map(|(name, _)| *name).collect()
    }

    /// The parameter set in this TOML text; what it leaves out has default values, those of a robot
    /// without wear.
    ///
    /// # Errors
    /// If it is not sound.
    pub fn parse(text: &str) -> Result<Self, TwinParamsError> {
        let hidden: HiddenParams =
            toml::from_str(text).map_err(|error| TwinParamsError::Text(error.to_string()))?;
        hidden.check()?;
        Ok(Self { hidden, run: 0, limits: LimitsConfig::default() })
    }

    /// The same parameter set with the changes in this TOML text, for tests.
    ///
    /// # Errors
    /// If the outcome is not sound.
    pub fn with(&self, changes: &str) -> Result<Self, TwinParamsError> {
        let text = |message: String| TwinParamsError::Text(message);
        let mut table = toml::Table::try_from(&self.hidden).map_err(|error| text(error.to_string()))?;
        lay_over(&mut table, changes.parse().map_err(|error: toml::de::Error| text(error.to_string()))?);
        let hidden: HiddenParams = table.try_into().map_err(|error| text(error.to_string()))?;
        hidden.check()?;
        Ok(Self { hidden, ..self.clone() })
    }

    /// The same parameter set with more faults.
    ///
    /// # Errors
    /// If one of them is not valid.
    pub fn with_faults(mut self, more: &[OrderedFault]) -> Result<Self, TwinParamsError> {
        more.iter().try_for_each(OrderedFault::check)?;
        self.hidden.faults.extend_from_slice(more);
        Ok(self)
    }

    /// A rig for a twin with this parameter set: the default one with its limits, and without a
    /// feed-forward against gravity if its hand has no weight.
    pub fn rig(&self) -> RigConfig {
        let limits = self.limits.clone();
        self.fitting(RigConfig { name: "twin".to_string(), limits, ..RigConfig::default() })
    }

    /// The same twin, whose rig has these limits.
    #[must_use]
    pub fn with_limits(self, limits: LimitsConfig) -> Self {
        Self { limits, ..self }
    }

    /// This rig, without a feed-forward against gravity if the twin's hand has no weight.
    pub(crate) fn fitting(&self, mut rig: RigConfig) -> RigConfig {
        if !self.hidden.world.gravity {
            rig.joint_loop.gravity_pwm_per_nm = 0.0;
        }
        rig
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.hidden.name
    }

    /// A number that differs between parameter sets of different content. It reveals nothing of the
    /// content.
    pub fn fingerprint(&self) -> u32 {
        let text = toml::to_string(&self.hidden).expect("twin parameters are made of TOML values");
        crc32c::crc32c(text.as_bytes())
    }

    /// The same twin in another run: its noise and its links use another seed; its keys and
    /// everything else stay the same.
    #[must_use]
    pub fn with_seed_added(&self, run: u64) -> Self {
        Self { run: self.run.wrapping_add(run), ..self.clone() }
    }

    /// Seed of what changes from run to run.
    pub(crate) fn run_seed(&self) -> u64 {
        self.hidden.seed.wrapping_add(self.run)
    }
}

impl fmt::Debug for TwinParams {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.debug_struct("TwinParams").field("name", &self.name()).finish_non_exhaustive()
    }
}

/// Lays one table over another, entry by entry.
fn lay_over(table: &mut toml::Table, changes: toml::Table) {
    for (key, change) in changes {
        match (table.get_mut(&key), change) {
            (Some(toml::Value::Table(below)), toml::Value::Table(above)) => lay_over(below, above),
            (_, change) => drop(table.insert(key, change)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use etude_stage::{Cone, Integrator, PhysicalParams};

    #[test]
    fn built_in_parameter_sets_are_sound_and_named_as_they_are() {
        for (name, _) in BUILT_IN {
            assert_eq!(TwinParams::load(name).unwrap().name(), name);
        }
        let missing = TwinParams::load("nowhere.toml").unwrap_err().to_string();
        assert!(missing.contains("nowhere.toml") && missing.contains("standard"), "{missing}");
    }

    /// The table of the design: each of these is what makes a twin's world another than the
    /// simulator's.
    #[test]
    fn the_standard_parameter_set_leaves_nothing_ideal() {
        for name in ["standard", "worn"] {
            let hidden = TwinParams::load(name).unwrap().hidden;
            let (hand, keys) = (&hidden.hand, &hidden.keys);
            assert_eq!(hidden.world.integrator, Integrator::ImplicitFast, "{name}");
            assert_eq!(hidden.world.cone, Cone::Pyramidal, "{name}");
            assert_ne!(hidden.params().unwrap(), PhysicalParams::default(), "{name}");
            for path in ["joint.index_1.friction", "joint.ring_3.friction"] {
                assert!(hidden.params().unwrap().get(path).unwrap() > 0.0, "{name} {path}");
            }
            let more_than_nothing = [
                hidden.world.keyboard_yaw_rad.abs(),
                hidden.params().unwrap().get("joint.index_1.friction_at_rest").unwrap() - 1.0,
                hand.encoder_backlash_rad,
                hand.filter_secs,
                f64::from(hand.dead_pwm),
                f64::from(hand.noise_counts),
                hidden.arm.delay_secs,
                hidden.arm.sag_m,
                hidden.arm.error_m,
                hand.motor_backlash_rad,
                hand.no_load_rad_per_sec.unwrap(),
                hidden.params().unwrap().get("key.preload").unwrap(),
                keys.threshold_spread,
                keys.stiffness_spread,
                (keys.travel - 1.0).abs(),
                hidden.links.can.delay_secs,
                hidden.links.arm.delay_secs,
                hidden.links.midi.delay_secs,
            ];
            assert!(more_than_nothing.iter().all(|number| *number > 0.0), "{name}: {more_than_nothing:?}");
        }
    }

    #[test]
    fn nonsense_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.toml");
        let refused = |text: &str| {
            std::fs::write(&path, text).unwrap();
            TwinParams::load(path.to_str().unwrap()).unwrap_err().to_string()
        };
        assert!(refused("[physics]\n\"key.weight\" = 1").contains("key.weight"));
        assert!(refused("[arm]\nbandwidth_hz = nan").contains("bandwidth_hz"));
        assert!(refused("colour = 1").contains("colour"));
        assert!(refused("colour = 1").contains("t.toml"));
        assert!(refused("[world]\ncone = \"round\"").contains("pyramidal"));
        assert!(refused("[hand]\nno_load_rad_per_sec = 0").contains("no_load_rad_per_sec"));
        assert!(refused("[hand]\nmotor_backlash_rad = -0.1").contains("motor_backlash_rad"));
        assert!(refused("[arm]\ndamping_ratio = 0").contains("damping_ratio"));
        assert!(refused("[arm]\ntilt_rad = [0, 0.2]").contains("tilt_rad"));
        assert!(refused("[arm]\nsag_m = 0.1").contains("sag_m"));
        assert!(refused("[arm]\nerror_m = -1").contains("error_m"));
        assert!(refused("[arm]\nerror_period_m = 0").contains("error_period_m"));
        assert!(refused("[physics]\n\"key.preload\" = 5").contains("key.preload"));
        assert!(refused("[world]\nkeyboard_yaw_rad = 0.1").contains("keyboard_yaw_rad"));
        assert!(refused("[hand]\nfull_torque_nm = [1, 1, -1, 1]").contains("full_torque_nm"));
        assert!(refused("[physics]\n\"joint.fingers.friction_at_rest\" = 0.5").contains("friction_at_rest"));
        assert!(refused("[[faults]]\nkind = \"fire\"\nat_secs = 1").contains("can-bus-off, can-silent"));
        assert!(refused("[[faults]]\nkind = \"estop\"\nat_secs = -1").contains("estop@-1"));
        assert!(
            refused("[[faults]]\nkind = \"hand-off\"\nat_secs = 1\nfor_secs = 1").contains("no duration")
        );
        assert!(refused("[[faults]]\nkind = \"estop\"\nat_secs = 1\nuntil_secs = 1").contains("until_secs"));
        // The first contact must come before the second one of every key.
        assert!(refused("[keys]\nfirst_contact = 0.5").contains("first_contact"));
        assert!(refused("[keys]\nfirst_contact = 0.4\nthreshold_spread = 0.2").contains("first_contact"));
        assert!(
            refused("[physics]\n\"key.threshold\" = 0.9\n[keys]\nthreshold_spread = 0.2").contains("spread")
        );
    }

    #[test]
    fn changes_are_laid_over_and_the_rest_stays() {
        let standard = TwinParams::load("standard").unwrap();
        let changed =
            standard.with("seed = 7\n[links.can]\nloss = 0.25\n[hand]\ntorque_timeout_secs = 0.1").unwrap();
        let mut expected = standard.hidden.clone();
        expected.seed = 7;
        expected.links.can.loss = 0.25;
        expected.hand.torque_timeout_secs = Some(0.1);
        assert_eq!(changed.hidden, expected);
        assert!(standard.with("[links.can]\nlost = 1").unwrap_err().to_string().contains("lost"));
    }

    #[test]
    fn a_run_has_its_own_dice_and_the_same_keys() {
        let standard = TwinParams::load("standard").unwrap();
        let third = standard.with_seed_added(1).with_seed_added(2);
        assert_eq!(third.run_seed(), standard.run_seed() + 3);
        assert_eq!(third.hidden, standard.hidden);
        assert_eq!(standard.with_seed_added(u64::MAX).run_seed(), standard.run_seed() - 1);
    }
}
