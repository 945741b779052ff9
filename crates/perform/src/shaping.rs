//! Turns joint targets into set-points where no simulation runs: the low-pass and the bounded
//! reference of a simulated joint with default parameters, within the limits of the rig's limiter.
//!
//! It depends on the rig and not on the policy. The parameters of a simulator that was fitted to a
//! robot already include this shaping, so the policy's own simulator must not shape the targets a
//! second time.

use etude_robot::rig_file::LimitsConfig;
use etude_stage::controller::{Actuation, Controller, ControllerConstants};
use etude_stage::params::JointRow;
use etude_stage::{DRIVEN_JOINTS, PHYSICS_STEPS, PhysicalParams, RAIL, StageConfig, joint_range};

/// Set-points of one control step, one for each physics step: rad, the rail in m.
pub(crate) type Waypoints = [[f64; DRIVEN_JOINTS]; PHYSICS_STEPS];

/// Set-points are shaped to this share of the limiter's velocity, acceleration and jerk, so that it
/// does not clamp them.
const LIMIT_SHARE: f64 = 0.95;

/// Shapes targets into set-points.
pub(crate) struct Shaping {
    gains: [ControllerConstants; DRIVEN_JOINTS],
    controllers: [Controller; DRIVEN_JOINTS],
}

impl Shaping {
    /// At rest at `pose` (rad, the rail in m).
    pub(crate) fn new(limits: &LimitsConfig, pose: &[f64; DRIVEN_JOINTS]) -> Self {
        let params = shaping_params(limits);
        let step = StageConfig::default().physics_step_secs();
        let gains = std::array::from_fn(|joint| {
            ControllerConstants::new(&params, joint, Actuation::Controlled, step)
        });
        Self { gains, controllers: pose.map(Controller::at_rest) }
    }

    /// The set-points of a control step with these targets.
    pub(crate) fn shape(&mut self, targets: &[f64; DRIVEN_JOINTS], waypoints: &mut Waypoints) {
        for waypoint in waypoints {
            for joint in 0..DRIVEN_JOINTS {
                let [low, high] = joint_range(joint);
                let target = targets[joint].clamp(low, high);
                waypoint[joint] = self.controllers[joint].follow(&self.gains[joint], target);
            }
        }
    }
}

/// Parameters of simulated joints with the low-pass and reference that shape a rig's commands: the
/// start values of a fit to a robot.
pub fn shaping_params(limits: &LimitsConfig) -> PhysicalParams {
    within_limits(PhysicalParams::default(), limits)
}

/// The same parameters with joints that keep the limits of a rig.
pub fn within_limits(mut params: PhysicalParams, limits: &LimitsConfig) -> PhysicalParams {
    for joint in 0..DRIVEN_JOINTS {
        let limits_of_joint = if joint == RAIL {
            [limits.rail_velocity, limits.rail_acceleration, limits.rail_jerk]
        } else {
            [limits.finger_velocity, limits.finger_acceleration, limits.finger_jerk]
        };
        let rows = [JointRow::VelocityLimit, JointRow::AccelerationLimit, JointRow::JerkLimit];
        for (row, limit) in rows.into_iter().zip(limits_of_joint) {
            params.set_joint(row, joint, params.joint(row, joint).min(LIMIT_SHARE * limit));
        }
    }
    params
}

#[cfg(test)]
mod tests {
    use etude_robot::limiter::{Axis, AxisLimits};
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// Whatever the targets, the limiter has nothing to clamp.
        #[test]
        fn what_is_shaped_passes_the_limiter(
            targets in prop::collection::vec(prop::array::uniform13(-2.0..2.0f64), 1..20),
        ) {
            let limits = LimitsConfig::default();
            let mut shaping = Shaping::new(&limits, &[0.0; DRIVEN_JOINTS]);
            let rig = etude_robot::rig_file::RigConfig { limits, ..Default::default() };
            let axes = rig.axes();
            let limits: [AxisLimits; DRIVEN_JOINTS] =
                std::array::from_fn(|joint| if joint == RAIL { axes[axes.len() - 1] } else { axes[joint] });
            let mut limiter = limits.map(|limits| Axis::at_rest(limits, 0.005, 0.0));
            let mut waypoints = [[0.0; DRIVEN_JOINTS]; PHYSICS_STEPS];
            for targets in targets {
                shaping.shape(&targets, &mut waypoints);
                for waypoint in &waypoints {
                    for (joint, axis) in limiter.iter_mut().enumerate() {
                        let clamp = axis.step(waypoint[joint]);
                        prop_assert!(clamp.is_none(), "joint {joint}: {clamp:?}");
                    }
                }
            }
        }
    }
}
