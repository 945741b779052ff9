//! What the fitted simulator cannot express, in words and numbers: each joint's error by what it goes with.

use etude_stage::{JOINT_NAMES, JOINTS, RAIL};

use super::document::{Element, Table, numbers, words};
use super::number::{milli, milli_unit, number, percent};
use super::overlay::Replayed;
use super::unexplained::{Unexplained, samples, unexplained};

/// A part is what the error mostly is from this share on.
const DOMINANT: f64 = 0.4;

/// What an error can go with.
struct Cause {
    name: &'static str,
    /// It, in a sentence about the share that it has.
    phrase: &'static str,
    /// What it means where it dominates.
    meaning: &'static str,
}

/// In the order of [`Part::shares`].
const CAUSES: [Cause; 7] = [
    Cause {
        name: "offset",
        phrase: "is a standing offset",
        meaning: "the simulated joint stands beside the measured one: an encoder's zero, or a load that does \
                  not change, such as what the hand's own compensation leaves of gravity. Touching keys \
                  tells encoder_bias.",
    },
    Cause {
        name: "direction",
        phrase: "goes with the direction of motion (play, dry friction)",
        meaning: "the robot stays short of the simulator on whichever side it comes from (beyond it, where \
                  the size is negative): play between drive and joint, of which the size is half, or dry \
                  friction of another kind. The simulator has dry friction that is the same at rest and in \
                  motion, and no play at all.",
    },
    Cause {
        name: "velocity",
        phrase: "goes with velocity (timing)",
        meaning: "an error of timing: the robot is late by the time given (early, where it is negative). Rows: \
                  delay, low_pass, damping.",
    },
    Cause {
        name: "acceleration",
        phrase: "goes with acceleration (inertia, lag)",
        meaning: "an error of inertia, or of a second lag; rows: armature, low_pass, jerk_limit. Joints that \
                  pull at each other through the hand look the same.",
    },
    Cause {
        name: "slow rest",
        phrase: "goes with none of direction, velocity and acceleration, and is slow",
        meaning: "something that outlasts a control step and goes with neither direction, velocity nor \
                  acceleration: sticking at rest, friction that changes with place or load, play that is \
                  taken up by a load. No row of the simulator stands for it.",
    },
    Cause {
        name: "fast rest",
        phrase: "comes and goes within a control step of 50 ms (the answer to single targets, play after a \
                 turn)",
        meaning: "what happens within a control step: how the joint answers each single target (shape of its \
                  rise, ringing, timing finer than a physics step), play being taken up after a turn, \
                  vibration. Rows: jerk_limit, low_pass, delay, as far as they go.",
    },
    Cause { name: "noise", phrase: "is the noise of the readings", meaning: "as good as readings can tell." },
];

/// One joint.
pub(super) struct Part {
    joint: usize,
    found: Unexplained,
}

