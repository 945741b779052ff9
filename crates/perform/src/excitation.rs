//! Motions that show what a robot's joints do: the sequences that a simulator is fitted to (paper,
//! "Sim2Real2Sim").
//!
//! All of them but [`Keys`](Excitation::Keys) stay clear of the keys. A sequence has one joint
//! target a control step; the robot's rig shapes them as it shapes a policy's targets.

use std::f64::consts::TAU;

use etude_music::CONTROL_HZ;
use etude_stage::geometry::WHITE_PITCH;
use etude_stage::hand::{FINGERS, JOINTS_PER_FINGER};
use etude_stage::{DRIVEN_JOINTS, RAIL, Side};
use etude_task::{ACTION_LEN, Piece, Player, TargetRange};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::mode::by_name;

mod key_presses;
mod pose;
#[cfg(test)]
mod tests;

use key_presses::keys;
use pose::{REST, STEP_SECS, blend, pose, steps};

/// A sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Excitation {
    /// Hands open and close, slowly and fast: the paper's initial sequence.
    OpenClose,
    /// Every finger joint swings with rising frequency; the sweeps differ from joint to joint.
    Chirp,
    /// The hand moves along the rail: steps of one key to an octave, then swings with rising
    /// frequency.
    Rail,
    /// One finger after the other presses white keys, slowly and to the bottom, and lets them rise
    /// as slowly: a key is then where the encoders say when it begins to sound and when it is
    /// silent again. It presses beside the gaps to both neighbours, where one key gives way to the
    /// other, and pushes against the front of a black key.
    Keys,
    /// All joints and the rail at the same time: sums of sines with random phases, and random steps
    /// in between. It differs from the other sequences, so that a fit can be tested on it.
    HeldOut,
}

/// The hand closed as far as the keys below allow.
const CLOSED: [f64; JOINTS_PER_FINGER] = [0.0, -0.05, 0.6, 0.75];
/// The hand open.
const OPEN: [f64; JOINTS_PER_FINGER] = [0.0, -0.1, -0.05, -0.1];
/// How far each joint of a finger swings about [`REST`], rad.
const SWING: [f64; JOINTS_PER_FINGER] = [0.3, 0.13, 0.19, 0.27];
/// Lowest and highest frequency of a sweep of the fingers, Hz. Targets at 20 Hz still describe a
/// swing of the highest.
const SWEEP_HZ: [f64; 2] = [0.2, 5.0];
/// The same of the rail, whose reach falls with the square of the frequency.
const RAIL_SWEEP_HZ: [f64; 2] = [0.2, 2.5];
/// Largest acceleration of a swing of the rail, m/s².
const MAX_RAIL_ACCELERATION: f64 = 5.0;
/// Largest swing of the rail, m.
const MAX_RAIL_SWING_M: f64 = 0.12;
/// Time in which a sequence grows from rest and dies away, s.
const FADE_SECS: f64 = 1.0;

impl Excitation {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::OpenClose, Self::Chirp, Self::Rail, Self::Keys, Self::HeldOut];

    /// Its name on the command line and in recordings.
    pub fn name(self) -> &'static str {
        match self {
            Self::OpenClose => "open-close",
            Self::Chirp => "chirp",
            Self::Rail => "rail",
            Self::Keys => "keys",
            Self::HeldOut => "held-out",
        }
    }

    /// Where it begins: rad, the rail in m.
    pub fn start(self) -> [f64; DRIVEN_JOINTS] {
        pose(&[REST; FINGERS], 0.0)
    }

    /// The targets of its control steps, for a hand of this side.
    pub fn targets(self, side: Side) -> Vec<[f64; DRIVEN_JOINTS]> {
        match self {
            Self::OpenClose => open_close(),
            Self::Chirp => chirp(),
            Self::Rail => rail(),
            Self::Keys => keys(side),
            Self::HeldOut => held_out(),
        }
    }
}

/// The player of a sequence. It ignores the observation.
pub struct ExcitationPlayer {
    targets: Vec<[f64; DRIVEN_JOINTS]>,
    range: TargetRange,
}

impl ExcitationPlayer {
    /// A player of `excitation` with a hand of this side, and the silent piece that is as long.
    pub fn new(excitation: Excitation, side: Side) -> (Self, Piece) {
        let targets = excitation.targets(side);
        let piece = Piece::silent(targets.len());
        (Self { targets, range: TargetRange::new(&piece) }, piece)
    }
}

impl Player for ExcitationPlayer {
    fn act(&mut self, step: usize, _: &[f32], action: &mut [f32; ACTION_LEN]) {
        *action = self.range.action(&self.targets[step], step);
    }
}

impl std::fmt::Display for Excitation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for Excitation {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        by_name("excitation", &Self::ALL, Self::name, text)
    }
}

/// From 0 at both ends of `count` control steps to 1 in between.
fn fade(step: usize, count: usize) -> f64 {
    let inside = step.min(count - 1 - step) as f64 / CONTROL_HZ;
    let share = (inside / FADE_SECS).min(1.0);
    share * share * (3.0 - 2.0 * share)
}

/// Phase of a sweep that rises exponentially from `low` to `high` in `secs`, rad.
fn sweep(at_secs: f64, [low, high]: [f64; 2], secs: f64) -> f64 {
    let rate = (high / low).ln() / secs;
    TAU * low * ((rate * at_secs).exp() - 1.0) / rate
}

/// Frequency of the same, Hz.
fn sweep_hz(at_secs: f64, [low, high]: [f64; 2], secs: f64) -> f64 {
    low * ((high / low).ln() * at_secs / secs).exp()
}

