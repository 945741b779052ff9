//! A simulation whose joints a robot follows: the paper's modes *joint mirroring* and *hybrid*.

use etude_stage::{DRIVEN_JOINTS, PHYSICS_STEPS, World, joint_range};
use etude_task::{Command, RigState, TaskConfig, TaskError};

use crate::mode::Mode;
use crate::performance::{Ending, Performance, PlayedStep};
use crate::rig::{Rig, StepEnd, UNSTABLE};
use crate::robot_rig::RobotRig;
use crate::shaping::Waypoints;
use crate::{PerformError, Recorder};

/// Where the keys of the observation come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum KeySource {
    /// From the simulation.
    Simulated,
    /// From the robot.
    Robot,
}

/// A simulation beside a robot. The observation has the joints of the simulation, and the keys of
/// one of the two.
struct Mirrored<'a> {
    world: World,
    robot: RobotRig<'a>,
    keys: KeySource,
}

impl Mode {
    /// The simulation of `task` that runs beside a robot in this mode, if one does.
    ///
    /// # Errors
    /// If the task's configuration is not valid.
    pub fn simulation(self, task: &TaskConfig) -> Result<Option<World>, TaskError> {
        if !self.has_simulation() {
            return Ok(None);
        }
        Ok(Some(World::new(&task.stage, &task.params()?)?))
    }

    /// Puts the rig of this mode together: `robot` alone, or with its
    /// [`simulation`](Self::simulation) beside it.
    pub fn rig<'a>(self, simulation: Option<World>, robot: RobotRig<'a>) -> Box<dyn Rig + 'a> {
        let keys = if self == Self::JointMirroring { KeySource::Simulated } else { KeySource::Robot };
        match simulation {
            Some(world) => Box::new(Mirrored { world, robot, keys }),
            None => Box::new(robot),
        }
    }
}

impl Rig for Mirrored<'_> {
    fn begin(&mut self) -> Result<(), PerformError> {
        self.world.reset();
        self.robot.begin()
    }

    fn state(&self) -> RigState {
        let keys = match self.keys {
            KeySource::Simulated => self.world.pressed(),
            KeySource::Robot => self.robot.state().keys,
        };
        RigState { keys, ..(&self.world).into() }
    }

    fn step(
        &mut self,
        command: &Command<'_>,
        observation: &[f32],
        recorder: &mut Recorder<'_>,
    ) -> Result<StepEnd, PerformError> {
        // The set-points are the simulated joints after each physics step. A simulated stop yields
        // a little, where the robot's range ends.
        let mut waypoints: Waypoints = [[0.0; DRIVEN_JOINTS]; PHYSICS_STEPS];
        let mut unstable = false;
        let world = &mut self.world;
        self.robot.run_while(&mut || {
            let mut next = waypoints.iter_mut();
            let outcome = world.step_watched(&command.targets, |world| {
                if let Some(waypoint) = next.next() {
                    let joints = world.joints();
                    *waypoint = std::array::from_fn(|joint| {
                        let [low, high] = joint_range(joint);
                        joints[joint].clamp(low, high)
                    });
                }
            });
            unstable = outcome.unstable;
        });
        // MuJoCo starts an unstable world over with all joints at zero, where the robot must not
        // go.
        if unstable {
            return Ok(Err(Ending::Fault(UNSTABLE.to_string())));
        }
        let followed = self.robot.follow(&waypoints, command, observation, recorder)?;
        Ok(followed.map(|pressed| PlayedStep { pressed, simulated: Some(self.world.pressed()) }))
    }

    fn run_while(&mut self, work: &mut (dyn FnMut() + Send)) {
        self.robot.run_while(work);
    }

    fn rest(&mut self) {
        self.robot.rest();
    }

    fn finish(
        &mut self,
        performance: &mut Performance,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), PerformError> {
        self.robot.finish(performance, recorder)
    }
}
