//! Fingers are weighed on a twin whose motors have known torques.

#![allow(clippy::unwrap_used, reason = "a test that cannot continue has failed")]

use std::sync::atomic::AtomicBool;

use etude_identify::{GravityCompensation, RecordedMotion, fit_gravity_compensation};
use etude_lab::record_excitations;
use etude_perform::Excitation;
use etude_perform::session::RigChoice;
use etude_twin::TwinParams;

fn weighed(change: &str) -> GravityCompensation {
    let twin_params = TwinParams::load("mild").unwrap().with(change).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let rig = RigChoice::Twin(Box::new(twin_params));
    let recordings =
        record_excitations(&rig, &Excitation::ALL, folder.path(), 0, &AtomicBool::new(false), &mut |_, _| {})
            .unwrap();
    fit_gravity_compensation(&RecordedMotion::load_all(&recordings).unwrap()).unwrap()
}

#[test]
fn the_feed_forward_is_found() {
    // The joint at a finger's base, the second of four, carries most of the weight.
    // Three of the motors that a parameter set may have (docs/twin.md).
    for (torque_nm, dead_pwm) in [(0.92, 4), (0.8, 10), (0.7, 15)] {
        let change = format!(
            "[world]\ngravity = true\n[hand]\nfull_torque_nm = [{torque_nm}, {torque_nm}, {torque_nm}, {torque_nm}]\n\
             dead_pwm = {dead_pwm}"
        );
        let (weight, expected) = (weighed(&change), 1200.0 / torque_nm);
        println!("{weight:?}, expected {expected:.0}");
        assert!((weight.pwm_per_nm / expected - 1.0).abs() < 0.05, "{weight:?}, expected {expected:.0}");
        let [low, high] = weight.interval;
        assert!((low..=high).contains(&expected), "{weight:?}, expected {expected:.0}");
        assert!(weight.advice(1200.0).contains("the fingers weigh"));
    }
}

#[test]
fn fingers_without_a_weight_have_none() {
    let weight = weighed("");
    assert!(weight.pwm_per_nm.abs() < 60.0, "{weight:?}");
    assert!(weight.advice(0.0).contains("no weight"));
}
