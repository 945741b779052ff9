//! The keyboard is measured by slow presses, on twins whose keyboards are known.

#![allow(clippy::unwrap_used, reason = "a test that cannot continue has failed")]

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use etude_identify::{
    IdentifyConfig, LmConfig, Measured, MethodConfig, MotionError, RecordedMotion, describe_keyboard,
    identify,
};
use etude_lab::{RobotMotion, record_robot};
use etude_perform::session::RigChoice;
use etude_perform::{Excitation, Job};
use etude_twin::TwinParams;

fn recorded(twin_params: TwinParams, folder: &Path) -> Result<RecordedMotion, MotionError> {
    let rig = RigChoice::Twin(Box::new(twin_params));
    let (path, motion) = (folder.join("keys.mcap"), RobotMotion::Excitation(Excitation::Keys));
    record_robot(&rig, motion, true, 0, &path, &AtomicBool::new(false)).unwrap();
    RecordedMotion::load(&path)
}

/// What is measured of the keyboard of a twin, by path.
fn measured(twin_params: TwinParams) -> BTreeMap<String, Measured> {
    let folder = tempfile::tempdir().unwrap();
    let motions = [recorded(twin_params, folder.path()).unwrap()];
    let found = measured_of(&motions, folder.path());
    found.into_iter().map(|one| (one.path.clone(), one)).collect()
}

fn measured_of(motions: &[RecordedMotion], folder: &Path) -> Vec<Measured> {
    let method = MethodConfig::Lm(LmConfig::for_replays());
    let config = IdentifyConfig { method, seed: 0, start: BTreeMap::new() };
    let (stop, mut tell) = (AtomicBool::new(false), |_: &_| {});
    let state = folder.join("state.json");
    identify(motions, &config, &state, &mut Job::new(&mut tell, &stop)).unwrap().measured
}

#[test]
fn a_known_keyboard_is_found() {
    let change = "[physics]\n\"key.threshold\" = 0.6\n\"key.preload\" = 0.5\n\"key.stiffness\" = 0.8\n\"key.friction\" = 0.3\n\
                  \"keyboard.height\" = -0.0015\n\"joint.index_1.encoder_bias\" = 0.01\n\"joint.ring_1.encoder_bias\" = -0.01\n\
                  \"joint.middle_2.encoder_bias\" = -0.01\n\"joint.ring_2.encoder_bias\" = 0.01\n\
                  \"keyboard.lateral\" = 0.001\n\"keyboard.depth\" = 0.002\n\"joint.index_0.encoder_bias\" = 0.02\n\"joint.middle_0.encoder_bias\" = -0.02\n\
                  \"joint.ring_0.encoder_bias\" = 0.0\n[keys]\nfirst_contact = 0.35";
    let found = measured(TwinParams::load("ideal").unwrap().with(change).unwrap());
    for (path, value, most) in [
        ("key.threshold", 0.6, 0.03),
        ("key.hysteresis", 1.0 - 0.35 / 0.6, 0.02),
        ("key.preload", 0.5, 0.025),
        ("key.stiffness", 0.8, 0.04),
        ("keyboard.height", -0.0015, 1e-4),
        ("joint.index_1.encoder_bias", 0.01, 2e-3),
        ("joint.middle_1.encoder_bias", 0.0, 2e-3),
        ("joint.ring_1.encoder_bias", -0.01, 2e-3),
        ("joint.index_2.encoder_bias", 0.0, 5e-3),
        ("joint.middle_2.encoder_bias", -0.01, 5e-3),
        ("joint.ring_2.encoder_bias", 0.01, 5e-3),
        ("keyboard.lateral", 0.001, 5e-4),
        ("keyboard.depth", 0.002, 5e-4),
        ("joint.index_0.encoder_bias", 0.02, 1e-2),
        ("joint.middle_0.encoder_bias", -0.02, 1e-2),
        ("joint.ring_0.encoder_bias", 0.0, 1e-2),
    ] {
        let one = &found[path];
        println!("{one:?}, true {value}");

        assert!((one.value - value).abs() < most, "{one:?}, true {value}");
        assert!((one.interval[0]..=one.interval[1]).contains(&value), "{one:?}, true {value}");
    }
}

/// Keys that are no two alike, play, dead bands and late messages. Places count from the bottom,
/// since a simulated key's travel is the nominal one.
#[test]
fn the_keyboards_of_the_parameter_sets_are_found() {
    for (twin_params, threshold, travel) in [("standard", 0.45 * 1.05, 1.05), ("worn", 0.55 * 0.93, 0.93)] {
        let found = measured(TwinParams::load(twin_params).unwrap());
        let sounds = found["key.threshold"].value;
        let silent = sounds * (1.0 - found["key.hysteresis"].value);
        for (place, expected) in [(sounds, threshold), (silent, 0.3 * travel)] {
            assert!((place - (expected + 1.0 - travel)).abs() < 0.05, "{twin_params}: {place}, {expected}");
        }
        let value = |path: &str| found[path].value;
        let places = [value("keyboard.depth"), value("keyboard.lateral")];
        let biases =
            ["index_1", "middle_1", "ring_2"].map(|joint| value(&format!("joint.{joint}.encoder_bias")));
        let (in_place, expected, most) = match twin_params {
            "standard" => ([-0.002, 0.002], [0.01, -0.008, 0.012], 0.005),
            _ => ([0.003, -0.0025], [-0.015, 0.012, -0.018], 0.01),
        };
        // The hand's tilt is in them, and other biases of the finger.
        for (place, expected) in places.into_iter().zip(in_place) {
            assert!((place - expected).abs() < 0.001, "{twin_params}: {place}, {expected}");
        }
        for (bias, expected) in biases.into_iter().zip(expected) {
            assert!((bias - expected).abs() < most, "{twin_params}: {bias}, {expected}");
        }
    }
}

#[test]
fn a_keyboard_that_is_out_of_reach_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let low = TwinParams::load("ideal").unwrap().with("[physics]\n\"keyboard.height\" = -0.012").unwrap();
    let why = recorded(low, folder.path()).unwrap_err().to_string();
    assert!(why.contains("no key sounded"), "{why}");
}

#[test]
fn keys_that_are_not_pressed_to_their_bottom_are_not_measured() {
    let low = TwinParams::load("ideal").unwrap().with("[physics]\n\"keyboard.height\" = -0.006").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let motions = [recorded(low, folder.path()).unwrap()];
    assert!(describe_keyboard(&motions, &[]).unwrap().contains("record the excitation `keys` again"));
    assert!(measured_of(&motions, folder.path()).is_empty());
}

#[test]
fn black_keys_that_no_finger_meets_leave_the_depth_unknown() {
    let far = TwinParams::load("ideal").unwrap().with("[physics]\n\"keyboard.depth\" = -0.012").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let motions = [recorded(far, folder.path()).unwrap()];
    let found = measured_of(&motions, folder.path());
    assert!(found.iter().all(|one| one.path != "keyboard.depth" && !one.path.contains("_2.")), "{found:?}");
    let words = describe_keyboard(&motions, &found).unwrap();
    assert!(
        words.contains(
            "how far toward the player was not measured, since a finger has met too few black keys"
        ),
        "{words}"
    );
}