/// The joints that move, in worlds that did not diverge.
pub(super) fn parts(telling: &[&Replayed<'_>]) -> Vec<Part> {
    let of = |joint: usize| {
        let moving = telling.iter().filter(|replayed| replayed.motion.moves.get(joint) == Some(&true));
        let (mut all, mut noise, mut motions) = (Vec::new(), 0.0, 0.0);
        for Replayed { motion, traces } in moving {
            all.extend(samples(motion, traces[1].as_ref()?, joint));
            noise += motion.noise[joint] * motion.noise[joint];
            motions += 1.0;
        }
        let found = unexplained(&all, f64::sqrt(noise / f64::max(motions, 1.0)))?;
        Some(Part { joint, found })
    };
    (0..JOINTS).filter_map(of).collect()
}

impl Part {
    /// In the order of [`CAUSES`].
    fn shares(&self) -> [f64; CAUSES.len()] {
        let found = &self.found;
        let [direction, velocity, acceleration] = found.shares;
        [found.offset, direction, velocity, acceleration, found.slow, found.fast, found.noise]
    }

    /// The largest part, if it dominates.
    fn dominant(&self) -> Option<usize> {
        largest(&self.shares()).filter(|(_, share)| *share >= DOMINANT).map(|(part, _)| part)
    }

    /// What the error mostly is, with its size.
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

/// Shares of the finger joints' mean square error, all together.
fn pooled(parts: &[Part]) -> Option<[f64; CAUSES.len()]> {
    let fingers = || parts.iter().filter(|part| part.joint != RAIL);
    let whole: f64 = fingers().map(|part| part.found.rms.powi(2)).sum();
    let of = |index: usize| {
        fingers().map(|part| part.found.rms.powi(2) * part.shares()[index]).sum::<f64>() / whole
    };
    (whole > 0.0).then(|| std::array::from_fn(of))
}

/// The largest part of what is left, in a sentence.
pub(super) fn in_short(parts: &[Part]) -> Option<String> {
    let (cause, share) = largest(&pooled(parts)?)?;
    let phrase = CAUSES[cause].phrase;
    Some(format!(
        "The largest part of what is left, {} of the fingers' mean square error, {phrase}.",
        percent(share)
    ))
}

/// How much of the fingers' error falls just after a joint has turned round, in a sentence.
fn turning(parts: &[Part]) -> Option<String> {
    let fingers = || parts.iter().filter(|part| part.joint != RAIL);
    let whole: f64 = fingers().map(|part| part.found.rms.powi(2)).sum();
    let share = fingers().map(|part| part.found.rms.powi(2) * part.found.turning[0]).sum::<f64>() / whole;
    let time = fingers().map(|part| part.found.turning[1]).sum::<f64>() / fingers().count() as f64;
    (whole > 0.0).then(|| {
        format!(
            "Of the fingers' mean square error {} falls within 50 ms after a joint has turned round, which \
             is {} of the time. Much more than its share of the time speaks of play, or of friction that is \
             larger at rest.",
            percent(share),
            percent(time)
        )
    })
}

/// The table, and what its dominant parts mean.
pub(super) fn elements(parts: &[Part], held_out: bool) -> Vec<Element> {
    if parts.is_empty() {
        let why = "There is nothing to take apart: the identified world diverged in these recordings, or no \
                   joint moves.";
        return vec![Element::Paragraph(why.to_string())];
    }
    let which =
        if held_out { "held-out recordings" } else { "recordings that were fitted (none was held out)" };
    let row = |part: &Part| {
        let mut cells = vec![
            JOINT_NAMES[part.joint].to_string(),
            format!("{} {}", milli(part.found.rms), milli_unit(part.joint)),
        ];
        cells.extend(part.shares().map(percent));
        cells.push(part.mostly());
        cells
    };
    let mut rows: Vec<Vec<String>> = parts.iter().map(row).collect();
    if let Some(shares) = pooled(parts) {
        let mut cells = vec!["fingers".to_string(), String::new()];
        cells.extend(shares.map(percent));
        cells.push(String::new());
        rows.push(cells);
    }
    let meaning = |(index, cause): (usize, &Cause)| {
        let joints: Vec<&str> = (parts.iter())
            .filter(|part| part.dominant() == Some(index))
            .map(|part| JOINT_NAMES[part.joint])
            .collect();
        (!joints.is_empty()).then(|| format!("{} ({}): {}", cause.name, joints.join(", "), cause.meaning))
    };
    let mut elements = vec![
        Element::Paragraph(format!(
            "Where the mean square error after the fit goes in the {which}: a regression of simulated less \
             measured on direction of motion (of the last motion, where the joint stands), velocity and \
             acceleration of the simulated joint; the rest is slow as far as it shows in a moving mean over \
             50 ms. What a joint's error is mostly, from {} on, is named with its size.",
            percent(DOMINANT)
        )),
        Element::Table(Table {
            caption: "Shares of the mean square error after the fit".to_string(),
            columns: vec![
                words("joint"),
                numbers("error"),
                numbers("offset"),
                numbers("direction"),
                numbers("velocity"),
                numbers("acceleration"),
                numbers("slow rest"),
                numbers("fast rest"),
                numbers("noise"),
                words("mostly"),
            ],
            rows,
        }),
        Element::List(CAUSES.iter().enumerate().filter_map(meaning).collect()),
    ];
    elements.extend(turning(parts).map(Element::Paragraph));
    elements
}
