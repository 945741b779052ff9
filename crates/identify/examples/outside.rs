//! One identification problem for two solvers: this crate's and MuJoCo's own toolbox, which `scripts/check_sysid.py` asks.
//!
//! The problem is one that stock MuJoCo can express to the last digit. What a joint's controller refers to depends on its
//! targets alone, so that a joint is MuJoCo's position actuator between the same limits of force, driven by those references
//! once a physics step; and all readings are taken at the ends of physics steps, where nobody has to interpolate.
#![allow(clippy::print_stdout, reason = "printing is what it is for")]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use etude_identify::{
    Block, Candidate, Commands, Estimate, Evaluation, Fit, JacobianPlan, LmConfig, Loss, MethodConfig,
    Motion, Parameter, Problem, Replayer, Scale, Space, Trace,
};
use etude_perform::{Excitation, shaping_params};
use etude_robot::rig::RigConfig;
use etude_stage::controller::{Controller, Gains};
use etude_stage::hand::FINGER_JOINTS;
use etude_stage::params::Joint;
use etude_stage::{Actuation, JOINT_NAMES, JOINTS, PHYSICS_STEPS, PhysicalParams, StageConfig, joint_range};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde_json::{Value, json};

/// Noise of the encoders, rad.
const NOISE_RAD: f64 = 2e-4;
/// Joints that are fitted: those of the first finger.
const FITTED: std::ops::Range<usize> = 0..FINGER_JOINTS;
/// Numbers of each that are fitted.
const QUANTITIES: [Joint; 4] = [Joint::Stiffness, Joint::Damping, Joint::Armature, Joint::Friction];
/// Dry friction about which the true one is drawn, N·m; the simulator's own is none.
const FRICTION_NM: f64 = 0.01;
/// Most friction that is looked for, N·m (`rows.rs`, as the other bounds).
const MOST_FRICTION_NM: f64 = 0.08;
/// How many times off the nominal numbers the true ones are at most.
const TRUTH: f64 = 1.3;
/// How many times off the true ones the start may be: within the bounds.
const FARTHEST: f64 = 3.0;
/// Most of a joint's momentum that its damping takes in a physics step, as a share: beyond 2 the joint only chatters.
const MOST_TAKEN: f64 = 1.5;
/// Step of the differences that intervals come from, as a share of each range.
const ESTIMATE_STEP: f64 = 1e-4;

type Fallible<T> = Result<T, Box<dyn std::error::Error>>;

