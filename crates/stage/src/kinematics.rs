//! Forward and inverse kinematics of the fingers.
//!
//! In closed form, from the same numbers as the model; a test compares it with MuJoCo. Points are
//! `[x, y, z]` in the world frame, angles are true joint angles without encoder bias.

use crate::hand::{
    FINGER_RANGE, JOINTS_PER_FINGER, LINKS, MOUNT, ROOT_Z, SPLAY, Side, root_lateral, root_side,
};

/// Root of a finger in the world when the rail is at `rail`, m, and the lateral tilt of its axis,
/// rad.
pub fn root(side: Side, finger: usize, rail: f64) -> ([f64; 3], f64) {
    let outer = root_side(side, finger) != 0.0;
    let [back, up] = MOUNT;
    let forward = ROOT_Z[usize::from(!outer)];
    // Palm +y is world -y, so a splay toward palm +y is one toward world -y.
    ([back - forward, root_lateral(side, finger) + rail, up], -root_side(side, finger) * SPLAY)
}

/// Reach of the bent part of a finger: forward from the first flexion joint, and downward, m.
fn bend(angles: &[f64]) -> [f64; 2] {
    let mut sum = 0.0;
    let mut reach = [0.0; 2];
    for (angle, length) in angles.iter().zip(&LINKS[1..]) {
        sum += angle;
        reach[0] += length * sum.cos();
        reach[1] += length * sum.sin();
    }
    reach
}

/// Centre of the rounded fingertip, m.
pub fn fingertip(side: Side, finger: usize, angles: &[f64; JOINTS_PER_FINGER], rail: f64) -> [f64; 3] {
    let (base, tilt) = root(side, finger, rail);
    let [forward, down] = bend(&angles[1..]);
    let along = LINKS[0] + forward;
    // The roll turns the bent part about the finger's axis: from straight down toward the palm's
    // +y, world -y.
    let (aside, below) = (-down * angles[0].sin(), down * angles[0].cos());
    [
        base[0] - along * tilt.cos() + aside * tilt.sin(),
        base[1] + along * tilt.sin() + aside * tilt.cos(),
        base[2] - below,
    ]
}

/// Joint angles that bring the fingertip's centre to `target`, with the tip as upright as the
/// ranges allow; `None` if the finger cannot reach it.
pub fn reach(side: Side, finger: usize, target: [f64; 3], rail: f64) -> Option<[f64; JOINTS_PER_FINGER]> {
    let (base, tilt) = root(side, finger, rail);
    let [dx, dy, dz] = [base[0] - target[0], target[1] - base[1], base[2] - target[2]];
    // In the finger's own frame: along its axis, aside, below.
    let along = dx * tilt.cos() + dy * tilt.sin();
    let aside = -dx * tilt.sin() + dy * tilt.cos();
    let roll = (-aside).atan2(dz);
    let [low, high] = FINGER_RANGE[0];
    if !(low..=high).contains(&roll) {
        return None;
    }
    let down = aside.hypot(dz);
    let forward = along - LINKS[0];
    // The direction of the last link is redundant. Upright is tried first, then more and more
    // slanted.
    (0..=160).find_map(|step| {
        let slant = f64::from((step + 1) / 2) * 0.01 * if step % 2 == 0 { 1.0 } else { -1.0 };
        let last = std::f64::consts::FRAC_PI_2 - slant;
        two_links(forward - LINKS[3] * last.cos(), down - LINKS[3] * last.sin(), last).and_then(|flexion| {
            let angles = [roll, flexion[0], flexion[1], flexion[2]];
            let fits = angles.iter().zip(&FINGER_RANGE).all(|(a, [low, high])| (*low..=*high).contains(a));
            fits.then_some(angles)
        })
    })
}

/// Flexion angles that bring the end of the medial link to (`forward`, `down`) and the last link to
/// direction `last`.
fn two_links(forward: f64, down: f64, last: f64) -> Option<[f64; 3]> {
    let (a, b) = (LINKS[1], LINKS[2]);
    let cosine = (forward * forward + down * down - a * a - b * b) / (2.0 * a * b);
    if !(-1.0..=1.0).contains(&cosine) {
        return None;
    }
    let second = cosine.acos();
    let first = down.atan2(forward) - (b * second.sin()).atan2(a + b * second.cos());
    Some([first, second, last - first - second])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn reach_undoes_fingertip(
            finger in 0usize..3,
            rail in -0.3f64..0.3,
            x in 0.0f64..0.06,
            y in -0.02f64..0.02,
            z in 0.03f64..0.06,
        ) {
            for side in [Side::Left, Side::Right] {
                let target = [x, rail + root_lateral(side, finger) + y, z];
                if let Some(angles) = reach(side, finger, target, rail) {
                    let tip = fingertip(side, finger, &angles, rail);
                    for axis in 0..3 {
                        prop_assert!((tip[axis] - target[axis]).abs() < 1e-9, "{tip:?} for {target:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn every_finger_reaches_white_and_black_keys() {
        for key in [24, 25] {
            let [x, y, z] = crate::geometry::key_target(key);
            for finger in 0..3 {
                let rail = y - root_lateral(Side::Left, finger);
                assert!(
                    reach(Side::Left, finger, [x, y, z + 0.01], rail).is_some(),
                    "key {key} finger {finger}"
                );
            }
        }
    }
}
