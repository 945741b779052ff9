//! The exported model is the world: plain MuJoCo steps it as `World` does, bit for bit here and,
//! where Python is at hand, in the stock wheel too (`scripts/check_model.py`).

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use etude_stage::{Actuation, DRIVEN_JOINTS, PhysicalParams, Side, StageConfig, World, mjcf};
use proptest::prelude::*;

use crate::bench::{self, Gesture, all_targets, over};
use crate::replica::{Moment, Replica};

/// Environment variable that names a Python with the stock `mujoco` package; `make test` sets it.
const PYTHON: &str = "ETUDE_PYTHON";

/// The four worlds of the paper: main text and appendix, either hand.
fn worlds() -> impl Iterator<Item = (&'static str, StageConfig)> {
    [
        ("main-left", Side::Left, true, Actuation::Controlled),
        ("main-right", Side::Right, true, Actuation::Controlled),
        ("appendix-left", Side::Left, false, Actuation::Position),
        ("appendix-right", Side::Right, false, Actuation::Position),
    ]
    .map(|(name, side, fences, actuation)| {
        (name, StageConfig { side, fences, actuation, ..StageConfig::default() })
    })
    .into_iter()
}

/// Two seconds with presses, a push against a neighbour and a long move.
fn vigorous(world: &World) -> Vec<[f64; DRIVEN_JOINTS]> {
    let mut targets = Vec::new();
    for (finger, key, height) in
        [(1, 24, 0.0), (1, 24, -0.015), (1, 26, -0.015), (0, 28, -0.02), (2, 25, -0.012), (1, 33, 0.01)]
    {
        targets.extend([over(world, finger, key, height).unwrap(); 6]);
    }
    targets.extend([bench::at_shares(&[0.9; DRIVEN_JOINTS]); 3]);
    targets.extend([bench::at_shares(&[0.2; DRIVEN_JOINTS]); 5]);
    targets
}

fn trace(start: &[f64], moments: &[Moment]) -> String {
    let mut text = String::new();
    for (torques, positions) in std::iter::once((&[0.0; DRIVEN_JOINTS], start))
        .chain(moments.iter().map(|m| (&m.torques, m.positions.as_slice())))
    {
        for value in torques.iter().chain(positions) {
            write!(text, "{value:e} ").unwrap();
        }
        text.push('\n');
    }
    text
}

#[test]
fn stock_mujoco_steps_the_exported_model_alike() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let python = std::env::var_os(PYTHON);
    for (name, config) in worlds() {
        let world = World::new(&config, &PhysicalParams::default()).unwrap();
        let mut replica = Replica::of(&world, |xml| xml);
        let start = replica.data.qpos().to_vec();
        let mut touches = 0;
        let mut moments = Vec::new();
        for targets in vigorous(&world) {
            moments.extend(replica.record(&[targets]));
            touches += usize::from(replica.data.ncon() > 0);
        }
        assert!(touches > 10, "{name}: the motion must touch keys, it did in {touches} control steps");
        let model_file = folder.join(format!("{name}.xml"));
        let trace_file = folder.join(format!("{name}.trace"));
        std::fs::write(&model_file, mjcf(&config, &PhysicalParams::default())).unwrap();
        std::fs::write(&trace_file, trace(&start, &moments)).unwrap();
        if let Some(python) = &python {
            let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scripts/check_model.py");
            let run = std::process::Command::new(python)
                .args([script.as_path(), &model_file, &trace_file])
                .output()
                .unwrap_or_else(|e| panic!("{PYTHON}={python:?} does not run: {e}"));
            let said = [run.stdout, run.stderr].concat();
            assert!(run.status.success(), "{name}: {}", String::from_utf8_lossy(&said));
            println!("{name}: {}", String::from_utf8_lossy(&said));
        }
    }
    if python.is_none() {
        // Not through a macro: the test harness would swallow it.
        let _ = writeln!(
            std::io::stderr(),
            "\n*** SKIPPED: exported models against stock MuJoCo. Set {PYTHON} to a Python with mujoco==3.17.0. ***\n"
        );
    }
}

proptest! {
    #![proptest_config(bench::cases(12))]
    #[test]
    fn the_world_is_its_exported_model_and_its_controllers(
        config in bench::config(),
        gestures in bench::gestures(),
    ) {
        // The replica has the controllers, not the interlock.
        let config = StageConfig { interlock: false, ..config };
        same_as_replica(&config, &PhysicalParams::default(), &gestures);
    }
}

fn same_as_replica(config: &StageConfig, params: &PhysicalParams, gestures: &[Gesture]) {
    let mut world = World::new(config, params).unwrap();
    let mut replica = Replica::of(&world, |xml| xml);
    for targets in all_targets(&world, gestures) {
        world.step(&targets);
        replica.record(&[targets]);
        assert_eq!(world.data().qpos(), replica.data.qpos());
        assert_eq!(world.data().qvel(), replica.data.qvel());
    }
}

#[test]
fn encoder_bias_and_delay_are_in_the_controllers_alone() {
    let mut params = PhysicalParams::default();
    params.set("joint.all.encoder_bias", 0.02).unwrap();
    params.set("joint.all.delay", 0.03).unwrap();
    let press = |key, height| Gesture::Reach { finger: 1, key, height, steps: 12 };
    same_as_replica(&StageConfig::default(), &params, &[press(24, -0.01), press(26, -0.01)]);
}
