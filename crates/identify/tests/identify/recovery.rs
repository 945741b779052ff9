//! Known parameters are recovered: see [`crate::synthetic`].

use crate::synthetic::{Recovery, recover, recover_arm, recover_back_emf};

#[test]
fn the_known_numbers_of_a_finger_come_back_to_the_noise() {
    let recovery = recover(&[1, 2], 1).unwrap();
    for end in &recovery.passes {
        println!("{}: {:.2?} after {} replays", end.pass.name(), end.rms, end.replays);
    }
    for (joint, [before, after]) in &recovery.held_out {
        println!("{joint}: {before:.2} to {after:.2} times the noise");
        assert!(*before > 5.0 && *after < 1.1, "{joint}");
    }
    println!("median error {:.4}, coverage {:.3}", recovery.median_error(), recovery.coverage());
    // Two joints with seven parameters each. Of 14 intervals of 95 % fewer than 11 cover with a probability of 1 in 240.
    assert_eq!(recovery.numbers.len(), 14);
    assert!(recovery.median_error() < 0.02 && recovery.coverage() >= 11.0 / 14.0);
}

/// Checks that these parameters are within 5 % of what they should be and within their intervals, and the motion at its noise.
fn check(recovery: &Recovery, paths: &[&str]) {
    for (joint, [before, after]) in &recovery.held_out {
        println!("{joint}: {before:.2} to {after:.2} times the noise");
        assert!(*before > 5.0 && *after < 1.1, "{joint}");
    }
    for path in paths {
        let (found, expected) = recovery.number(path).unwrap_or_else(|| panic!("{path} is not identifiable"));
        let ([low, high], value) = (found.interval, found.value);
        println!("{path}: {value:.5} ({low:.5} to {high:.5}), expected {expected:.5}");
        assert!((value / expected - 1.0).abs() < 0.05, "{path}");
        // Half as wide again, so that one in a thousand falls out, and not one in twenty.
        let slack = (high - low) * 0.35;
        assert!((low - slack..=high + slack).contains(expected), "{path}");
    }
}

/// A motor of 0.9 N·m and 11 rad/s without load.
#[test]
fn back_emf_comes_back_as_damping() {
    let recovery = recover_back_emf(&[1], 0.9 / 11.0, 2).unwrap();
    check(&recovery, &["joint.index_1.damping", "joint.index_1.stiffness"]);
}

/// The arm of the twin's truth `worn`.
#[test]
fn lag_and_ringing_of_an_arm_come_back() {
    let recovery = recover_arm(5.5, 0.55, 0.03, 3).unwrap();
    check(&recovery, &["joint.rail.stiffness", "joint.rail.damping", "joint.rail.delay"]);
}
