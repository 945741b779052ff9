use etude_music::{KEY_COUNT, key_is_black};
use etude_stage::geometry::{BLACK, WHITE, key_lateral};
use etude_stage::hand::TIP_RADIUS;
use etude_stage::{joint_range, kinematics};

use super::key_presses::{BESIDE_M, BESIDE_X_M, PRESS_M, PRESS_X_M, PUSH_M, PUSH_X_M};
use super::*;

/// How high above the black keys the ends of the fingers stay, as far as targets go, m.
const CLEARANCE: f64 = 0.012;

/// Height of the lowest fingertip above the black keys when the joints are at these targets, m.
fn clearance(targets: &[f64; DRIVEN_JOINTS]) -> f64 {
    let height = |finger: usize| {
        let angles = std::array::from_fn(|joint| targets[finger * JOINTS_PER_FINGER + joint]);
        kinematics::fingertip(Side::Left, finger, &angles, targets[RAIL])[2]
    };
    (0..FINGERS).map(height).fold(f64::INFINITY, f64::min) - TIP_RADIUS - BLACK.top()
}

#[test]
fn sequences_keep_clear_of_the_keys_and_within_the_joints_ranges() {
    for excitation in Excitation::ALL {
        let targets = excitation.targets(Side::Left);
        assert!(targets.len() > 200, "{excitation}");
        for (step, targets) in targets.iter().enumerate() {
            let is_clear = excitation == Excitation::Keys || clearance(targets) > CLEARANCE;
            assert!(is_clear, "{excitation} {step}: {}", clearance(targets));
            for (joint, target) in targets.iter().enumerate() {
                let [low, high] = joint_range(joint);
                assert!((low..=high).contains(target), "{excitation} {step} {joint}: {target}");
            }
        }
        let rest = excitation.start();
        for end in [&targets[0], &targets[targets.len() - 1]] {
            let far = (0..DRIVEN_JOINTS).map(|joint| (end[joint] - rest[joint]).abs()).fold(0.0, f64::max);
            assert!(far < 1e-9, "{excitation}: {far}");
        }
    }
}

#[test]
fn a_finger_presses_one_white_key_at_a_time_in_its_middle_or_beside_a_gap() {
    for side in [Side::Left, Side::Right] {
        let mut pressed = std::collections::BTreeSet::new();
        let mut gaps = std::collections::BTreeSet::new();
        let mut last: Option<(usize, [f64; 3])> = None;
        let mut pushed = std::collections::BTreeSet::new();
        for (step, targets) in Excitation::Keys.targets(side).iter().enumerate() {
            let tip = |finger: usize| {
                let angles = std::array::from_fn(|joint| targets[finger * JOINTS_PER_FINGER + joint]);
                kinematics::fingertip(side, finger, &angles, targets[RAIL])
            };
            let low: Vec<usize> =
                (0..FINGERS).filter(|finger| tip(*finger)[2] - TIP_RADIUS < BLACK.top() + 0.010).collect();
            assert!(low.len() <= 1, "{side:?} {step}: {low:?}");
            let Some([x, y, z]) = low.first().map(|finger| tip(*finger)) else {
                last = None;
                continue;
            };
            let (key, above) = ((y / WHITE_PITCH).round(), z - TIP_RADIUS - WHITE.top());
            // Straight, and not by a jump to the fingers' rest.
            if let Some((finger, before)) = last.replace((low[0], [x, y, z]))
                && finger == low[0]
            {
                let far = (0..3).map(|axis| (before[axis] - [x, y, z][axis]).abs()).fold(0.0, f64::max);
                assert!(far < 0.012, "{side:?} {step}: {far}");
            }
            let is_at = |place: f64| (x - place).abs() < 1e-9;
            let is_push = !is_at(PRESS_X_M) && !is_at(BESIDE_X_M) && above < PRESS_M[0] - 1e-9;
            if is_push {
                // Before the front of a black key, clear of the white ones.
                let black = (0..KEY_COUNT).find(|key| (key_lateral(*key) - y).abs() < 1e-9).unwrap();
                assert!(key_is_black(black) && above > PUSH_M - 1e-9, "{side:?} {step}: {black} {above}");
                assert!(x > PUSH_X_M[1] - 1e-9 && x < PUSH_X_M[0] + 1e-9, "{side:?} {step}: {x}");
                if x < PUSH_X_M[1] + 1e-9 {
                    pushed.insert((low[0], (1e4 * targets[RAIL]).round() as i64));
                }
                continue;
            }
            assert!(above > PRESS_M[1] - 1e-9, "{side:?} {step}: {above}");
            if (y - key * WHITE_PITCH).abs() < 1e-9 {
                if above < 0.0 {
                    assert!((x - PRESS_X_M).abs() < 1e-9, "{side:?} {step}: {x}");
                    pressed.insert((low[0], key as i64));
                }
                continue;
            }
            if above > PRESS_M[0] - 1e-9 {
                continue;
            }
            let gap = (y / WHITE_PITCH - 0.5).round() + 0.5;
            assert!((x - BESIDE_X_M).abs() < 1e-9, "{side:?} {step}: {x}");
            assert!((y - gap * WHITE_PITCH).abs() < BESIDE_M + 1e-9, "{side:?} {step}: {y}");
            if above < PRESS_M[1] + 1e-9 {
                gaps.insert((low[0], (1e6 * (y - gap * WHITE_PITCH)).round() as i64));
            }
        }
        assert_eq!(pressed.len(), 9, "{side:?}: {pressed:?}");
        assert_eq!(pushed.len(), 9, "{side:?}: {pushed:?}");
        // Every 0.85 mm.
        let all: Vec<(usize, i64)> =
            (0..FINGERS).flat_map(|finger| (-10..=10).map(move |place| (finger, 850 * place))).collect();
        assert_eq!(gaps.into_iter().collect::<Vec<_>>(), all, "{side:?}");
    }
}

#[test]
fn every_joint_is_moved_by_the_sequences_to_fit_and_by_the_one_to_try_it_on() {
    let spread = |excitations: &[Excitation], joint: usize| {
        let values = excitations.iter().flat_map(|excitation| excitation.targets(Side::Left));
        let (low, high) = values.fold((f64::MAX, f64::MIN), |(low, high), targets| {
            (low.min(targets[joint]), high.max(targets[joint]))
        });
        high - low
    };
    for joint in 0..DRIVEN_JOINTS {
        let least = if joint == RAIL { 0.1 } else { 0.2 };
        assert!(spread(&[Excitation::OpenClose, Excitation::Chirp, Excitation::Rail], joint) > least);
        assert!(spread(&[Excitation::HeldOut], joint) > least / 2.0, "{joint}");
    }
}

#[test]
fn names_lead_back() {
    for excitation in Excitation::ALL {
        assert_eq!(excitation.name().parse(), Ok(excitation));
    }
    assert!("chrip".parse::<Excitation>().unwrap_err().contains("open-close, chirp, rail"));
}
