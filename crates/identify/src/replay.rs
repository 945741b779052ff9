//! Replays a robot's commands in a simulation with given parameters.

use etude_music::KEY_COUNT;
use etude_stage::{DRIVEN_JOINTS, PHYSICS_STEPS, PhysicalParams, RAIL, StageConfig, StageError, World};

use crate::motion::{Commands, RecordedMotion};

/// The simulation has diverged if a joint's position is larger, rad or m.
const DIVERGED: f64 = 10.0;

/// A simulation that replays motions, one after the other.
pub struct Replayer {
    world: World,
    step_secs: f64,
}

/// Readings of the joints' encoders: one before the first physics step and one after each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace {
    step_secs: f64,
    positions: Vec<[f64; DRIVEN_JOINTS]>,
    velocities: Vec<[f64; DRIVEN_JOINTS]>,
    /// Travel of each key, if requested.
    travel: Vec<[f32; KEY_COUNT]>,
}

impl Replayer {
    /// A replayer of motions of this hand.
    ///
    /// # Errors
    /// If the simulation cannot be built.
    pub fn new(stage: &StageConfig) -> Result<Self, StageError> {
        let world = World::new(stage, &PhysicalParams::default())?;
        Ok(Self { world, step_secs: stage.physics_step_secs() })
    }

    /// Replays a motion with these parameters; `keys` records the travel of the keys too. `None` if
    /// the simulation diverges. An excitation that stays in the air is replayed without contacts.
    pub fn replay(&mut self, params: &PhysicalParams, motion: &RecordedMotion, keys: bool) -> Option<Trace> {
        let world = &mut self.world;
        world.set_params(params);
        world.set_contacts(!motion.is_in_the_air());
        let zero = encoder_biases(params);
        world.reset_to(&std::array::from_fn(|joint| motion.start[joint] - zero[joint]));
        let steps = motion.commands.steps();
        let mut trace = Trace { step_secs: self.step_secs, ..Trace::default() };
        trace.positions.reserve(steps * PHYSICS_STEPS + 1);
        trace.velocities.reserve(steps * PHYSICS_STEPS + 1);
        trace.take(world, keys);
        for step in 0..steps {
            let mut sound = true;
            let watch = |world: &World| {
                trace.take(world, keys);
                sound &= trace.positions.last().is_some_and(|q| q.iter().all(|q| q.abs() < DIVERGED));
            };
            match &motion.commands {
                Commands::Targets(targets) => world.step_watched(&targets[step], watch),
                Commands::SetPoints(points) => world.track_watched(&points[step], watch),
            };
            if !sound {
                return None;
            }
        }
        Some(trace)
    }
}

/// The encoders' readings at the joints' zero.
fn encoder_biases(params: &PhysicalParams) -> [f64; DRIVEN_JOINTS] {
    std::array::from_fn(|joint| params.joint(etude_stage::params::JointRow::EncoderBias, joint))
}

impl Trace {
    fn take(&mut self, world: &World, keys: bool) {
        self.positions.push(world.joints());
        self.velocities.push(world.joint_velocities());
        if keys {
            self.travel.push(std::array::from_fn(|key| world.key_travel(key) as f32));
        }
    }

    /// Position of a joint at `secs`, interpolated between physics steps by a cubic through
    /// positions and velocities.
    pub fn position(&self, joint: usize, secs: f64) -> f64 {
        let Some(last) = self.positions.len().checked_sub(1) else { return f64::NAN };
        let position = (secs / self.step_secs).clamp(0.0, last as f64);
        let index = (position as usize).min(last.saturating_sub(1));
        let next = (index + 1).min(last);
        let share = position - index as f64;
        let [from, to] = [self.positions[index][joint], self.positions[next][joint]];
        let [slope_from, slope_to] =
            [self.velocities[index][joint], self.velocities[next][joint]].map(|v| v * self.step_secs);
        let (square, cube) = (share * share, share * share * share);
        (2.0 * cube - 3.0 * square + 1.0) * from
            + (cube - 2.0 * square + share) * slope_from
            + (3.0 * square - 2.0 * cube) * to
            + (cube - square) * slope_to
    }

    /// Travel of a key at `secs`, as [`World::key_travel`]; 0 if keys were not recorded.
    pub fn key_travel(&self, key: usize, secs: f64) -> f64 {
        let index = (secs / self.step_secs).round() as usize;
        self.travel.get(index).map_or(0.0, |travel| f64::from(travel[key]))
    }

    /// Simulated minus measured positions of a joint, in the order of its readings, rad or m.
    pub fn errors<'a>(&'a self, motion: &'a RecordedMotion, joint: usize) -> impl Iterator<Item = f64> + 'a {
        motion.readings(joint).map(move |(secs, measured)| self.position(joint, secs) - measured)
    }

    /// Root mean square of [`errors`](Self::errors), rad or m.
    pub fn rmse(&self, motion: &RecordedMotion, joint: usize) -> f64 {
        let (count, sum) = self.errors(motion, joint).fold((0.0, 0.0), |(n, sum), e| (n + 1.0, sum + e * e));
        f64::sqrt(sum / f64::max(count, 1.0))
    }
}

// The rail is the last joint.
const _: () = assert!(RAIL + 1 == DRIVEN_JOINTS);