fn gauss(random: &mut Pcg64) -> f64 {
    let (a, b): (f64, f64) = (random.random(), random.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

/// The simulator's numbers; those that are fitted lie about them.
fn nominal() -> PhysicalParams {
    let mut params = shaping_params(&RigConfig::default().limits);
    FITTED.for_each(|joint| params.set_joint(Joint::Friction, joint, FRICTION_NM));
    params
}

/// Numbers up to `times` off those of `params`, either way, of joints that physics steps of this length can simulate.
fn off(params: &PhysicalParams, times: f64, random: &mut Pcg64) -> PhysicalParams {
    let mut params = params.clone();
    for joint in FITTED {
        let middle = QUANTITIES.map(|quantity| params.joint(quantity, joint));
        loop {
            for (quantity, middle) in QUANTITIES.into_iter().zip(middle) {
                params.set_joint(quantity, joint, middle * times.powf(random.random_range(-1.0..=1.0)));
            }
            let taken = params.joint(Joint::Damping, joint) * StageConfig::default().physics_step_secs();
            if taken < MOST_TAKEN * params.joint(Joint::Armature, joint) {
                break;
            }
        }
    }
    params
}

fn path(quantity: Joint, joint: usize) -> String {
    format!("joint.{}.{}", JOINT_NAMES[joint], quantity.row().name)
}

fn parameters(start: &PhysicalParams) -> Vec<Parameter> {
    let nominal = nominal();
    let parameter = |quantity: Joint, joint: usize| {
        let (path, middle) = (path(quantity, joint), nominal.joint(quantity, joint));
        let start = start.joint(quantity, joint);
        let factor = match quantity {
            Joint::Friction => return Parameter::new(&path, 0.0, MOST_FRICTION_NM, start),
            Joint::Stiffness => 5.0,
            _ => 8.0,
        };
        Parameter::new(&path, middle / factor, middle * factor, start).logarithmic()
    };
    FITTED.flat_map(|joint| QUANTITIES.map(|quantity| parameter(quantity, joint))).collect()
}

/// What a robot with these numbers does while it is moved by a third of an excitation, without noise.
fn recorded(params: &PhysicalParams, excitation: Excitation, third: usize) -> Fallible<Motion> {
    let targets = excitation.targets();
    let count = targets.len() / 3;
    let targets = targets[third * count..(third + 1) * count].to_vec();
    let mut motion = Motion {
        path: PathBuf::from(excitation.name()),
        rig: RigConfig::default(),
        mode: "synthetic".to_string(),
        start: targets[0],
        commands: Commands::Targets(targets),
        fingers: Vec::new(),
        rail: Vec::new(),
        noise: [NOISE_RAD; JOINTS],
        moves: [true; JOINTS],
        saturates: [false; JOINTS],
        keys: Vec::new(),
    };
    let stage = StageConfig::default();
    let trace = Replayer::new(&stage)?.replay(params, &motion, false).ok_or("the true world diverged")?;
    motion.fingers = (1..=motion.commands.steps() * PHYSICS_STEPS)
        .map(|step| {
            let secs = step as f64 * stage.physics_step_secs();
            (secs, std::array::from_fn(|joint| trace.position(joint, secs)))
        })
        .collect();
    Ok(motion)
}

fn noisy(motion: &Motion, random: &mut Pcg64) -> Motion {
    let mut motion = motion.clone();
    motion
        .fingers
        .iter_mut()
        .flat_map(|(_, angles)| angles)
        .for_each(|angle| *angle += NOISE_RAD * gauss(random));
    motion
}

/// What the joints are drawn to at each physics step of a motion: rad, the rail in m.
fn references(params: &PhysicalParams, motion: &Motion) -> Fallible<Vec<[f64; JOINTS]>> {
    let Commands::Targets(targets) = &motion.commands else { return Err("a motion without targets".into()) };
    let step_secs = StageConfig::default().physics_step_secs();
    let gains = std::array::from_fn::<_, JOINTS, _>(|joint| {
        Gains::new(params, joint, Actuation::Controlled, step_secs)
    });
    let mut controllers = motion.start.map(Controller::at_rest);
    let mut follow = |targets: &[f64; JOINTS]| -> [f64; JOINTS] {
        std::array::from_fn(|joint| {
            let [low, high] = joint_range(joint);
            controllers[joint].follow(&gains[joint], targets[joint].clamp(low, high))
        })
    };
    Ok(targets
        .iter()
        .flat_map(|targets| std::iter::repeat_n(targets, PHYSICS_STEPS))
        .map(&mut follow)
        .collect())
}

/// The model with position actuators in the place of the motors.
fn model(params: &PhysicalParams) -> Fallible<String> {
    let text = etude_stage::mjcf(&StageConfig::default(), params);
    let (before, after) = text.split_once("<actuator>").ok_or("the model has no actuators")?;
    let (_, after) = after.split_once("</actuator>").ok_or("the model's actuators do not end")?;
    let mut model = format!("{before}<actuator>\n");
    for (joint, name) in JOINT_NAMES.iter().enumerate() {
        let [stiffness, damping, limit] =
            [Joint::Stiffness, Joint::Damping, Joint::TorqueLimit].map(|row| params.joint(row, joint));
        writeln!(
            model,
            r#"    <position name="{name}" joint="{name}" kp="{stiffness}" kv="{damping}" forcerange="-{limit} {limit}"/>"#
        )?;
    }
    Ok(model + "  </actuator>" + after)
}

/// The problem as this crate sees it, and how it is evaluated.
struct Posed {
    start: PhysicalParams,
    motions: Vec<Motion>,
    problem: Problem,
}

impl Posed {
    fn new(start: PhysicalParams, motions: Vec<Motion>) -> Fallible<Self> {
        let blocks = motions.iter().flat_map(|motion| {
            let name = |joint: usize| format!("{}.{}", motion.path.display(), JOINT_NAMES[joint]);
            FITTED.map(move |joint| Block::new(&name(joint), motion.fingers.len()))
        });
        let problem = Problem::new(Space::new(parameters(&start))?, blocks.collect(), Loss::Squared)?;
        Ok(Self { start, motions, problem })
    }

    fn evaluate(&self, candidates: &[Candidate]) -> Fallible<Vec<Evaluation>> {
        let worlds = candidates.iter().map(|candidate| {
            let mut world = self.start.clone();
            for (parameter, value) in self.problem.space().parameters().iter().zip(&candidate.values) {
                world.set(&parameter.path, *value)?;
            }
            Ok(world)
        });
        let worlds: Vec<PhysicalParams> = worlds.collect::<Fallible<_>>()?;
        let stage = StageConfig::default();
        let evaluations: Vec<Option<Evaluation>> = worlds
            .par_iter()
            .map_init(
                || Replayer::new(&stage),
                |replayer, world| Some(self.replayed(replayer.as_mut().ok()?, world)),
            )
            .collect();
        Ok(evaluations.into_iter().collect::<Option<_>>().ok_or("the world cannot be built")?)
    }

    fn replayed(&self, replayer: &mut Replayer, world: &PhysicalParams) -> Evaluation {
        let traces = self.motions.iter().map(|motion| replayer.replay(world, motion, false));
        let Some(traces) = traces.collect::<Option<Vec<Trace>>>() else {
            return Evaluation::Failed("the world diverged".to_string());
        };
        let errors = self.motions.iter().zip(&traces).flat_map(|(motion, trace)| {
            FITTED.flat_map(move |joint| trace.errors(motion, joint).map(|error| error / NOISE_RAD))
        });
        Evaluation::Residuals(errors.collect())
    }

    /// Fits, judges, and says what came of it.
    fn answer(&self) -> Fallible<Value> {
        // No contact and no drive at its limit: slopes may be measured as closely as the solver is exact. The first step
        // is held short, since damping and armature that cannot be simulated are near.
        let config = LmConfig { difference_step: 1e-6, initial_damping: 10.0, ..LmConfig::default() };
        let begun = Instant::now();
        let mut fit = Fit::new(self.problem.clone(), &MethodConfig::Lm(config), 0)?;
        while fit.finished().is_none() {
            let candidates = fit.ask();
            fit.tell(&self.evaluate(&candidates)?)?;
        }
        let secs = begun.elapsed().as_secs_f64();
        let best = fit.best().ok_or("no world could be simulated; choose another seed")?;
        let plan = JacobianPlan::new(&self.problem, &best.point, ESTIMATE_STEP);
        let linear = plan.finish(&self.problem, &self.evaluate(&plan.candidates(&self.problem))?)?;
        let estimate = Estimate::new(&self.problem, &linear)?;
        Ok(json!({
            "values": best.values,
            "intervals": estimate.parameters.iter().map(|parameter| parameter.interval).collect::<Vec<_>>(),
            "standard_errors": estimate.parameters.iter().map(|p| p.standard_error).collect::<Vec<_>>(),
            "evaluations": fit.evaluations(),
            "failures": fit.failures(),
            "secs": secs,
            "secs_with_intervals": begun.elapsed().as_secs_f64(),
            "threads": rayon::current_num_threads(),
            "cost": best.cost,
            "ended": fit.finished().map(|reason| reason.to_string()),
        }))
    }

    /// The problem as stock MuJoCo can be given it; `clean` are the motions without noise.
    fn exported(&self, truth: &PhysicalParams, clean: &[Motion]) -> Fallible<Value> {
        let parameters = FITTED.flat_map(|joint| QUANTITIES.map(|quantity| (joint, quantity)));
        let parameters = parameters.zip(self.problem.space().parameters()).map(|((joint, quantity), p)| {
            json!({
                "joint": JOINT_NAMES[joint], "quantity": quantity.row().name, "unit": quantity.row().unit,
                "low": p.low, "high": p.high, "start": p.start, "truth": truth.joint(quantity, joint),
                "logarithmic": p.scale == Scale::Logarithmic,
            })
        });
        let fitted = |motion: &Motion| -> Vec<Vec<f64>> {
            motion.fingers.iter().map(|(_, angles)| angles[FITTED].to_vec()).collect()
        };
        let motions = self.motions.iter().zip(clean).map(|(motion, clean)| {
            Ok(json!({
                "name": motion.path, "start": motion.start, "references": references(&self.start, motion)?,
                "times_secs": motion.fingers.iter().map(|(secs, _)| *secs).collect::<Vec<_>>(),
                "readings": fitted(motion), "noise_free": fitted(clean),
            }))
        });
        Ok(json!({
            "mujoco": etude_stage::mujoco_version(),
            "step_secs": StageConfig::default().physics_step_secs(),
            "noise_rad": NOISE_RAD,
            "joints": JOINT_NAMES,
            "fitted": JOINT_NAMES[FITTED],
            "parameters": parameters.collect::<Vec<_>>(),
            "motions": motions.collect::<Fallible<Vec<_>>>()?,
        }))
    }
}

/// Writes the problem, the model and our answer into a folder, made if need be:
/// `cargo run --release -p etude-identify --example outside -- FOLDER [SEED [TIMES]]`. The fit starts up to TIMES off the
/// true numbers (1.3 if not given).
fn main() -> Fallible<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let folder =
        Path::new(arguments.first().ok_or("say which folder to write to: outside FOLDER [SEED [TIMES]]")?);
    let seed: u64 = arguments.get(1).map_or(Ok(1), |text| text.parse())?;
    let times: f64 = arguments.get(2).map_or(Ok(TRUTH), |text| text.parse())?;
    if !(1.0..=FARTHEST).contains(&times) {
        return Err(format!("TIMES is {times}, and must lie in 1 … {FARTHEST}").into());
    }
    let mut random = Pcg64::seed_from_u64(seed);
    let truth = off(&nominal(), TRUTH, &mut random);
    let clean = vec![recorded(&truth, Excitation::OpenClose, 0)?, recorded(&truth, Excitation::Chirp, 1)?];
    let motions = clean.iter().map(|motion| noisy(motion, &mut random)).collect();
    let start = off(&truth, times, &mut random);
    let posed = Posed::new(start, motions)?;
    std::fs::create_dir_all(folder)?;
    std::fs::write(folder.join("model.xml"), model(&posed.start)?)?;
    std::fs::write(folder.join("problem.json"), posed.exported(&truth, &clean)?.to_string())?;
    let answer = posed.answer()?;
    std::fs::write(folder.join("answer.json"), answer.to_string())?;
    println!("{} readings, {} numbers: {answer}", posed.problem.samples(), posed.problem.space().len());
    Ok(())
}
