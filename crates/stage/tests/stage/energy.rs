//! Without torque the world only loses energy: nothing in the model feeds itself.

use etude_stage::{DRIVEN_JOINTS, JOINT_NAMES};
use proptest::prelude::*;

use crate::bench;
use crate::replica::{Replica, STEP_SECS};

/// Energy after each physics step of a second without torque.
fn fade(replica: &mut Replica, secs: f64) -> Vec<f64> {
    let steps = (secs / STEP_SECS) as usize;
    (0..steps)
        .map(|_| {
            replica.physics_step(&[0.0; DRIVEN_JOINTS]);
            replica.energy()
        })
        .collect()
}

#[test]
fn a_key_let_go_comes_to_rest() {
    for name in ["key_24", "key_25"] {
        let mut replica = Replica::of(&bench::nominal(), |xml| xml);
        let dof = replica.dof(name);
        replica.data.qpos_mut()[dof] = 0.03;
        let start = replica.energy();
        assert!(start > 1e-5);
        let energies = fade(&mut replica, 1.0);
        let mut before = start;
        for energy in &energies {
            // Potential and kinetic energy are half a step apart in this integrator.
            assert!(*energy <= before * 1.01 + 1e-15, "{name}: from {before} to {energy}");
            before = *energy;
        }
        assert!(energies.last().unwrap() < &(1e-9 * start), "{name}: {:?} of {start}", energies.last());
    }
}

proptest! {
    #![proptest_config(bench::cases(16))]
    #[test]
    fn a_pushed_hand_loses_energy_whatever_it_hits(
        velocities in prop::array::uniform13(-1.0f64..1.0),
        keys in prop::collection::vec((0usize..49, -10.0f64..10.0), 0..6),
    ) {
        let mut replica = Replica::of(&bench::nominal(), |xml| xml);
        for (name, velocity) in JOINT_NAMES.iter().zip(velocities) {
            let dof = replica.dof(name);
            replica.data.qvel_mut()[dof] = if *name == "rail" { velocity } else { 15.0 * velocity };
        }
        for (key, velocity) in keys {
            let dof = replica.dof(&format!("key_{key}"));
            replica.data.qvel_mut()[dof] = velocity;
        }
        let start = replica.energy();
        let energies = fade(&mut replica, 3.0);
        // A stop or a contact may hold energy for a moment and give it back, but never more than
        // there was.
        let most = energies.iter().copied().fold(0.0, f64::max);
        prop_assert!(most <= start * 1.001, "{} of {}", most, start);
        let quarter = energies.len() / 4;
        prop_assert!(energies[3 * quarter] <= energies[quarter] && energies[quarter] < start);
        prop_assert!(*energies.last().unwrap() < 0.5 * start);
    }
}
