//! Recovery of known parameters from the simulator's own recordings, with noise on its encoders.
//! The test fits one finger, `examples/recovery.rs` the whole hand.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use etude_identify::{
    Assessment, Commands, IdentifyConfig, LmConfig, MethodConfig, ParameterEstimate, PassEnd, RecordedMotion,
    Replayer, identify,
};
use etude_perform::{Excitation, Job, shaping_params};
use etude_robot::rig_file::RigConfig;
use etude_stage::params::JointRow;
use etude_stage::{DRIVEN_JOINTS, PhysicalParams, RAIL, Side, StageConfig};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

pub type Error = Box<dyn std::error::Error>;

/// Noise of the encoders, rad, and of the rail, m.
const NOISE: [f64; 2] = [2e-4, 5e-5];

/// The result of a recovery.
pub struct Recovery {
    /// The passes.
    pub passes: Vec<PassEnd>,
    /// Held-out errors by joint, in multiples of its noise: before the fit and after it.
    pub held_out: Vec<(String, [f64; 2])>,
    /// The identifiable parameters and their true values.
    pub numbers: Vec<(ParameterEstimate, f64)>,
}

impl Recovery {
    /// Median relative error of the identifiable parameters.
    pub fn median_error(&self) -> f64 {
        let mut errors: Vec<f64> =
            self.numbers.iter().map(|(found, truth)| (found.value / truth - 1.0).abs()).collect();
        errors.sort_by(f64::total_cmp);
        errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN)
    }

    /// Share of their 95 % intervals that cover the truth.
    pub fn coverage(&self) -> f64 {
        let covers = |(found, truth): &&(ParameterEstimate, f64)| {
            (found.interval[0]..=found.interval[1]).contains(truth)
        };
        self.numbers.iter().filter(covers).count() as f64 / self.numbers.len() as f64
    }
}

