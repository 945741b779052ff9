//! Excitations that stay in the air touch nothing, so they are replayed without contacts.

#![allow(clippy::unwrap_used, reason = "a test that cannot continue has failed")]

use std::sync::atomic::AtomicBool;

use etude_identify::{Commands, RecordedMotion};
use etude_lab::{RobotMotion, record_robot};
use etude_perform::Excitation;
use etude_perform::session::RigChoice;
use etude_stage::{PhysicalParams, StageConfig, World};
use etude_twin::TwinParams;

#[test]
fn a_hand_in_the_air_has_no_contact() {
    let folder = tempfile::tempdir().unwrap();
    for twin_params in ["standard", "random:7"] {
        for excitation in [Excitation::OpenClose, Excitation::Chirp, Excitation::Rail, Excitation::HeldOut] {
            let rig = RigChoice::Twin(Box::new(TwinParams::load(twin_params).unwrap()));
            let path = folder.path().join("air.mcap");
            record_robot(&rig, RobotMotion::Excitation(excitation), true, 0, &path, &AtomicBool::new(false))
                .unwrap();
            let motion = RecordedMotion::load(&path).unwrap();
            assert!(motion.is_in_the_air(), "{twin_params}, {}", excitation.name());
            let Commands::Targets(targets) = &motion.commands else { panic!("excitations are targets") };
            let mut world = World::new(&StageConfig::default(), &PhysicalParams::default()).unwrap();
            world.reset_to(&motion.start);
            let mut contacts = 0;
            for targets in targets {
                world.step_watched(targets, |world| contacts += world.data().contact().len());
            }
            assert_eq!(contacts, 0, "{twin_params}, {}", excitation.name());
        }
    }
}
