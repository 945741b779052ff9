//! One identification problem for two solvers: this crate's, and MuJoCo's own toolbox
//! (`scripts/check_sysid.py`).
//!
//! Stock MuJoCo can express the problem exactly. A joint's set-points depend on its targets alone,
//! so a joint is MuJoCo's position actuator with the same force limits, driven by those set-points
//! once a physics step. All readings are at the ends of physics steps, so no interpolation is
//! needed.
#![allow(clippy::print_stdout, reason = "printing is what it is for")]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use etude_identify::{
    Block, Candidate, Commands, Estimate, Evaluation, Fit, JacobianPlan, LmConfig, Loss, MethodConfig,
    Parameter, Problem, RecordedMotion, Replayer, Scale, Space, Trace,
};
use etude_perform::{Excitation, shaping_params};
use etude_robot::rig_file::RigConfig;
use etude_stage::controller::{Controller, ControllerConstants};
use etude_stage::hand::JOINTS_PER_FINGER;
use etude_stage::params::JointRow;
use etude_stage::{
    Actuation, DRIVEN_JOINTS, JOINT_NAMES, PHYSICS_STEPS, PhysicalParams, Side, StageConfig, joint_range,
};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde_json::{Value, json};

/// Noise of the encoders, rad.
const NOISE_RAD: f64 = 2e-4;
/// Joints that are fitted: those of the first finger.
const FITTED: std::ops::Range<usize> = 0..JOINTS_PER_FINGER;
/// Fitted parameters of each.
const QUANTITIES: [JointRow; 4] =
    [JointRow::Stiffness, JointRow::Damping, JointRow::Armature, JointRow::Friction];
/// Centre of the true dry friction, N·m; the simulator's default is zero.
const FRICTION_NM: f64 = 0.01;
/// Upper bound of friction, N·m (as in `rows.rs`).
const MOST_FRICTION_NM: f64 = 0.08;
/// Largest factor between the true and the nominal parameters.
const TRUTH: f64 = 1.3;
/// Largest factor between the start and the true parameters; within the bounds.
const FARTHEST: f64 = 3.0;
/// Largest share of a joint's momentum that its damping removes in a physics step. Beyond 2 the
/// simulation oscillates.
const MOST_TAKEN: f64 = 1.5;
/// Step of the differences for the intervals, as a share of each range.
const ESTIMATE_STEP: f64 = 1e-4;

type Fallible<T> = Result<T, Box<dyn std::error::Error>>;

