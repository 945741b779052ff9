//! The twin's keyboard is what a finger meets on a real one: keys that are hard, slippery, a
//! millimetre apart and without fences.

use etude_music::KeySet;
use etude_stage::geometry::{KeyShape, WHITE_PITCH};
use etude_stage::hand::{JOINTS_PER_FINGER, TIP_RADIUS, root_lateral};
use etude_stage::kinematics;
use etude_stage::params::WorldRow;

use super::*;
use crate::hidden_params::KEY_GAP_M;

/// The finger that plays in these tests, and its first joint.
pub(super) const MIDDLE: usize = 1;
pub(super) const ROLL: usize = MIDDLE * JOINTS_PER_FINGER;
/// The clamps of the hand's driver, N·m (allegro_hand_ros_v4).
const CLAMPS_NM: [f64; JOINTS_PER_FINGER] = [0.3125, 0.5625, 0.375, 0.2375];
/// E, which has a white neighbour, and D, which stands between two black ones.
pub(super) const E: usize = 28;
const D: usize = 26;
pub(super) const SETS: [&str; 4] = ["standard", "worn", "mild", "ideal"];

/// A twin whose joints are driven without its devices.
struct Driven {
    twin: Twin,
    /// Where the joints are pulled to.
    target: [f64; DRIVEN_JOINTS],
    /// The largest torques of the finger, N·m.
    max_nm: [f64; JOINTS_PER_FINGER],
}

impl Driven {
    /// The tip of the middle finger is 10 mm over a key, `aside` of its middle.
    fn over(name: &str, key: usize, aside: f64) -> Self {
        let twin = Twin::new(&TwinParams::load(name).unwrap(), HandSide::Left).unwrap();
        let mut target = twin.world.start_pose();
        target[RAIL] = twin.world.key_target(key)[1] - root_lateral(Side::Left, MIDDLE);
        let mut driven = Self { twin, target, max_nm: CLAMPS_NM };
        driven.aim(key, 0.01, aside);
        driven.twin.world.reset_to(&driven.target);
        driven
    }

    /// Pulls the tip to a height over the top of the resting key, m.
    fn aim(&mut self, key: usize, height: f64, aside: f64) {
        let [x, y, _] = self.twin.world.key_target(key);
        let top = KeyShape::of(key).top() + self.twin.world.params().world(WorldRow::KeyboardHeight);
        let tip = [x, y + aside, top + TIP_RADIUS + height];
        let angles = kinematics::reach(Side::Left, MIDDLE, tip, self.target[RAIL]).unwrap();
        self.target[ROLL..ROLL + JOINTS_PER_FINGER].copy_from_slice(&angles);
    }

    fn step(&mut self) {
        let (joints, speeds) = (self.twin.world.joints(), self.twin.world.joint_velocities());
        let torques = std::array::from_fn(|joint| {
            let off = self.target[joint] - joints[joint];
            if joint == RAIL {
                return 40_000.0 * off - 1000.0 * speeds[joint];
            }
            let most = self.max_nm[joint % JOINTS_PER_FINGER];
            (3.0 * off - 0.1 * speeds[joint]).clamp(-most, most)
        });
        self.twin.drive(&torques);
    }

    fn run(&mut self, millis: usize) {
        (0..millis).for_each(|_| self.step());
    }

    /// Keys whose second contact is closed.
    fn sounding(&self) -> KeySet {
        let second = &self.twin.keys.second;
        (0..KEY_COUNT).filter(|key| self.twin.world.key_travel(*key) > second[*key]).collect()
    }
}

/// Depth of the deepest contact with a key, m, and the sum of all forces on keys, N.
pub(super) fn key_contacts(world: &World) -> (f64, [f64; 3]) {
    let data = world.data();
    let model = data.model();
    let keys: Vec<usize> = (0..KEY_COUNT).map(|key| model.geom(&format!("key_{key}")).unwrap().id).collect();
    let (mut deepest, mut forces) = (0.0_f64, [0.0; 3]);
    for (number, contact) in data.contact().iter().enumerate() {
        let is_key = contact.geom.map(|geom| keys.contains(&(geom as usize)));
        if is_key == [false; 2] {
            continue;
        }
        deepest = deepest.max(-contact.dist);
        // In the contact's own axes, which are rows, and on the second geom.
        let sign = if is_key[0] { -1.0 } else { 1.0 };
        let force = data.contact_force(number);
        for (axis, sum) in forces.iter_mut().enumerate() {
            *sum += sign * (0..3).map(|row| contact.frame[3 * row + axis] * force[row]).sum::<f64>();
        }
    }
    (deepest, forces)
}

