//! Faults ordered for a time: by `[[faults]]` in a file of twin parameters, by `--fault
//! KIND[=VALUE]@SECS[+SECS]`, or by a test.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::kind::{FaultError, FaultKind};
use super::plan::DAY_SECS;
use crate::Devices;

/// A fault and its time, as in a file of twin parameters.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OrderedFault {
    /// What goes wrong: `KIND[=VALUE]`.
    pub kind: FaultKind,
    /// When, s since the twin was switched on.
    pub at_secs: f64,
    /// For how long, s; without an end if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub for_secs: Option<f64>,
}

impl OrderedFault {
    /// Checks that its times are in range and that a fault with a length can end.
    ///
    /// # Errors
    /// If not.
    pub fn check(&self) -> Result<(), FaultError> {
        let time = |secs: f64| (0.0..=DAY_SECS).contains(&secs);
        if !(time(self.at_secs) && self.for_secs.is_none_or(time)) {
            return Err(FaultError::When(self.to_string()));
        }
        if self.for_secs.is_some() && !self.kind.lasts() {
            return Err(FaultError::Moment(self.to_string()));
        }
        Ok(())
    }
}

impl FromStr for OrderedFault {
    type Err = FaultError;

    /// Reads `KIND[=VALUE]@SECS[+SECS]`.
    fn from_str(text: &str) -> Result<Self, FaultError> {
        let when = || FaultError::When(text.to_string());
        let (kind, times) = text.split_once('@').ok_or_else(when)?;
        let (at, length) = times.split_once('+').map_or((times, None), |(at, length)| (at, Some(length)));
        let secs = |text: &str| text.parse().map_err(|_| when());
        let fault = Self { kind: kind.parse()?, at_secs: secs(at)?, for_secs: length.map(secs).transpose()? };
        fault.check()?;
        Ok(fault)
    }
}

impl fmt::Display for OrderedFault {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}@{}", self.kind, self.at_secs)?;
        self.for_secs.map_or(Ok(()), |secs| write!(out, "+{secs}"))
    }
}

/// The ordered faults, and those that are active now.
#[derive(Clone, Debug, Default)]
pub struct Faults {
    /// Begins (`true`) and ends that are still to come, the next one last.
    to_come: Vec<(Duration, FaultKind, bool)>,
    now: Vec<FaultKind>,
}

impl Faults {
    /// Faults with these orders, which [`OrderedFault::check`] has accepted.
    pub fn new(ordered: &[OrderedFault]) -> Self {
        // `check` has refused negative and infinite times.
        let time = |secs: f64| Duration::try_from_secs_f64(secs).unwrap_or(Duration::MAX);
        let mut to_come = Vec::new();
        for fault in ordered {
            to_come.push((time(fault.at_secs), fault.kind, true));
            let end = fault.for_secs.map(|secs| time(fault.at_secs + secs));
            to_come.extend(end.map(|end| (end, fault.kind, false)));
        }
        // Of those at the same time, first what was ordered first.
        to_come.reverse();
        to_come.sort_by_key(|(at, ..)| std::cmp::Reverse(*at));
        Self { to_come, now: Vec::new() }
    }

    /// Begins and ends what is due at `now`.
    pub fn advance(&mut self, devices: &mut Devices, now: Duration) {
        while let Some((_, kind, begins)) = self.to_come.pop_if(|(at, ..)| *at <= now) {
            if begins { self.begin(kind, devices, now) } else { self.end(kind, devices, now) }
        }
    }

    /// Begins a fault now.
    pub fn begin(&mut self, kind: FaultKind, devices: &mut Devices, now: Duration) {
        kind.set(true, devices, now);
        if kind.lasts() {
            self.now.push(kind);
        }
    }

    /// Ends one fault of this kind; an equal one that was ordered as well stays.
    pub fn end(&mut self, kind: FaultKind, devices: &mut Devices, now: Duration) {
        let Some(at) = self.now.iter().position(|other| *other == kind) else { return };
        self.now.remove(at);
        kind.set(false, devices, now);
        // What two faults have in common ends with the second.
        self.now.iter().for_each(|other| other.set(true, devices, now));
    }

    /// Ends all faults.
    pub fn end_all(&mut self, devices: &mut Devices, now: Duration) {
        self.now.drain(..).for_each(|kind| kind.set(false, devices, now));
    }

    /// Whether this fault is active now.
    pub fn has(&self, kind: FaultKind) -> bool {
        self.now.contains(&kind)
    }

