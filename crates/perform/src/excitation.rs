//! Motions that show what a robot's joints do: the sequences that a simulator is fitted to (paper,
//! "Sim2Real2Sim").
//!
//! All of them but [`Keys`](Excitation::Keys) stay clear of the keys. A sequence has one joint
//! target a control step; the robot's rig shapes them as it shapes a policy's targets.

use std::f64::consts::TAU;

use etude_music::{CONTROL_HZ, KEY_COUNT, key_is_black};
use etude_stage::geometry::{BLACK, WHITE, WHITE_PITCH, key_lateral};
use etude_stage::hand::{FINGERS, JOINTS_PER_FINGER, TIP_RADIUS};
use etude_stage::{DRIVEN_JOINTS, RAIL, Side, kinematics};
use etude_task::{ACTION_LEN, Piece, Player, TargetRange};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

#[cfg(test)]
mod tests;

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
    #[serde(rename = "held-out")]
    Held,
}

/// Fingers almost straight: every sequence begins and ends here.
const REST: [f64; JOINTS_PER_FINGER] = [0.0, 0.05, 0.15, 0.15];
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
/// Greatest acceleration that a swing of the rail asks for, m/s².
const RAIL_SWING: f64 = 5.0;
/// Farthest that the rail swings, m.
const RAIL_REACH: f64 = 0.12;
/// Heights of a fingertip over the top of a white key between which a slow press moves the target,
/// m. It ends below the key's travel of 10 mm, since a finger yields.
const PRESS_M: [f64; 2] = [0.006, -0.012];
/// Height of a fingertip over a white key that is clear of black keys, m.
const CLEAR_M: f64 = BLACK.top() - WHITE.top() + 0.012;
/// Time in which a finger comes there from its rest, s.
const COME_SECS: f64 = 0.4;
/// Where white keys are pressed, m toward the player from their middle.
const PRESS_X_M: f64 = 0.028;
/// Time in which a finger presses a key, and in which it lets it rise, s.
const PRESS_SECS: f64 = 1.5;
/// Places beside the gap to the next lower white key that are pressed, from the one most to the
/// left to the one most to the right, m, and how far apart they are; beside the gap to the next
/// higher key those between. The farthest is for a keyboard and an encoder that are some
/// millimetres off.
const BESIDE_M: f64 = 0.007;
const BESIDE_EVERY_M: f64 = 0.002;
/// Where along the keys that is, m toward the player from their middle: clear of the black keys,
/// beside which the finger moves.
const BESIDE_X_M: f64 = 0.033;
/// Times in which a finger goes to such a place, waits there, presses, holds the key down, and
/// rises, s.
const BESIDE_SECS: [f64; 5] = [0.15, 0.2, 0.35, 0.2, 0.3];
/// Where the middle of a fingertip begins to push against the front of a black key, and where its
/// target ends, m; and its height over the tops of the white keys meanwhile, m. It meets the key
/// after half of the way: the rest is for a keyboard that is some millimetres off.
const PUSH_X_M: [f64; 2] = [0.034, 0.015];
const PUSH_M: f64 = 0.001;
/// Times in which it comes down before the key, pushes, rests there, and comes back, s.
const PUSH_SECS: [f64; 4] = [0.3, 0.8, 0.4, 0.4];
/// White keys between the places of the hand.
const KEYS_APART: f64 = 4.0;
/// Time in which a sequence grows from rest and dies away, s.
const FADE_SECS: f64 = 1.0;

impl Excitation {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::OpenClose, Self::Chirp, Self::Rail, Self::Keys, Self::Held];

    /// Its name on the command line and in recordings.
    pub fn name(self) -> &'static str {
        match self {
            Self::OpenClose => "open-close",
            Self::Chirp => "chirp",
            Self::Rail => "rail",
            Self::Keys => "keys",
            Self::Held => "held-out",
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
            Self::Held => held_out(),
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
        Self::ALL.into_iter().find(|excitation| excitation.name() == text).ok_or_else(|| {
            format!("no excitation is called `{text}`; there are: {}", Self::ALL.map(Self::name).join(", "))
        })
    }
}

fn pose(fingers: &[[f64; JOINTS_PER_FINGER]; FINGERS], rail: f64) -> [f64; DRIVEN_JOINTS] {
    std::array::from_fn(|joint| match joint {
        RAIL => rail,
        _ => fingers[joint / JOINTS_PER_FINGER][joint % JOINTS_PER_FINGER],
    })
}

fn steps(secs: f64) -> usize {
    (secs * CONTROL_HZ).round() as usize
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

fn blend(
    from: &[f64; JOINTS_PER_FINGER],
    to: &[f64; JOINTS_PER_FINGER],
    share: f64,
) -> [f64; JOINTS_PER_FINGER] {
    std::array::from_fn(|joint| from[joint] + share * (to[joint] - from[joint]))
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
            hold([blend(&OPEN, &CLOSED, share); FINGERS], 1.0 / CONTROL_HZ);
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
        let reach = (RAIL_SWING / (omega * omega)).min(RAIL_REACH);
        pose(&fingers, fade(step, count) * reach * sweep(at, RAIL_SWEEP_HZ, SECS).sin())
    }));
    targets.extend(std::iter::repeat_n(pose(&fingers, 0.0), steps(0.5)));
    targets
}