#[test]
fn white_keys_are_a_millimetre_apart_and_have_no_fences_between_them() {
    for name in SETS {
        let twin = Twin::new(&TwinParams::load(name).unwrap(), HandSide::Left).unwrap();
        let model = twin.world.data().model();
        assert!(model.geom("fence_0").is_none(), "{name}");
        let half_width = model.geom(&format!("key_{E}")).unwrap().view(model).size[1];
        assert!((WHITE_PITCH - 2.0 * half_width - 0.001).abs() < 1e-12, "{name}: {half_width} m");
    }
}

/// A printed fingertip of plastic (2.3 GPa) would sink 0.016 mm into a flat one at 10 N (Hertz).
#[test]
fn a_finger_that_pushes_with_10_newtons_does_not_sink_into_a_key() {
    for name in SETS {
        let mut driven = Driven::over(name, E, 0.0);
        driven.max_nm = [0.3125, 1.4, 1.0, 1.0];
        driven.aim(E, -0.012, 0.0);
        driven.run(500);
        let (deepest, [.., down]) = key_contacts(&driven.twin.world);
        println!("{name}: {:.4} mm at {:.1} N", deepest * 1e3, -down);
        assert!((9.0..14.0).contains(&-down), "{name}: {down} N");
        assert!(deepest < 5e-5, "{name}: {deepest} m");
        let travel = driven.twin.world.key_travel(E);
        assert!((0.99..1.01).contains(&travel), "{name}: the key's stop is at {travel} of its travel");
    }
}

/// What the paper says of a real keyboard: a finger that pushes sideways while it holds a key
/// sounds no neighbour. It goes as far as the side of the next key.
#[test]
fn a_finger_that_holds_a_key_and_pushes_sideways_stays_on_it() {
    for name in SETS {
        for (key, sign) in [(E, -1.0), (E, 1.0), (D, -1.0), (D, 1.0)] {
            let mut driven = Driven::over(name, key, 0.0);
            driven.aim(key, -0.012, 0.0);
            driven.run(300);
            let alone: KeySet = [key].into_iter().collect();
            assert_eq!(driven.sounding(), alone, "{name}");
            driven.target[ROLL] = 0.47 * sign;
            let mut aside = 0.0_f64;
            for _ in 0..1000 {
                driven.step();
                assert_eq!(driven.sounding(), alone, "{name}: key {key}, pushed to {sign}");
                let off = driven.twin.world.fingertip(MIDDLE)[1] - driven.twin.world.key_target(key)[1];
                aside = aside.max(off.abs());
            }
            let saturated = 3.0 * (driven.target[ROLL] - driven.twin.world.joints()[ROLL]).abs();
            assert!(saturated > CLAMPS_NM[0], "{name}: it does not push with its full torque");
            // The tip is round: where the edge of the next key meets it, it is a little narrower.
            let bound = WHITE_PITCH / 2.0 + KEY_GAP_M / 2.0 - 0.95 * TIP_RADIUS;
            println!("{name}: key {key} to {sign}: {:.2} mm aside, bound {:.2}", aside * 1e3, bound * 1e3);
            assert!(aside < bound + 0.001, "{name}: key {key}, pushed to {sign}: {aside} m");
        }
    }
}

/// A finger that comes down where two keys meet.
#[test]
fn a_finger_on_the_gap_presses_both_keys_or_slides_onto_one() {
    for name in SETS {
        let mut both = 0;
        for aside_mm in 0..=23 {
            let mut driven = Driven::over(name, E, f64::from(aside_mm) * 1e-3);
            driven.aim(E, -0.014, f64::from(aside_mm) * 1e-3);
            for _ in 0..600 {
                driven.step();
                let speeds = driven.twin.world.joint_velocities();
                assert!(speeds.iter().all(|speed| speed.abs() < 20.0), "{name}: {speeds:?}");
            }
            let sounding: Vec<usize> = driven.sounding().iter().collect();
            assert!([&[E][..], &[E + 1], &[E, E + 1]].contains(&&sounding[..]), "{name}: {sounding:?}");
            both += usize::from(sounding.len() == 2);
            assert!(driven.twin.world.joint_velocities().iter().all(|speed| speed.abs() < 0.5), "{name}");
        }
        println!("{name}: two keys at {both} of 24 places");
        // As rough as the simulator's keys, they would both be held at half of all places.
        assert!((1..12).contains(&both), "{name}: {both}");
    }
}
