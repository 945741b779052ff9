//! Slow presses of the keys, one after the other.

use etude_music::{KEY_COUNT, key_is_black};
use etude_stage::geometry::{BLACK, WHITE, WHITE_PITCH, key_lateral};
use etude_stage::hand::{FINGERS, JOINTS_PER_FINGER, TIP_RADIUS};
use etude_stage::{DRIVEN_JOINTS, Side, kinematics};

use super::pose::{REST, STEP_SECS, blend, pose, steps};

/// Heights of a fingertip over the top of a white key between which a slow press moves the target,
/// m. It ends below the key's travel of 10 mm, since a finger yields.
pub(super) const PRESS_M: [f64; 2] = [0.006, -0.012];
/// Height of a fingertip over a white key that is clear of black keys, m.
const CLEAR_M: f64 = BLACK.top() - WHITE.top() + 0.012;
/// Time in which a finger comes there from its rest, s.
const COME_SECS: f64 = 0.4;
/// Where white keys are pressed, m toward the player from their middle.
pub(super) const PRESS_X_M: f64 = 0.028;
/// Time in which a finger presses a key, and in which it lets it rise, s.
const PRESS_SECS: f64 = 1.5;
/// Places beside the gap to the next lower white key that are pressed, from the one most to the
/// left to the one most to the right, m, and how far apart they are; beside the gap to the next
/// higher key those between. Within some millimetres of the gap a finger presses both keys. The
/// farthest is for a keyboard and an encoder that are some millimetres off as well.
pub(super) const BESIDE_M: f64 = 0.0085;
const BESIDE_EVERY_M: f64 = 0.0017;
/// Where along the keys that is, m toward the player from their middle: clear of the black keys,
/// beside which the finger moves.
pub(super) const BESIDE_X_M: f64 = 0.033;
/// Times in which a finger goes to such a place, waits there, presses, holds the key down, and
/// rises, s.
const BESIDE_SECS: [f64; 5] = [0.15, 0.2, 0.35, 0.2, 0.3];
/// Where the middle of a fingertip begins to push against the front of a black key, and where its
/// target ends, m; and its height over the tops of the white keys meanwhile, m. It meets the key
/// after half of the distance: the rest is for a keyboard that is some millimetres off.
pub(super) const PUSH_X_M: [f64; 2] = [0.034, 0.015];
pub(super) const PUSH_M: f64 = 0.001;
/// Times in which it comes down before the key, pushes, rests there, and comes back, s.
const PUSH_SECS: [f64; 4] = [0.3, 0.8, 0.4, 0.4];
/// White keys between the places of the hand.
const KEYS_APART: f64 = 4.0;

/// Presses one white key after the other, three with each finger, and beside the gaps of the first;
/// and pushes against a black key beside each.
pub(super) fn keys(side: Side) -> Vec<[f64; DRIVEN_JOINTS]> {
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
                hold(finger, blend(&REST, &clear, share), rail, STEP_SECS);
            }
            hold(finger, at(PRESS_M[0]), rail, 0.3);
            let count = steps(PRESS_SECS);
            let press = (0..=count).map(|step| step as f64 / count as f64);
            for share in press.clone().chain(press.rev()) {
                let [begin, end] = PRESS_M;
                hold(finger, at(begin + share * (end - begin)), rail, STEP_SECS);
            }
            // Straight from one place to the next: along the key, aside, above.
            let mut last = [PRESS_X_M, 0.0, PRESS_M[0]];
            let mut go = |to: [f64; 3], secs: f64| {
                for step in 1..=steps(secs) {
                    let share = step as f64 / steps(secs) as f64;
                    let [x, aside, above] =
                        std::array::from_fn(|axis| last[axis] + share * (to[axis] - last[axis]));
                    hold(finger, place(x, aside, above), rail, STEP_SECS);
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
                hold(finger, blend(&REST, &clear, share), rail, STEP_SECS);
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
