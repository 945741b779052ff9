//! Known numbers, recovered: recordings made by the simulator itself, with noise on its encoders. A measurement, not yet a
//! test: docs/identify.md says how far the fit is from passing it.
#![allow(clippy::print_stdout, reason = "printing is what it is for")]

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use etude_identify::{
    Assessment, Commands, IdentifyConfig, LmConfig, MethodConfig, Motion, Replayer, identify,
};
use etude_perform::{Excitation, shaping_params};
use etude_robot::rig::RigConfig;
use etude_stage::params::Joint;
use etude_stage::{JOINTS, PhysicalParams, RAIL, StageConfig};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

/// Noise of the encoders, rad, and of the rail, m.
const NOISE: [f64; 2] = [2e-4, 5e-5];

fn gauss(random: &mut Pcg64) -> f64 {
    let (a, b): (f64, f64) = (random.random(), random.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

/// What a robot with these numbers would have sent while it was moved by `targets`.
fn recorded(
    params: &PhysicalParams,
    targets: Vec<[f64; JOINTS]>,
    seed: u64,
) -> Result<Motion, Box<dyn std::error::Error>> {
    let mut random = Pcg64::seed_from_u64(seed);
    let noise: [f64; JOINTS] = std::array::from_fn(|joint| NOISE[usize::from(joint == RAIL)]);
    let mut motion = Motion {
        path: PathBuf::from(format!("synthetic-{seed}")),
        rig: RigConfig { name: "synthetic".to_string(), ..RigConfig::default() },
        mode: "synthetic".to_string(),
        start: targets[0],
        commands: Commands::Targets(targets),
        fingers: Vec::new(),
        rail: Vec::new(),
        noise,
        moves: [true; JOINTS],
        saturates: [false; JOINTS],
        keys: Vec::new(),
    };
    let mut replayer = Replayer::new(&StageConfig::default())?;
    let trace = replayer.replay(params, &motion, false).ok_or("the world diverged")?;
    let samples = (motion.secs() * 333.0) as usize;
    for sample in 1..samples {
        let at = sample as f64 / 333.0;
        let reading =
            |joint: usize, random: &mut Pcg64| trace.position(joint, at) + noise[joint] * gauss(random);
        motion.fingers.push((at, std::array::from_fn(|joint| reading(joint, &mut random))));
        if sample % 3 == 0 {
            let rail = reading(RAIL, &mut random);
            motion.rail.push((at, rail));
        }
    }
    Ok(motion)
}

/// A robot some way from the numbers with which a fit starts.
fn truth(seed: u64) -> PhysicalParams {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut params = shaping_params(&RigConfig::default().limits);
    for joint in 0..JOINTS {
        let mut scale = |quantity: Joint, most: f64| {
            let factor: f64 = random.random_range(1.0 / most..=most);
            params.set_joint(quantity, joint, params.joint(quantity, joint) * factor);
        };
        scale(Joint::Stiffness, 1.3);
        scale(Joint::Damping, 1.3);
        scale(Joint::LowPass, 1.5);
        scale(Joint::JerkLimit, 1.3);
        if joint != RAIL {
            scale(Joint::Armature, 1.3);
        }
        let friction =
            if joint == RAIL { random.random_range(1.0..5.0) } else { random.random_range(0.004..0.02) };
        params.set_joint(Joint::Friction, joint, friction);
        params.set_joint(Joint::Delay, joint, 0.005 * f64::from(random.random_range(1..4u8)));
    }
    params
}

fn third(excitation: Excitation, part: usize) -> Vec<[f64; JOINTS]> {
    let targets = excitation.targets();
    let count = targets.len() / 3;
    targets[part * count..(part + 1) * count].to_vec()
}

/// What a fit of known numbers comes to: `cargo run --release -p etude-identify --example recovery -- SEED`.
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let seed: u64 = std::env::args().nth(1).map_or(Ok(1), |text| text.parse())?;
    let (mut errors, mut covered) = (Vec::new(), 0);
    let truth = truth(seed);
    let motions: Vec<Motion> = [Excitation::OpenClose, Excitation::Chirp, Excitation::Rail]
        .into_iter()
        .enumerate()
        .map(|(index, excitation)| {
            recorded(&truth, third(excitation, index % 2 + 1), 10 * seed + index as u64)
        })
        .collect::<Result<_, _>>()?;
    let method = LmConfig {
        difference_step: 1e-4,
        first_difference_step: 1e-2,
        cost_tolerance: 1e-7,
        ..LmConfig::default()
    };
    let config = IdentifyConfig { method: MethodConfig::Lm(method), seed, start: BTreeMap::default() };
    let state = std::env::temp_dir().join(format!("recovery-{seed}-{}.json", std::process::id()));
    let identified = identify(&motions, &config, &state, &mut |_| {}, &AtomicBool::new(false))?;
    std::fs::remove_file(&state)?;
    let held_out = [recorded(&truth, third(Excitation::Held, 1), 10 * seed + 9)?];
    let before = shaping_params(&RigConfig::default().limits);
    let found = Assessment::new(&held_out, &before, &PhysicalParams::default().with(&identified.physics)?)?;
    for end in &identified.stages {
        let [before, after] = end.rms;
        println!(
            "{}: {before:.2} to {after:.2} after {} replays, {:.0} s",
            end.stage.name(),
            end.replays,
            end.secs
        );
    }
    println!("joint, held-out error over noise before the fit and after it");
    for joint in &found.joints {
        println!("{} {:.1} {:.2}", joint.joint, joint.before / joint.noise, joint.after / joint.noise);
    }
    println!("number, found, 95 % interval, true");
    for parameter in identified.estimates.iter().flat_map(|(_, estimate)| &estimate.parameters) {
        let true_value = truth.get(&parameter.path)?;
        if parameter.is_identifiable {
            let [low, high] = parameter.interval;
            covered += usize::from((low..=high).contains(&true_value));
            errors.push((parameter.value / true_value - 1.0).abs());
            println!("{} {:.6} {low:.6} {high:.6} {true_value:.6}", parameter.path, parameter.value);
        }
    }
    errors.sort_by(f64::total_cmp);
    let median = errors.get(errors.len() / 2).copied().unwrap_or_default();
    let coverage = f64::from(covered as u32) / errors.len() as f64;
    println!(
        "{} identifiable numbers, median error {median:.4}, covered by their intervals {coverage:.3}",
        errors.len()
    );
    Ok(())
}
