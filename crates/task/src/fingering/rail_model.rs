//! A model of the rail: its controller, the moved mass and the damping.
//!
//! The rail is slow (a movement by one key takes a fifth of a second), the fingers are fast. So
//! fingers turn to compensate the movement of the rail, whose position this model predicts to a
//! fraction of a millimetre.

use etude_music::CONTROL_HZ;
use etude_stage::controller::{Actuation, Controller, ControllerConstants};
use etude_stage::geometry::HALF_WIDTH;
use etude_stage::hand::{LINK_MASSES, PALM_MASS, THUMB_MASS};
use etude_stage::params::{JointRow, WorldRow};
use etude_stage::{FINGERS, PHYSICS_STEPS, PhysicalParams, RAIL, StageConfig};

/// Control steps by which the rail starts to move before the release of the note that it leaves.
const EARLY_STEPS: usize = 2;
/// Length of the table of response times, control steps.
const MAX_STEPS: usize = 60;
/// Shortest move in the table, m; each further one is twice the one before.
const MIN_MOVE_M: f64 = 0.005;
const MOVES: usize = 9;
/// A move counts as finished at this fraction; the lateral reach of the fingers covers the rest.
const SETTLED: f64 = 0.97;
/// Time of one control step, s.
pub(crate) const CONTROL_SECS: f64 = 1.0 / CONTROL_HZ;

/// A model of the rail alone.
pub(crate) struct RailModel {
    gains: ControllerConstants,
    mass_kg: f64,
    damping: f64,
    step_secs: f64,
    /// Position of the rail after each control step of a move by `MIN_MOVE_M`·2ⁱ, as a fraction of
    /// the move.
    responses: Vec<Vec<f64>>,
    /// Control steps by which a target that leaves a key is given before its release:
    /// [`EARLY_STEPS`] and the rail's delay, rounded.
    pub early_steps: usize,
    /// Position of the rail when an episode begins, m.
    pub start: f64,
}

impl RailModel {
    pub(crate) fn new(stage: &StageConfig, params: &PhysicalParams) -> Self {
        let joint = |quantity| params.joint(quantity, RAIL);
        let fingers = LINK_MASSES.iter().sum::<f64>() * FINGERS as f64;
        let passive = match stage.actuation {
            Actuation::Controlled => 0.0,
            Actuation::Position => joint(JointRow::Damping),
        };
        let mut rail = Self {
            gains: ControllerConstants::new(params, RAIL, stage.actuation, stage.physics_step_secs()),
            mass_kg: joint(JointRow::Armature) + PALM_MASS + THUMB_MASS + fingers,
            damping: joint(JointRow::Viscosity) + passive,
            step_secs: stage.physics_step_secs(),
            responses: Vec::new(),
            early_steps: EARLY_STEPS + (joint(JointRow::Delay) / CONTROL_SECS).round() as usize,
            start: params.world(WorldRow::HandStart).clamp(-HALF_WIDTH, HALF_WIDTH),
        };
        rail.responses = (0..MOVES)
            .map(|doubling| {
                let distance = MIN_MOVE_M * f64::from(1u32 << doubling);
                let path = rail.follow(0.0, &[distance; MAX_STEPS]);
                path.iter().step_by(PHYSICS_STEPS).map(|position| position / distance).collect()
            })
            .collect();
        rail
    }

    /// Position of the rail, m: at the start, then after every physics step under one target a
    /// control step.
    pub(crate) fn follow(&self, start: f64, targets: &[f64]) -> Vec<f64> {
        let mut controller = Controller::at_rest(self.gains.measured(start));
        let (mut position, mut velocity) = (start, 0.0);
        let mut path = Vec::with_capacity(targets.len() * PHYSICS_STEPS + 1);
        path.push(position);
        for target in targets.iter().flat_map(|target| std::iter::repeat_n(*target, PHYSICS_STEPS)) {
            let target = self.gains.measured(target);
            let force = controller.step(&self.gains, target, self.gains.measured(position), velocity);
            // Damping is taken implicitly, as MuJoCo's Euler step does.
            velocity = (velocity + force / self.mass_kg * self.step_secs)
                / (1.0 + self.damping / self.mass_kg * self.step_secs);
            position += velocity * self.step_secs;
            path.push(position);
        }
        path
    }

    /// Control steps from the target until the rail has moved by `needed` of a move by `distance`,
    /// both in m and positive.
    pub(crate) fn steps_to(&self, distance: f64, needed: f64) -> usize {
        if needed <= 0.0 {
            return 0;
        }
        let row = (distance / MIN_MOVE_M).log2().ceil().clamp(0.0, (MOVES - 1) as f64) as usize;
        let fraction = (needed / distance).min(SETTLED);
        self.responses[row].iter().position(|moved| *moved >= fraction).unwrap_or(MAX_STEPS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use etude_stage::World;

    #[test]
    fn the_rail_does_what_is_predicted() {
        let (config, params) = (StageConfig::default(), PhysicalParams::default());
        let rail = RailModel::new(&config, &params);
        let targets: Vec<f64> = (0..40).map(|step| if step < 12 { 0.07 } else { -0.03 }).collect();
        let path = rail.follow(rail.start, &targets);
        let mut world = World::new(&config, &params).unwrap();
        let mut joints = world.start_pose();
        for (step, target) in targets.iter().enumerate() {
            joints[RAIL] = *target;
            world.step(&joints);
            let error = world.joints()[RAIL] - path[(step + 1) * PHYSICS_STEPS];
            assert!(error.abs() < 1e-3, "{error} m at step {step}");
        }
    }

    #[test]
    fn a_longer_move_takes_longer() {
        let rail = RailModel::new(&StageConfig::default(), &PhysicalParams::default());
        assert_eq!(rail.steps_to(0.02, 0.0), 0);
        let steps: Vec<_> = [0.005, 0.02, 0.08, 0.3].iter().map(|d| rail.steps_to(*d, d - 0.003)).collect();
        assert!(steps.is_sorted() && steps[0] > 0 && steps[3] < MAX_STEPS, "{steps:?}");
    }
}
