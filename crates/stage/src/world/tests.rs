use super::*;
use crate::config::KeyFactors;
use crate::geometry::KeyShape;

/// A key with half the travel reaches its lower stop, and sounds, at half the depth of its neighbours; also after the
/// physical numbers were set again.
#[test]
fn a_keys_travel_is_its_own() {
    let mut keys = ModelOptions::default().keys;
    keys[7] = KeyFactors { stiffness: 1.0, travel: 0.5 };
    let (config, params) = (StageConfig::default(), PhysicalParams::default());
    let options = ModelOptions { keys, ..ModelOptions::default() };
    let mut world = World::with_options(&config, &params, &options).unwrap();
    world.set_params(&params);
    world.put_keys(&std::array::from_fn(|key| 0.3 * KeyShape::of(key).max_angle()));
    assert!((world.key_travel(5) - 0.3).abs() < 1e-12 && (world.key_travel(7) - 0.6).abs() < 1e-12);
    world.watch_keys();
    assert_eq!(world.pressed().iter().collect::<Vec<_>>(), [7]);
}

#[test]
fn friction_of_the_joints_can_change_on_the_way() {
    let mut world = World::new(&StageConfig::default(), &PhysicalParams::default()).unwrap();
    let push = |world: &mut World| {
        let before = world.joints()[4];
        let torques = std::array::from_fn(|joint| if joint == 4 { 0.05 } else { 0.0 });
        for _ in 0..20 {
            world.drive(&torques);
        }
        world.joints()[4] - before
    };
    world.set_joint_friction(&[0.2; JOINTS]);
    let held = push(&mut world);
    world.set_joint_friction(&[f64::NAN; JOINTS]);
    let free = push(&mut world);
    assert!(held.abs() < 0.02 && free > 5.0 * held.abs(), "{held} {free}");
}
