//! What the fitted simulator cannot express: each joint's error, divided by what it correlates
//! with.

use etude_stage::{DRIVEN_JOINTS, JOINT_NAMES, RAIL};

use super::document::{list, paragraph, table};
use super::error_decomposition::{ErrorDecomposition, decompose, samples};
use super::number::{milli, milli_unit, number, percent};
use crate::assessment::Replayed;

/// A part dominates the error from this share on.
const DOMINANT: f64 = 0.4;

/// What an error can correlate with.
struct Cause {
    name: &'static str,
    /// Verb and object for a sentence about its share.
    phrase: &'static str,
    /// What it means where it dominates.
    meaning: &'static str,
}

/// In the order of [`RemainingError::shares`].
const CAUSES: [Cause; 6] = [
    Cause {
        name: "offset",
        phrase: "is a constant offset",
        meaning: "the simulated joint is at a constant distance from the measured one: an encoder's zero, or a load that \
                  the fitted motions do not show. Row: load. Motions that touch keys identify encoder_bias.",
    },
    Cause {
        name: "direction",
        phrase: "depends on the direction of motion (backlash, dry friction)",
        meaning: "the robot stops short of the simulator from both sides (beyond it, where the size is negative): backlash \
                  between drive and joint, of which the size is half and which the simulator does not have, or another kind \
                  of dry friction.",
    },
    Cause {
        name: "velocity",
        phrase: "depends on velocity (timing)",
        meaning: "an error of timing: the robot is late by this time (early, where it is negative). Rows: delay, low_pass; \
                  of a finger viscosity, of the rail damping.",
    },
    Cause {
        name: "acceleration",
        phrase: "depends on acceleration (inertia, lag)",
        meaning: "an error of inertia, or a second lag. Rows: armature, low_pass, jerk_limit. Coupling of joints through the \
                  hand looks the same.",
    },
    Cause {
        name: "rest",
        phrase: "depends on none of direction, velocity and acceleration",
        meaning: "friction that changes with position or load, backlash under a load, which no row of the simulator \
                  expresses; or how the joint responds to a single target (rows, in part: jerk_limit, \
                  low_pass, delay).",
    },
    Cause {
        name: "noise",
        phrase: "is the noise of the readings",
        meaning: "the simulator is as good as the readings.",
    },
];

/// One joint.
pub(super) struct RemainingError {
    joint: usize,
    found: ErrorDecomposition,
}

/// The joints that move, in simulations that did not diverge.
pub(super) fn parts(replayed: &[Replayed<'_>]) -> Vec<RemainingError> {
    let of = |joint: usize| {
        let moving = replayed.iter().filter(|replayed| replayed.motion.moves[joint]);
        let (mut all, mut noise, mut motions) = (Vec::new(), 0.0, 0.0);
        for Replayed { motion, traces } in moving {
            all.extend(samples(motion, traces[1].as_ref()?, joint));
            noise += motion.noise[joint] * motion.noise[joint];
            motions += 1.0;
        }
        let found = decompose(&all, f64::sqrt(noise / f64::max(motions, 1.0)))?;
        Some(RemainingError { joint, found })
    };
    (0..DRIVEN_JOINTS).filter_map(of).collect()
}

impl RemainingError {
    /// In the order of [`CAUSES`].
    fn shares(&self) -> [f64; CAUSES.len()] {
        let found = &self.found;
        let [direction, velocity, acceleration] = found.shares;
        [found.offset, direction, velocity, acceleration, found.rest, found.noise]
    }

    /// The largest part, if it dominates.
    fn dominant(&self) -> Option<usize> {
        largest(&self.shares()).filter(|(_, share)| *share >= DOMINANT).map(|(part, _)| part)
    }

    /// The dominant part with its size.
    fn mostly(&self) -> String {
        let Some(part) = self.dominant() else { return "several".to_string() };
        let unit = milli_unit(self.joint);
        let [direction, velocity, acceleration] = self.found.slopes;
        let name = CAUSES[part].name;
        match part {
            0 => format!("{name}, {} {unit}", milli(self.found.mean_error)),
            1 => format!("{name}, {} {unit}", milli(direction)),
            2 => format!("{name}, {} ms", number(1e3 * velocity)),
            3 => format!("{name}, {} ms²", number(1e6 * acceleration)),
            _ => name.to_string(),
        }
    }
}

fn largest(shares: &[f64]) -> Option<(usize, f64)> {
    shares.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Shares of the mean square error of all finger joints together; `None` without any error.
fn pooled_shares(parts: &[RemainingError]) -> Option<[f64; CAUSES.len()]> {
    let fingers = || parts.iter().filter(|part| part.joint != RAIL);
    let square = |part: &RemainingError| part.found.rms.powi(2);
    let whole: f64 = fingers().map(square).sum();
    let of_cause =
        |cause: usize| fingers().map(|part| square(part) * part.shares()[cause]).sum::<f64>() / whole;
    (whole > 0.0).then(|| std::array::from_fn(of_cause))
}

/// The largest part of the remaining error, in a sentence.
pub(super) fn in_short(parts: &[RemainingError]) -> Option<String> {
    let (cause, share) = largest(&pooled_shares(parts)?)?;
    let (share, phrase) = (percent(share), CAUSES[cause].phrase);
    Some(format!(
        "The largest part of the remaining error, {share} of the fingers' mean square error, {phrase}."
    ))
}

/// The table, and what its dominant parts mean.
pub(super) fn elements(parts: &[RemainingError], held_out: bool) -> Vec<String> {
    if parts.is_empty() {
        let why = "There is no error to analyse: the identified simulation diverged in these recordings, or no joint moves.";
        return vec![paragraph(why)];
    }
    let which =
        if held_out { "held-out recordings" } else { "recordings that were fitted (none was held out)" };
    let line = |joint: &str, error: String, shares: &[f64], mostly: String| {
        let shares = shares.iter().copied().map(percent);
        [joint.to_string(), error].into_iter().chain(shares).chain([mostly]).collect::<Vec<String>>()
    };
    let row = |part: &RemainingError| {
        let error = format!("{} {}", milli(part.found.rms), milli_unit(part.joint));
        line(JOINT_NAMES[part.joint], error, &part.shares(), part.mostly())
    };
    let pooled = pooled_shares(parts).map(|shares| line("fingers", String::new(), &shares, String::new()));
    let meaning = |(index, cause): (usize, &Cause)| {
        let dominated = parts.iter().filter(|part| part.dominant() == Some(index));
        let joints: Vec<&str> = dominated.map(|part| JOINT_NAMES[part.joint]).collect();
        (!joints.is_empty()).then(|| format!("{} ({}): {}", cause.name, joints.join(", "), cause.meaning))
    };
    let names = CAUSES.iter().map(|cause| cause.name);
    let columns: Vec<&str> = ["joint", "error"].into_iter().chain(names).chain(["mostly"]).collect();
    vec![
        paragraph(&format!(
            "Parts of the mean square error after the fit in the {which}, from a regression of simulated minus measured \
             positions on direction of motion (the last direction, where the joint stands), velocity and acceleration of the \
             simulated joint. A part of {} or more is named with its size.",
            percent(DOMINANT)
        )),
        table("Shares of the mean square error after the fit", &columns, parts.iter().map(row).chain(pooled)),
        list(&CAUSES.iter().enumerate().filter_map(meaning).collect::<Vec<_>>()),
    ]
}