    /// Whether the positions of a finger (0 index to 3 thumb) are lost now.
    pub fn silences(&self, finger: usize) -> bool {
        self.now
            .iter()
            .any(|kind| matches!(kind, FaultKind::FingerSilent(silent) if usize::from(*silent) == finger))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::faults::kind::KINDS;
    use crate::{
        ArmEmulator, ArmEmulatorConfig, HandEmulator, HandEmulatorConfig, KeyboardEmulator,
        KeyboardEmulatorConfig,
    };

    fn any_kind() -> impl Strategy<Value = FaultKind> {
        let valued = prop_oneof![
            (0..4_u8).prop_map(FaultKind::FingerSilent),
            (1..=u8::MAX).prop_map(FaultKind::ArmError),
            (0..4_u8, any::<u8>()).prop_map(|(finger, celsius)| FaultKind::HandHot(finger, celsius)),
            any::<u8>().prop_map(FaultKind::BoardHot),
            (1..128_u8).prop_map(|bits| FaultKind::HandFault(2 * bits)),
        ];
        let plain = FaultKind::examples().collect::<Vec<_>>();
        prop_oneof![valued, prop::sample::select(plain)]
    }

    proptest! {
        #[test]
        fn a_fault_is_read_as_it_is_written(
            kind in any_kind(), at_secs in 0.0..=DAY_SECS, for_secs in prop::option::of(0.0..=DAY_SECS),
        ) {
            let fault = OrderedFault { kind, at_secs, for_secs: for_secs.filter(|_| kind.lasts()) };
            prop_assert_eq!(fault.to_string().parse(), Ok(fault));
            let text = toml::to_string(&fault).unwrap();
            prop_assert_eq!(toml::from_str::<OrderedFault>(&text).unwrap(), fault);
        }

        #[test]
        fn whatever_is_written_is_read_or_refused_with_advice(
            text in prop_oneof![
                "[a-z]{0,8}(-[a-z]{0,8})?(=[0-9:]{0,6})?(@[0-9.+e-]{0,8})?",
                "\\PC{0,20}",
                (any_kind(), "[@+=:0-9.einfa-]{0,8}").prop_map(|(kind, rest)| format!("{kind}{rest}")),
            ],
        ) {
            match text.parse::<OrderedFault>() {
                Ok(fault) => {
                    prop_assert!(fault.at_secs >= 0.0 && fault.at_secs <= DAY_SECS);
                    prop_assert!(fault.for_secs.is_none_or(|secs| (0.0..=DAY_SECS).contains(&secs)));
                    prop_assert_eq!(fault.to_string().parse(), Ok(fault));
                }
                Err(FaultError::Moment(given)) => prop_assert!(!given.is_empty()),
                Err(error) => {
                    let said = error.to_string();
                    prop_assert!(KINDS.iter().all(|(name, ..)| said.contains(name)), "{}", said);
                }
            }
        }
    }

    #[test]
    fn every_kind_has_a_row_and_a_name() {
        for (name, example) in KINDS {
            assert_eq!(example.to_string().split('=').next(), Some(name));
            assert_eq!(example.to_string().parse(), Ok(example));
        }
        for odd in [
            "estop",
            "estop@",
            "estop@-1",
            "estop@1+-1",
            "estop@nan",
            "estop@1+inf",
            "estop=1@1",
            "@1",
            "",
            "arm-error@1",
            "arm-error=0@1",
            "arm-error=256@1",
            "hand-hot=4:70@1",
            "hand-hot=70@1",
            "hand-fault=1@1",
            "finger-silent=4@1",
            "estop@1+2+3",
            "estop@90000",
            "fire@1",
        ] {
            assert!(odd.parse::<OrderedFault>().is_err(), "{odd}");
        }
        assert!(matches!("arm-error=31@1+2".parse::<OrderedFault>(), Err(FaultError::Moment(_))));
        assert!("arm-error=2@1+2".parse::<OrderedFault>().is_ok());
    }

    #[test]
    fn faults_come_and_go_in_their_time() {
        let mut devices = Devices {
            hand: HandEmulator::new(&HandEmulatorConfig::default()),
            arm: ArmEmulator::new(ArmEmulatorConfig::default()),
            keyboard: KeyboardEmulator::new(&KeyboardEmulatorConfig::default()).unwrap(),
        };
        let order = |text: &str| text.parse::<OrderedFault>().unwrap();
        let ordered =
            ["hand-fault=6@0.002+0.004", "hand-fault=4@0.004+0.004", "estop@0.003+0.002", "can-silent@0.007"];
        let mut faults = Faults::new(&ordered.map(order));
        let mut seen = Vec::new();
        for millis in 0..10 {
            faults.advance(&mut devices, Duration::from_millis(millis));
            let silent = faults.has(FaultKind::CanSilent);
            seen.push((devices.hand.config_mut().fault_bits, devices.arm.error(), silent));
        }
        let quiet = (0, 0, false);
        let (late, end) = ((4, 0, true), (0, 0, true));
        let expected = [
            quiet,
            quiet,
            (6, 0, false),
            (6, 1, false),
            (6, 1, false),
            (6, 0, false),
            (4, 0, false),
            late,
            end,
            end,
        ];
        assert_eq!(seen, expected);
    }
}
