//! How far toward the player the keyboard is: a fingertip over the white keys pushes against the
//! front of a black key, which gives way in no direction but down. Where the fingertip stops is the
//! front.

use etude_music::{CONTROL_HZ, KEY_COUNT, key_is_black};
use etude_stage::geometry::{BLACK, WHITE, key_lateral};
use etude_stage::hand::{FINGERS, TIP_RADIUS};
use etude_stage::kinematics;

use super::hand::Hand;
use super::sample::{Sample, means_by_finger};
use crate::parameter_bounds::FIRST_BEND;

/// A target that is this far inside a black key pushes against it, m.
const INSIDE_M: f64 = 0.005;
/// A target this far from the middle of a black key still meets its front, m.
const MAX_OFF_MIDDLE_M: f64 = 0.002;
/// Time at the end of a push in which a fingertip has come to rest, s.
const REST_SECS: f64 = 0.15;
/// A fingertip this far from its target has met something, m: dry friction alone holds it at most
/// 1.7 mm away.
const STOPPED_M: f64 = 0.002;
/// Error of what a finger's pushes have in common, and all pushes, half of a 95 % interval, m. [our
/// estimate, from twins with known keyboards]
pub(super) const SHARED_ERROR_M: f64 = 4e-4;

/// How far toward the player of its nominal position each finger finds the front of the black keys,
/// m, by its encoders; `heights` is how high it finds the keyboard. None if a finger has met too
/// few.
pub(super) fn fronts(hands: &[Hand<'_>], heights: &[f64; FINGERS]) -> Option<[Sample; FINGERS]> {
    means_by_finger(|finger| {
        let of_hand = |hand: &Hand<'_>| -> Vec<f64> {
            let ends = (1..hand.motion.commands.steps()).filter(|step| ends(hand, finger, *step));
            ends.filter_map(|step| front(hand, finger, step, heights[finger])).collect()
        };
        hands.iter().flat_map(of_hand).collect()
    })
}

/// Whether a control step is the last in which a finger's target rests inside a black key.
fn ends(hand: &Hand<'_>, finger: usize, step: usize) -> bool {
    let Some([x, y, z]) = hand.target(finger, step) else { return false };
    let rests = |other: usize| hand.target(finger, other) == Some([x, y, z]);
    let is_inside = x < BLACK.front() + TIP_RADIUS - INSIDE_M
        && (WHITE.top()..BLACK.top()).contains(&(z - TIP_RADIUS))
        && (0..KEY_COUNT).any(|key| key_is_black(key) && (key_lateral(key) - y).abs() < MAX_OFF_MIDDLE_M);
    is_inside && rests(step - 1) && !rests(step + 1)
}

/// How far toward the player of its nominal position the front of the black key is, m, at the end
/// of a push.
fn front(hand: &Hand<'_>, finger: usize, step: usize, height: f64) -> Option<f64> {
    let [target, ..] = hand.target(finger, step)?;
    let end = step as f64 / CONTROL_HZ;
    let readings = hand.indices([end - REST_SECS, end]);
    let count = readings.len() as f64;
    let [mut x, mut front] = [0.0; 2];
    for index in readings {
        let angles = hand.angles(finger, index);
        let tip = kinematics::fingertip(hand.side, finger, &angles, 0.0);
        // The last link slants by this from upright, its upper part toward the key where it is
        // positive.
        let slant = angles[FIRST_BEND..].iter().sum::<f64>() - std::f64::consts::FRAC_PI_2;
        let below = BLACK.top() + height - tip[2];
        let ahead = if below < -TIP_RADIUS * slant.max(0.0).sin() {
            // The rounded end alone, at the edge.
            (TIP_RADIUS * TIP_RADIUS - below * below).max(0.0).sqrt()
        } else if slant > 0.0 {
            below * slant.tan() + TIP_RADIUS / slant.cos()
        } else {
            TIP_RADIUS
        };
        x += tip[0] / count;
        front += (tip[0] - ahead) / count;
    }
    (x - target > STOPPED_M).then_some(front - BLACK.front())
}
