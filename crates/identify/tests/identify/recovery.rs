//! Known parameters are recovered: see [`crate::synthetic`].

use etude_identify::ParameterEstimate;
use etude_stage::params::JointRow;
use etude_stage::{RAIL, StageConfig, World};

use crate::synthetic::{Error, Recovery, recover, recover_as, truth};

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
    for (found, truth) in &recovery.numbers {
        println!("{}: {:.5} {:.5?}, true {truth:.5}", found.path, found.value, found.interval);
    }
    // Two joints with ten parameters each, which include what holds a joint back: dry friction, its
    // multiple at rest, dead band and load. Six of ten have the scale of torque in common, which is
    // known to some per cent only, so six intervals miss together.
    assert_eq!(recovery.numbers.len(), 20);
    let error = |(found, truth): &(ParameterEstimate, f64)| (found.value / truth - 1.0).abs();
    assert!(recovery.numbers.iter().all(|number| error(number) < 0.15));
    assert!(recovery.median_error() < 0.05 && recovery.coverage() >= 13.0 / 20.0);
}

/// A robot of [`truth`] whose finger motors take `back_emf` (N·m·s/rad) away as they turn, at their
/// limit too.
fn recover_back_emf(joints: &[usize], back_emf: f64, seed: u64) -> Result<Recovery, Error> {
    let mut truth = truth(joints, seed);
    for &joint in joints {
        let viscosity = truth.joint(JointRow::Viscosity, joint) + back_emf;
        truth.set_joint(JointRow::Viscosity, joint, viscosity);
    }
    recover_as(&truth, &truth, joints, seed)
}

/// An arm that follows as a mass on a spring: its own frequency, Hz, and damping ratio; and it is
/// late, s.
fn recover_arm(hertz: f64, ratio: f64, delay_secs: f64, seed: u64) -> Result<Recovery, Error> {
    let mut truth = truth(&[RAIL], seed);
    let world = World::new(&StageConfig::default(), &truth)?;
    let model = world.data().model();
    let hand = model.body("palm").ok_or("no palm")?.view(model).subtreemass[0];
    let mass = hand + truth.joint(JointRow::Armature, RAIL);
    let pace = std::f64::consts::TAU * hertz;
    truth.set_joint(JointRow::Stiffness, RAIL, mass * pace * pace);
    truth.set_joint(
        JointRow::Damping,
        RAIL,
        2.0 * ratio * pace * mass - truth.joint(JointRow::Viscosity, RAIL),
    );
    truth.set_joint(JointRow::Delay, RAIL, delay_secs);
    recover_as(&truth, &truth, &[RAIL], seed)
}

/// The estimates of these parameters, each with what it should be, which its interval has to hold;
/// and the motion has to be at its noise.
fn estimates<const N: usize>(recovery: &Recovery, paths: [&str; N]) -> [[f64; 2]; N] {
    for (joint, [before, after]) in &recovery.held_out {
        println!("{joint}: {before:.2} to {after:.2} times the noise");
        assert!(*before > 5.0 && *after < 1.1, "{joint}");
    }
    paths.map(|path| {
        let found = recovery.numbers.iter().find(|(found, _)| found.path == path);
        let (found, expected) = found.unwrap_or_else(|| panic!("{path} is not identifiable"));
        let ([low, high], value) = (found.interval, found.value);
        println!("{path}: {value:.5} ({low:.5} to {high:.5}), expected {expected:.5}");
        // Wider by 70 %, so that one in a thousand falls out, and not one in twenty.
        let slack = (high - low) * 0.35;
        assert!((low - slack..=high + slack).contains(expected), "{path}");
        [value, *expected]
    })
}

fn is_within(share: f64, [value, expected]: [f64; 2]) {
    assert!((value / expected - 1.0).abs() < share, "{value}, not {expected}");
}

/// A motor of 0.9 N·m and 11 rad/s without load. The scale of torque is found only as well as the
/// inertia of the links shows it.
#[test]
fn back_emf_comes_back_as_viscosity() {
    let recovery = recover_back_emf(&[1], 0.9 / 11.0, 2).unwrap();
    estimates(&recovery, ["joint.index_1.viscosity"]).into_iter().for_each(|pair| is_within(0.12, pair));
}

/// The arm of the twin's truth `worn`.
#[test]
fn lag_and_ringing_of_an_arm_come_back() {
    let recovery = recover_arm(5.5, 0.55, 0.03, 3).unwrap();
    let paths = ["joint.rail.stiffness", "joint.rail.damping", "joint.rail.delay"];
    estimates(&recovery, paths).into_iter().for_each(|pair| is_within(0.05, pair));
}