/// Presses one white key after the other, three with each finger, and beside the gaps of the first;
/// and pushes against a black key beside each.
fn keys(side: Side) -> Vec<[f64; DRIVEN_JOINTS]> {
    let mut targets = vec![pose(&[REST; FINGERS], 0.0); steps(0.5)];
    let mut hold = |finger: usize, angles: [f64; JOINTS_PER_FINGER], rail: f64, secs: f64| {
        let mut fingers = [REST; FINGERS];
        fingers[finger] = angles;
        targets.extend(std::iter::repeat_n(pose(&fingers, rail), steps(secs)));
    };
    for keys in [0.0, KEYS_APART, -KEYS_APART] {
        let rail = keys * WHITE_PITCH;
        hold(0, REST, rail, 1.0);
        for finger in 0..FINGERS {
            let [_, y, _] = kinematics::fingertip(side, finger, &REST, rail);
            // Middle C is in the middle of the keyboard, and the white keys are equally wide.
            let over = (y / WHITE_PITCH).round() * WHITE_PITCH;
            let place = |x: f64, aside: f64, above: f64| {
                let place = [x, over + aside, WHITE.top() + TIP_RADIUS + above];
                kinematics::reach(side, finger, place, rail).unwrap_or(REST)
            };
            let at = |above: f64| place(PRESS_X_M, 0.0, above);
            // Straight down and up, so that the finger does not touch a black key.
            let clear = at(CLEAR_M);
            let come = (0..=steps(COME_SECS)).map(|step| step as f64 / steps(COME_SECS) as f64);
            for share in come.clone() {
                hold(finger, blend(&REST, &clear, share), rail, 1.0 / CONTROL_HZ);
            }
            hold(finger, at(PRESS_M[0]), rail, 0.3);
            let count = steps(PRESS_SECS);
            let press = (0..=count).map(|step| step as f64 / count as f64);
            for share in press.clone().chain(press.rev()) {
                let [begin, end] = PRESS_M;
                hold(finger, at(begin + share * (end - begin)), rail, 1.0 / CONTROL_HZ);
            }
            // Straight from one place to the next: along the key, aside, above.
            let mut last = [PRESS_X_M, 0.0, PRESS_M[0]];
            let mut go = |to: [f64; 3], secs: f64| {
                for step in 1..=steps(secs) {
                    let share = step as f64 / steps(secs) as f64;
                    let [x, aside, above] =
                        std::array::from_fn(|way| last[way] + share * (to[way] - last[way]));
                    hold(finger, place(x, aside, above), rail, 1.0 / CONTROL_HZ);
                }
                last = to;
            };
            // The key rises.
            go([PRESS_X_M, 0.0, PRESS_M[0]], 0.5);
            let gaps = if keys == 0.0 { beside_gaps() } else { Vec::new() };
            for aside in gaps {
                let [come, wait, down, held, up] = BESIDE_SECS;
                let [above, below] = PRESS_M.map(|above| [BESIDE_X_M, aside, above]);
                for (to, secs) in [(above, come), (above, wait), (below, down), (below, held), (above, up)] {
                    go(to, secs);
                }
            }
            if let Some(black) = black_beside(over) {
                let [down, push, held, back] = PUSH_SECS;
                let [before, behind] = PUSH_X_M.map(|x| [x, black - over, PUSH_M]);
                let above = [PUSH_X_M[0], black - over, PRESS_M[0]];
                for (to, secs) in [
                    (above, down),
                    (before, down),
                    (behind, push),
                    (behind, held),
                    (before, back),
                    (above, down),
                ] {
                    go(to, secs);
                }
            }
            go([PRESS_X_M, 0.0, CLEAR_M], COME_SECS);
            hold(finger, clear, rail, 0.3);
            for share in come.rev() {
                hold(finger, blend(&REST, &clear, share), rail, 1.0 / CONTROL_HZ);
            }
        }
    }
    hold(0, REST, 0.0, 1.0);
    targets
}

/// Where the black key is that is next to the white key at `over`, m: the higher one of two. Every
/// white key has one.
fn black_beside(over: f64) -> Option<f64> {
    let mut blacks = (0..KEY_COUNT).rev().filter(|key| key_is_black(*key)).map(key_lateral);
    blacks.find(|y| (y - over).abs() < WHITE_PITCH)
}

/// Places beside the gaps to both neighbours of a white key, m from its middle.
fn beside_gaps() -> Vec<f64> {
    let half = WHITE_PITCH / 2.0;
    let count = (2.0 * BESIDE_M / BESIDE_EVERY_M).round() as usize;
    let place = |step: f64| step * BESIDE_EVERY_M - BESIDE_M;
    let lower = (0..=count).map(|step| place(step as f64) - half);
    lower.chain((0..count).map(|step| place(step as f64 + 0.5) + half)).collect()
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
            let rest = Excitation::Held.start();
            std::array::from_fn(|joint| rest[joint] + fade(step, count) * offset[joint])
        })
        .collect()
}
