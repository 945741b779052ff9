//! What goes wrong on a link, and the random draws that decide when.

use std::time::Duration;

use etude_checks::{RangeError, check_range};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// Longest time of a fault, s.
pub(super) const DAY_SECS: f64 = 86_400.0;

/// What goes wrong on one link. The default: nothing.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FaultPlan {
    /// Time from one end to the other, in seconds.
    pub delay_secs: f64,
    /// Up to so much more, evenly distributed, in seconds. Jitter alone never changes the order.
    pub jitter_secs: f64,
    /// Probability that a frame, or a single byte, is lost.
    pub loss: f64,
    /// Probability that a frame arrives twice (frames only).
    pub duplicate: f64,
    /// Probability that later frames may overtake a frame (frames only).
    pub reorder: f64,
    /// Probability that a piece of bytes loses its end (bytes only).
    pub truncate: f64,
    /// When the link is cut, in seconds. None: never.
    pub disconnect_at_secs: Option<f64>,
    /// For how long it is cut, in seconds. None: without an end.
    pub disconnect_for_secs: Option<f64>,
    /// Seed of this link's random draws.
    pub seed: u64,
}

/// A plan that is not valid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FaultPlanError {
    /// A probability or a time is out of its range.
    #[error(transparent)]
    Setting(#[from] RangeError),
    /// A fault that this kind of link cannot have, or the length of a cut without its begin.
    #[error("{0}")]
    Unfit(String),
}

/// What happens to one frame, or to one piece of bytes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fate {
    pub(super) due: Duration,
    /// Of a frame only: bytes are lost one by one.
    pub(super) lost: bool,
    pub(super) duplicated: bool,
    /// How much later a frame comes that others may overtake.
    pub(super) held: Option<Duration>,
    /// The part of a piece of bytes that arrives, if it loses its end.
    pub(super) kept: Option<f64>,
}

/// A checked plan with its random generator.
#[derive(Clone, Debug)]
pub(super) struct Dice {
    plan: FaultPlan,
    delay: Duration,
    cut: Option<(Duration, Duration)>,
    random: Pcg64,
    last_due: Duration,
}

/// What travels on a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Link {
    Frames,
    Bytes,
}

impl Dice {
    pub(super) fn new(plan: &FaultPlan, link: Link) -> Result<Self, FaultPlanError> {
        for (name, value) in [
            ("loss", plan.loss),
            ("duplicate", plan.duplicate),
            ("reorder", plan.reorder),
            ("truncate", plan.truncate),
        ] {
            check_range(name, value, 0.0..=1.0)?;
        }
        let (impossible, link) = match link {
            Link::Frames => ([("truncate", plan.truncate), ("truncate", 0.0)], "frames"),
            Link::Bytes => ([("duplicate", plan.duplicate), ("reorder", plan.reorder)], "bytes"),
        };
        if let Some(&(name, value)) = impossible.iter().find(|(_, value)| *value > 0.0) {
            let text = format!("{name} = {value} cannot happen on a link of {link}; set it to 0");
            return Err(FaultPlanError::Unfit(text));
        }
        let delay = time("delay_secs", plan.delay_secs)?;
        time("jitter_secs", plan.jitter_secs)?;
        let cut = match (plan.disconnect_at_secs, plan.disconnect_for_secs) {
            (None, None) => None,
            (None, Some(_)) => {
                let text = "disconnect_for_secs without disconnect_at_secs; say when the link is cut, or leave both out";
                return Err(FaultPlanError::Unfit(text.to_string()));
            }
            (Some(at), length) => {
                let at = time("disconnect_at_secs", at)?;
                let length = length.map(|secs| time("disconnect_for_secs", secs)).transpose()?;
                Some((at, at.saturating_add(length.unwrap_or(Duration::MAX))))
            }
        };
        let random = Pcg64::seed_from_u64(plan.seed);
        Ok(Self { plan: plan.clone(), delay, cut, random, last_due: Duration::ZERO })
    }

    /// Whether the link holds at this time.
    pub(super) fn is_connected(&self, now: Duration) -> bool {
        self.cut.is_none_or(|(from, to)| !(from..to).contains(&now))
    }

    /// Whether something that set out and arrives at these times met the cut on its way.
    pub(super) fn is_cut(&self, pushed: Duration, due: Duration) -> bool {
        self.cut.is_some_and(|(from, to)| pushed < to && due >= from)
    }

    /// Decides whether one byte of a piece is lost.
    pub(super) fn loses_byte(&mut self) -> bool {
        self.random.random::<f64>() < self.plan.loss
    }

    /// Decides about one frame or one piece of bytes.
    pub(super) fn throw(&mut self, now: Duration) -> Fate {
        /// A frame is held back for at most this, about three rounds of the hand's bus.
        const HELD_SECS: f64 = 0.01;
        // All random numbers are drawn every time, so that switching one fault on does not change
        // the pattern of the others.
        let [jitter, loss, duplicate, reorder, held, truncate, kept] = self.random.random::<[f64; 7]>();
        let late = Duration::from_secs_f64(jitter * self.plan.jitter_secs);
        let due = now.saturating_add(self.delay).saturating_add(late).max(self.last_due);
        self.last_due = due;
        Fate {
            due,
            lost: loss < self.plan.loss,
            duplicated: duplicate < self.plan.duplicate,
            held: (reorder < self.plan.reorder).then(|| Duration::from_secs_f64(held * HELD_SECS)),
            kept: (truncate < self.plan.truncate).then_some(kept),
        }
    }
}

fn time(name: &str, secs: f64) -> Result<Duration, RangeError> {
    check_range(name, secs, 0.0..=DAY_SECS)?;
    Ok(Duration::from_secs_f64(secs))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_a_perfect_link_and_unknown_keys_are_refused() {
        assert_eq!(toml::from_str::<FaultPlan>("").unwrap(), FaultPlan::default());
        assert!(toml::from_str::<FaultPlan>("lost = 0.1").is_err());
    }

    #[test]
    fn nonsense_is_refused() {
        for (text, link, word) in [
            ("loss = 1.1", Link::Frames, "loss"),
            ("loss = nan", Link::Frames, "loss"),
            ("duplicate = -0.1", Link::Frames, "duplicate"),
            ("truncate = 0.5", Link::Frames, "truncate"),
            ("reorder = 0.5", Link::Bytes, "reorder"),
            ("duplicate = 0.5", Link::Bytes, "duplicate"),
            ("delay_secs = -1", Link::Bytes, "delay_secs"),
            ("jitter_secs = inf", Link::Bytes, "jitter_secs"),
            ("disconnect_at_secs = 1e9", Link::Bytes, "disconnect_at_secs"),
            ("disconnect_for_secs = 1", Link::Bytes, "disconnect_at_secs"),
        ] {
            let error = Dice::new(&toml::from_str(text).unwrap(), link).unwrap_err();
            assert!(error.to_string().contains(word), "{error}");
        }
    }

    #[test]
    fn one_fault_more_leaves_the_pattern_of_the_others() {
        let losses = |plan: FaultPlan| {
            let mut dice = Dice::new(&plan, Link::Frames).unwrap();
            (0..200).map(|_| dice.throw(Duration::ZERO).lost).collect::<Vec<_>>()
        };
        let plan = FaultPlan { loss: 0.3, seed: 5, ..FaultPlan::default() };
        let more = FaultPlan { jitter_secs: 0.1, duplicate: 0.5, reorder: 0.5, ..plan.clone() };
        assert_eq!(losses(plan.clone()), losses(more));
        assert_ne!(losses(plan.clone()), losses(FaultPlan { seed: 6, ..plan }));
    }
}