fn gauss(random: &mut Pcg64) -> f64 {
    let (a, b): (f64, f64) = (random.random(), random.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

/// The simulator's default parameters, and friction.
fn nominal() -> PhysicalParams {
    let mut params = shaping_params(&RigConfig::default().limits);
    FITTED.for_each(|joint| params.set_joint(JointRow::Friction, joint, FRICTION_NM));
    params
}

/// Parameters up to a factor `times` from `params`, of joints that can be simulated with this
/// physics step.
fn off(params: &PhysicalParams, times: f64, random: &mut Pcg64) -> PhysicalParams {
    let mut params = params.clone();
    for joint in FITTED {
        let middle = QUANTITIES.map(|quantity| params.joint(quantity, joint));
        loop {
            for (quantity, middle) in QUANTITIES.into_iter().zip(middle) {
                params.set_joint(quantity, joint, middle * times.powf(random.random_range(-1.0..=1.0)));
            }
            let taken = params.joint(JointRow::Damping, joint) * StageConfig::default().physics_step_secs();
            if taken < MOST_TAKEN * params.joint(JointRow::Armature, joint) {
                break;
            }
        }
    }
    params
}

fn path(quantity: JointRow, joint: usize) -> String {
    format!("joint.{}.{}", JOINT_NAMES[joint], quantity.row().name)
}

fn parameters(start: &PhysicalParams) -> Vec<Parameter> {
    let nominal = nominal();
    let parameter = |quantity: JointRow, joint: usize| {
        let (path, middle) = (path(quantity, joint), nominal.joint(quantity, joint));
        let start = start.joint(quantity, joint);
        let factor = match quantity {
            JointRow::Friction => return Parameter::new(&path, 0.0, MOST_FRICTION_NM, start),
            JointRow::Stiffness => 5.0,
            _ => 8.0,
        };
        Parameter::new(&path, middle / factor, middle * factor, start).logarithmic()
    };
    FITTED.flat_map(|joint| QUANTITIES.map(|quantity| parameter(quantity, joint))).collect()
}

/// Motion of a robot with these parameters in a third of an excitation, without noise.
fn recorded(params: &PhysicalParams, excitation: Excitation, third: usize) -> Fallible<RecordedMotion> {
    let targets = excitation.targets(Side::Left);
    let count = targets.len() / 3;
    let targets = targets[third * count..(third + 1) * count].to_vec();
    let mut motion = RecordedMotion {
        path: PathBuf::from(excitation.name()),
        rig: RigConfig::default(),
        rig_label: String::new(),
        mode: "synthetic".to_string(),
        start: targets[0],
        commands: Commands::Targets(targets),
        fingers: Vec::new(),
        pwm: Vec::new(),
        rail: Vec::new(),
        noise: [NOISE_RAD; DRIVEN_JOINTS],
        moves: [true; DRIVEN_JOINTS],
        keys: Vec::new(),
    };
    let stage = StageConfig::default();
    let trace =
        Replayer::new(&stage)?.replay(params, &motion, false).ok_or("the true simulation diverged")?;
    motion.fingers = (1..=motion.commands.steps() * PHYSICS_STEPS)
        .map(|step| {
            let secs = step as f64 * stage.physics_step_secs();
            (secs, std::array::from_fn(|joint| trace.position(joint, secs)))
        })
        .collect();
    Ok(motion)
}

fn noisy(motion: &RecordedMotion, random: &mut Pcg64) -> RecordedMotion {
    let mut motion = motion.clone();
    motion
        .fingers
        .iter_mut()
        .flat_map(|(_, angles)| angles)
        .for_each(|angle| *angle += NOISE_RAD * gauss(random));
    motion
}

/// Set-points of the joints at each physics step of a motion: rad, the rail in m.
fn set_points(params: &PhysicalParams, motion: &RecordedMotion) -> Fallible<Vec<[f64; DRIVEN_JOINTS]>> {
    let Commands::Targets(targets) = &motion.commands else { return Err("a motion without targets".into()) };
    let step_secs = StageConfig::default().physics_step_secs();
    let gains = std::array::from_fn::<_, DRIVEN_JOINTS, _>(|joint| {
        ControllerConstants::new(params, joint, Actuation::Controlled, step_secs)
    });
    let mut controllers = motion.start.map(Controller::at_rest);
    let mut step = |targets: &[f64; DRIVEN_JOINTS]| -> [f64; DRIVEN_JOINTS] {
        std::array::from_fn(|joint| {
            let [low, high] = joint_range(joint);
            controllers[joint].step_set_point(&gains[joint], targets[joint].clamp(low, high))
        })
    };
    Ok(targets
        .iter()
        .flat_map(|targets| std::iter::repeat_n(targets, PHYSICS_STEPS))
        .map(&mut step)
        .collect())
}

/// The model with position actuators instead of motors.
fn model(params: &PhysicalParams) -> Fallible<String> {
    let text = etude_stage::mjcf(&StageConfig::default(), params);
    let (before, after) = text.split_once("<actuator>").ok_or("the model has no actuators")?;
    let (_, after) = after.split_once("</actuator>").ok_or("the model's actuators do not end")?;
    let mut model = format!("{before}<actuator>\n");
    for (joint, name) in JOINT_NAMES.iter().enumerate() {
        let [stiffness, damping, limit] = [JointRow::Stiffness, JointRow::Damping, JointRow::TorqueLimit]
            .map(|row| params.joint(row, joint));
        writeln!(
            model,
            r#"    <position name="{name}" joint="{name}" kp="{stiffness}" kv="{damping}" forcerange="-{limit} {limit}"/>"#
        )?;
    }
    Ok(model + "  </actuator>" + after)
}

/// The problem for this crate, and its evaluation.
struct Posed {
    start: PhysicalParams,
    motions: Vec<RecordedMotion>,
    problem: Problem,
}

impl Posed {
    fn new(start: PhysicalParams, motions: Vec<RecordedMotion>) -> Fallible<Self> {
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
        let traces = traces.collect::<Option<Vec<Trace>>>()?;
        let errors = self.motions.iter().zip(&traces).flat_map(|(motion, trace)| {
            FITTED.flat_map(move |joint| trace.errors(motion, joint).map(|error| error / NOISE_RAD))
        });
        Some(errors.collect())
    }

    /// Fits, and returns the result with its uncertainty.
    fn answer(&self) -> Fallible<Value> {
        // There is no contact and no drive at its limit, so small differences are exact. The first
        // step is short, because damping and armature that cannot be simulated are near.
        let config = LmConfig { difference_step: 1e-6, initial_damping: 10.0, ..LmConfig::default() };
        let begun = Instant::now();
        let mut fit = Fit::new(self.problem.clone(), &MethodConfig::Lm(config), 0)?;
        while fit.finished().is_none() {
            let candidates = fit.ask();
            fit.tell(&self.evaluate(&candidates)?)?;
        }
        let secs = begun.elapsed().as_secs_f64();
        let best = fit.best().ok_or("every simulation failed; choose another seed")?;
        let plan = JacobianPlan::new(&self.problem, &best.point, ESTIMATE_STEP);
        let linear = plan.finish(&self.problem, &self.evaluate(&plan.candidates(&self.problem))?)?;
        let estimate = Estimate::new(&self.problem, &linear)?;
        Ok(json!({
            "values": best.values,
            "intervals": estimate.parameters.iter().map(|parameter| parameter.interval).collect::<Vec<_>>(),
            "standard_errors": estimate.parameters.iter().map(|p| p.standard_error).collect::<Vec<_>>(),
            "evaluations": fit.evaluations(),
            "secs": secs,
            "secs_with_intervals": begun.elapsed().as_secs_f64(),
            "threads": rayon::current_num_threads(),
            "cost": best.cost,
            "ended": fit.finished().map(|reason| format!("{reason:?}")),
        }))
    }

    /// The problem for stock MuJoCo; `clean` are the motions without noise.
    fn exported(&self, truth: &PhysicalParams, clean: &[RecordedMotion]) -> Fallible<Value> {
        let parameters = FITTED.flat_map(|joint| QUANTITIES.map(|quantity| (joint, quantity)));
        let parameters = parameters.zip(self.problem.space().parameters()).map(|((joint, quantity), p)| {
            json!({
                "joint": JOINT_NAMES[joint], "quantity": quantity.row().name, "unit": quantity.row().unit,
                "low": p.low, "high": p.high, "start": p.start, "truth": truth.joint(quantity, joint),
                "logarithmic": p.scale == Scale::Logarithmic,
            })
        });
        let fitted = |motion: &RecordedMotion| -> Vec<Vec<f64>> {
            motion.fingers.iter().map(|(_, angles)| angles[FITTED].to_vec()).collect()
        };
        let motions = self.motions.iter().zip(clean).map(|(motion, clean)| {
            Ok(json!({
                "name": motion.path, "start": motion.start, "references": set_points(&self.start, motion)?,
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

/// Writes the problem, the model and our answer into a folder: `cargo run --release -p
/// etude-identify --example outside -- FOLDER [SEED [TIMES]]`. The fit starts up to a factor TIMES
/// (default 1.3) from the true parameters.
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