fn gauss(random: &mut Pcg64) -> f64 {
    let (a, b): (f64, f64) = (random.random(), random.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

/// Readings of a robot with these parameters whose joints follow a third of an excitation.
fn recorded(
    params: &PhysicalParams,
    joints: &[usize],
    (excitation, part): (Excitation, usize),
    seed: u64,
) -> Result<RecordedMotion, Error> {
    let mut random = Pcg64::seed_from_u64(seed);
    let all = excitation.targets(Side::Left);
    let count = all.len() / 3;
    let mut targets = all[part * count..(part + 1) * count].to_vec();
    let still = targets[0];
    for row in &mut targets {
        *row = std::array::from_fn(|joint| if joints.contains(&joint) { row[joint] } else { still[joint] });
    }
    let noise: [f64; DRIVEN_JOINTS] = std::array::from_fn(|joint| NOISE[usize::from(joint == RAIL)]);
    let mut motion = RecordedMotion {
        path: PathBuf::from(format!("synthetic-{seed}")),
        rig: RigConfig::default(),
        rig_label: "synthetic".to_string(),
        mode: "synthetic".to_string(),
        start: still,
        commands: Commands::Targets(targets),
        fingers: Vec::new(),
        pwm: Vec::new(),
        rail: Vec::new(),
        noise,
        moves: std::array::from_fn(|joint| joints.contains(&joint)),
        keys: Vec::new(),
    };
    let mut replayer = Replayer::new(&StageConfig::default())?;
    let trace = replayer.replay(params, &motion, false).ok_or("the simulation diverged")?;
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

/// Jerk limit of the synthetic robot's fingers, rad/s³, before its draw.
const FINGER_JERK: f64 = 60_000.0;

/// A robot whose parameters differ from the start of a fit.
pub fn truth(joints: &[usize], seed: u64) -> PhysicalParams {
    let mut random = Pcg64::seed_from_u64(seed);
    let start = shaping_params(&RigConfig::default().limits);
    let mut params = start.clone();
    for &joint in joints {
        if joint != RAIL {
            // The default is the acceleration limit within one physics step, which no recording can
            // show.
            params.set_joint(JointRow::JerkLimit, joint, FINGER_JERK);
        }
        let mut scale = |quantity: JointRow, most: f64| {
            let factor: f64 = random.random_range(1.0 / most..=most);
            params.set_joint(quantity, joint, params.joint(quantity, joint) * factor);
        };
        scale(JointRow::Stiffness, 1.3);
        if joint == RAIL {
            scale(JointRow::Damping, 1.3);
        }
        scale(JointRow::LowPass, 1.5);
        scale(JointRow::JerkLimit, 1.3);
        if joint != RAIL {
            scale(JointRow::Armature, 1.3);
            // One scale of torque for all that the joint loop commands.
            let torque = params.joint(JointRow::Stiffness, joint) / start.joint(JointRow::Stiffness, joint);
            for row in [JointRow::Damping, JointRow::TorqueLimit] {
                params.set_joint(row, joint, torque * start.joint(row, joint));
            }
        }
        let friction =
            if joint == RAIL { random.random_range(1.0..5.0) } else { random.random_range(0.004..0.02) };
        params.set_joint(JointRow::Friction, joint, friction);
        if joint != RAIL {
            params.set_joint(JointRow::Viscosity, joint, random.random_range(0.02..0.1));
            params.set_joint(JointRow::FrictionAtRest, joint, random.random_range(1.3..1.8));
            params.set_joint(JointRow::DeadBand, joint, random.random_range(0.003..0.012));
            params.set_joint(JointRow::Load, joint, random.random_range(-0.02..0.02));
        }
        params.set_joint(JointRow::Delay, joint, random.random_range(0.002..0.018));
    }
    params
}

/// Draws a robot, records motion of these joints, and fits.
pub fn recover(joints: &[usize], seed: u64) -> Result<Recovery, Error> {
    let truth = truth(joints, seed);
    recover_as(&truth, &truth, joints, seed)
}

/// Records motion of these joints of a robot, fits, and compares with what is expected of the fit.
pub fn recover_as(
    truth: &PhysicalParams,
    expected: &PhysicalParams,
    joints: &[usize],
    seed: u64,
) -> Result<Recovery, Error> {
    let parts = [(Excitation::OpenClose, 1), (Excitation::Chirp, 2), (Excitation::Rail, 1)];
    let told =
        |(excitation, _): &(Excitation, usize)| *excitation != Excitation::Rail || joints.contains(&RAIL);
    let motions: Vec<RecordedMotion> = parts
        .into_iter()
        .filter(told)
        .enumerate()
        .map(|(index, part)| recorded(truth, joints, part, 10 * seed + index as u64))
        .collect::<Result<_, _>>()?;
    let most = LmConfig::default().max_evaluations;
    let method = LmConfig { cost_tolerance: 1e-6, max_evaluations: most, ..LmConfig::for_replays() };
    let config = IdentifyConfig { method: MethodConfig::Lm(method), seed, start: BTreeMap::default() };
    let folder = tempfile::tempdir()?;
    let identified = identify(
        &motions,
        &config,
        &folder.path().join("state.json"),
        &mut Job::new(&mut |_| {}, &AtomicBool::new(false)),
    );
    let identified = identified?;
    let held_out = [recorded(truth, joints, (Excitation::HeldOut, 1), 10 * seed + 9)?];
    let before = shaping_params(&RigConfig::default().limits);
    let after = PhysicalParams::default().with(&identified.physics)?;
    let found = Assessment::new(&held_out, &before, &after)?;
    let errors = found.joints.into_iter();
    let numbers = identified.estimates.into_iter().flat_map(|(_, estimate)| estimate.parameters);
    let numbers = numbers.filter(|found| found.is_identifiable).map(|found| {
        let expected = expected.get(&found.path)?;
        Ok((found, expected))
    });
    Ok(Recovery {
        passes: identified.passes,
        held_out: errors.map(|e| (e.joint, [e.before / e.noise, e.after / e.noise])).collect(),
        numbers: numbers.collect::<Result<_, etude_stage::ParamError>>()?,
    })
}