/// Opens and closes in turns: in one step and held, then by ramps, then finger by finger. The first
/// joints of the fingers swing at the same time.
fn open_close() -> Vec<[f64; DRIVEN_JOINTS]> {
    let mut targets = Vec::new();
    let mut hold = |fingers: [[f64; JOINTS_PER_FINGER]; FINGERS], secs: f64| {
        targets.extend(std::iter::repeat_n(pose(&fingers, 0.0), steps(secs)));
    };
    let rolled = |angles: [f64; JOINTS_PER_FINGER], roll: f64| [roll, angles[1], angles[2], angles[3]];
    hold([REST; FINGERS], 0.5);
    for (turn, secs) in [0.8, 0.6, 0.4, 0.3, 0.2, 0.2].into_iter().enumerate() {
        let roll = if turn % 2 == 0 { 0.25 } else { -0.25 };
        hold([rolled(CLOSED, roll); FINGERS], secs);
        hold([rolled(OPEN, -roll); FINGERS], secs);
    }
    for secs in [2.0, 1.0] {
        let count = steps(secs);
        for step in 0..2 * count {
            let share = 1.0 - (step as f64 / count as f64 - 1.0).abs();
            hold([blend(&OPEN, &CLOSED, share); FINGERS], STEP_SECS);
        }
    }
    for finger in 0..FINGERS {
        let mut fingers = [REST; FINGERS];
        for angles in [CLOSED, OPEN, rolled(REST, 0.3), rolled(REST, -0.3)] {
            fingers[finger] = angles;
            hold(fingers, 0.4);
        }
    }
    hold([REST; FINGERS], 1.0);
    targets
}

/// Every finger joint sweeps. Neighbours differ in highest frequency and direction, so that no two
/// move alike.
fn chirp() -> Vec<[f64; DRIVEN_JOINTS]> {
    const SECS: f64 = 24.0;
    let count = steps(SECS);
    (0..count)
        .map(|step| {
            let at = step as f64 / CONTROL_HZ;
            let fingers = std::array::from_fn(|finger| {
                std::array::from_fn(|joint| {
                    let high = SWEEP_HZ[1] * (1.0 - 0.12 * ((finger + joint) % 4) as f64);
                    let phase = sweep(at, [SWEEP_HZ[0], high], SECS);
                    let sign = if (finger + joint) % 2 == 0 { 1.0 } else { -1.0 };
                    REST[joint] + fade(step, count) * sign * SWING[joint] * phase.sin()
                })
            });
            pose(&fingers, 0.0)
        })
        .collect()
}

/// Steps of one, three, five and eight white keys, then a sweep.
fn rail() -> Vec<[f64; DRIVEN_JOINTS]> {
    const SECS: f64 = 16.0;
    let fingers = [REST; FINGERS];
    let mut targets = vec![pose(&fingers, 0.0); steps(0.5)];
    for (keys, secs) in [(1.0, 0.5), (3.0, 0.7), (5.0, 0.9), (2.0, 0.4)] {
        for place in [keys, 0.0, -keys, 0.0] {
            targets.extend(std::iter::repeat_n(pose(&fingers, place * WHITE_PITCH), steps(secs)));
        }
    }
    let count = steps(SECS);
    targets.extend((0..count).map(|step| {
        let at = step as f64 / CONTROL_HZ;
        let omega = TAU * sweep_hz(at, RAIL_SWEEP_HZ, SECS);
        let reach = (MAX_RAIL_ACCELERATION / (omega * omega)).min(MAX_RAIL_SWING_M);
        pose(&fingers, fade(step, count) * reach * sweep(at, RAIL_SWEEP_HZ, SECS).sin())
    }));
    targets.extend(std::iter::repeat_n(pose(&fingers, 0.0), steps(0.5)));
    targets
}

/// Sums of sines at four frequencies, and every two seconds a step of all joints that is held for
/// half a second.
fn held_out() -> Vec<[f64; DRIVEN_JOINTS]> {
    const SECS: f64 = 16.0;
    const HZ: [f64; 4] = [0.37, 0.83, 1.71, 3.1];
    const STEP_EVERY_SECS: f64 = 2.0;
    const HELD_SECS: f64 = 0.5;
    let mut random = Pcg64::seed_from_u64(20_250_319);
    let phases: [[f64; HZ.len()]; DRIVEN_JOINTS] =
        std::array::from_fn(|_| std::array::from_fn(|_| TAU * random.random::<f64>()));
    let count = steps(SECS);
    let (every, held) = (steps(STEP_EVERY_SECS), steps(HELD_SECS));
    let swing = |step: usize| -> [f64; DRIVEN_JOINTS] {
        let at = step as f64 / CONTROL_HZ;
        std::array::from_fn(|joint| {
            let sum = |powers: f64| -> f64 {
                let wave = |(hz, phase): (&f64, &f64)| (TAU * hz * at + phase).sin() / hz.powf(powers);
                HZ.iter().zip(&phases[joint]).map(wave).sum::<f64>()
            };
            match joint {
                RAIL => 0.018 * sum(1.0),
                _ => SWING[joint % JOINTS_PER_FINGER] * sum(0.0) / 3.0,
            }
        })
    };
    let mut jumped = [0.0; DRIVEN_JOINTS];
    (0..count)
        .map(|step| {
            if step % every == 0 {
                jumped = std::array::from_fn(|joint| {
                    let share = random.random_range(-0.9..=0.9);
                    if joint == RAIL { 0.06 * share } else { SWING[joint % JOINTS_PER_FINGER] * share }
                });
            }
            let offset = if step % every < held { jumped } else { swing(step) };
            let rest = Excitation::HeldOut.start();
            std::array::from_fn(|joint| rest[joint] + fade(step, count) * offset[joint])
        })
        .collect()
}
