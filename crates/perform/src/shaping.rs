//! Turns joint targets into set-points where no simulation runs: the low-pass and the bounded
//! reference of a simulated joint with default parameters, within the limits of the rig's limiter.
//!
//! It depends on the rig and not on the policy. The parameters of a simulator that was fitted to a
//! robot already include this shaping, so the policy's own simulator must not shape the targets a
//! second time.

use etude_robot::rig_file::{LimitsConfig, MAX_FINGER_LIMITS, MAX_RAIL_LIMITS};
use etude_stage::controller::{Actuation, Controller, ControllerConstants};
use etude_stage::params::JointRow;
use etude_stage::{DRIVEN_JOINTS, PHYSICS_STEPS, PhysicalParams, RAIL, StageConfig, joint_range};

/// Set-points of one control step, one for each physics step: rad, the rail in m.
pub(crate) type Waypoints = [[f64; DRIVEN_JOINTS]; PHYSICS_STEPS];

/// Set-points are shaped to this share of the limiter's velocity, acceleration and jerk, so that it
/// does not clamp them.
const LIMIT_SHARE: f64 = 0.95;

/// Set-points of the rail that differ by no more are the same, m.
const SAME_M: f64 = 1e-6;

/// Shapes targets into set-points.
pub(crate) struct Shaping {
    gains: [ControllerConstants; DRIVEN_JOINTS],
    controllers: [Controller; DRIVEN_JOINTS],
    /// The rail's last two set-points, m.
    rail: [f64; 2],
}

impl Shaping {
    /// At rest at `pose` (rad, the rail in m).
    pub(crate) fn new(limits: &LimitsConfig, pose: &[f64; DRIVEN_JOINTS]) -> Self {
        let params = shaping_params(limits);
        let step = StageConfig::default().physics_step_secs();
        let gains = std::array::from_fn(|joint| {
            ControllerConstants::new(&params, joint, Actuation::Controlled, step)
        });
        Self { gains, controllers: pose.map(Controller::at_rest), rail: [pose[RAIL]; 2] }
    }

    /// Continues from the rail's set-point as the robot has it (m, and m/s), where its interlock
    /// has held it back: a simulated rail that is held continues from there too.
    pub(crate) fn resume_rail(&mut self, [position, velocity]: [f64; 2]) {
        // The robot may still have the last set-point before it.
        if self.rail.iter().all(|shaped| (shaped - position).abs() > SAME_M) {
            self.controllers[RAIL].resume(position, velocity);
        }
    }

    /// The set-points of a control step with these targets.
    pub(crate) fn shape(&mut self, targets: &[f64; DRIVEN_JOINTS], waypoints: &mut Waypoints) {
        for waypoint in waypoints {
            for joint in 0..DRIVEN_JOINTS {
                let [low, high] = joint_range(joint);
                let target = targets[joint].clamp(low, high);
                waypoint[joint] = self.controllers[joint].step_set_point(&self.gains[joint], target);
            }
            self.rail = [self.rail[1], waypoint[RAIL]];
        }
    }
}

/// Parameters of simulated joints with the low-pass and reference that shape a rig's commands: the
/// start values of a fit to a robot. They are the defaults, and higher where the rig's limits are.
pub fn shaping_params(limits: &LimitsConfig) -> PhysicalParams {
    let mut params = PhysicalParams::default();
    let usual = LimitsConfig::default();
    for joint in 0..DRIVEN_JOINTS {
        let both = of_joint(limits, joint).into_iter().zip(of_joint(&usual, joint));
        for (row, (limit, usual)) in ROWS.into_iter().zip(both) {
            params.set_joint(row, joint, params.joint(row, joint) * (limit / usual).max(1.0));
        }
    }
    within_limits(params, limits)
}

/// The limits of a rig whose shaping is as quick as the joints of a simulator with these
/// parameters, as far as a rig may have them. So a policy moves a twin as it has learned to.
pub fn limits_for(params: &PhysicalParams) -> LimitsConfig {
    let usual = LimitsConfig::default();
    // A fit estimates the jerk limit, so that the acceleration limit stands for both. Rounded, so
    // that the limits of a simulator that was fitted to such a rig are the same again.
    let limits = |joint: usize, max: [f64; 3]| {
        let usual = of_joint(&usual, joint);
        let scaled = |row, usual: f64| {
            let share = params.joint(row, joint) / PhysicalParams::default().joint(row, joint);
            (usual * share * 1e3).round() / 1e3
        };
        let (velocity, acceleration) = (scaled(ROWS[0], usual[0]), scaled(ROWS[1], usual[1]));
        let jerk = usual[2] * acceleration / usual[1];
        [velocity.min(max[0]), acceleration.min(max[1]), jerk.min(max[2])]
    };
    let [finger_velocity, finger_acceleration, finger_jerk] = limits(0, MAX_FINGER_LIMITS);
    let [rail_velocity, rail_acceleration, rail_jerk] = limits(RAIL, MAX_RAIL_LIMITS);
    LimitsConfig {
        finger_velocity,
        finger_acceleration,
        finger_jerk,
        rail_velocity,
        rail_acceleration,
        rail_jerk,
        ..usual
    }
}

/// The rows that a rig limits too, and a rig's limits in this order.
const ROWS: [JointRow; 3] = [JointRow::VelocityLimit, JointRow::AccelerationLimit, JointRow::JerkLimit];

fn of_joint(limits: &LimitsConfig, joint: usize) -> [f64; 3] {
    if joint == RAIL {
        [limits.rail_velocity, limits.rail_acceleration, limits.rail_jerk]
    } else {
        [limits.finger_velocity, limits.finger_acceleration, limits.finger_jerk]
    }
}

/// The same parameters with joints that keep the limits of a rig.
pub fn within_limits(mut params: PhysicalParams, limits: &LimitsConfig) -> PhysicalParams {
    for joint in 0..DRIVEN_JOINTS {
        for (row, limit) in ROWS.into_iter().zip(of_joint(limits, joint)) {
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

    #[test]
    fn a_rig_is_as_quick_as_the_simulator_and_shapes_alike() {
        assert_eq!(limits_for(&PhysicalParams::default()), LimitsConfig::default());
        let [shaped, default] = [shaping_params(&LimitsConfig::default()), PhysicalParams::default()];
        for (row, joint) in ROWS.into_iter().flat_map(|row| [(row, 0), (row, RAIL)]) {
            assert!((shaped.joint(row, joint) / default.joint(row, joint) - 1.0).abs() < 1e-12);
        }
        let mut quick = PhysicalParams::default();
        for (path, value) in
            [("joint.rail.acceleration_limit", 13.25), ("joint.fingers.velocity_limit", 40.0)]
        {
            quick.set(path, value).unwrap();
        }
        let limits = limits_for(&quick);
        assert!((limits.rail_acceleration - 13.25 / 7.1 * 7.5).abs() < 1e-3);
        let shaped = shaping_params(&limits);
        for path in ["joint.rail.acceleration_limit", "joint.index_1.velocity_limit"] {
            let [shaped, simulated] = [&shaped, &quick].map(|params| params.get(path).unwrap());
            assert!((shaped / simulated - 1.0).abs() < 1e-4, "{path}: {shaped} {simulated}");
        }
        assert_eq!(limits_for(&shaped), limits, "the same again, of a simulator fitted to it");
        // A jerk limit is estimated by a fit, and says nothing of the rig's.
        let mut fitted = PhysicalParams::default();
        fitted.set("joint.all.jerk_limit", 900_000.0).unwrap();
        assert_eq!(limits_for(&fitted), LimitsConfig::default());
        // What no rig may have.
        quick.set("joint.rail.acceleration_limit", 5000.0).unwrap();
        assert_eq!(limits_for(&quick).rail_acceleration, 14.0);
        // A rig's lower limits count.
        let slow = LimitsConfig { rail_acceleration: 1.0, ..LimitsConfig::default() };
        assert_eq!(shaping_params(&slow).get("joint.rail.acceleration_limit").unwrap(), 0.95);
        // A rig is as slow as a slow simulator, too.
        let mut slow = PhysicalParams::default();
        slow.set("joint.rail.velocity_limit", 0.38).unwrap();
        assert!((limits_for(&slow).rail_velocity - 0.4).abs() < 1e-3);
    }

    /// The shaping of a rail that was held back continues from where the rail is. Otherwise the
    /// rail would have to catch up with what the policy asked for meanwhile.
    #[test]
    fn a_rail_that_was_held_back_is_not_asked_to_catch_up() {
        let mut waypoints = [[0.0; DRIVEN_JOINTS]; PHYSICS_STEPS];
        let mut targets = [0.0; DRIVEN_JOINTS];
        targets[RAIL] = 0.2;
        let asked = |held: bool, waypoints: &mut Waypoints| {
            let mut shaping = Shaping::new(&LimitsConfig::default(), &[0.0; DRIVEN_JOINTS]);
            (0..3).for_each(|_| shaping.shape(&targets, waypoints));
            let last = [waypoints[PHYSICS_STEPS - 2][RAIL], waypoints[PHYSICS_STEPS - 1][RAIL]];
            let velocity = (last[1] - last[0]) / 0.005;
            // The robot has the last set-point or that before it, or it was held 30 mm behind.
            for position in last {
                shaping.resume_rail([position, velocity]);
            }
            if held {
                shaping.resume_rail([last[1] - 0.03, 0.1]);
            }
            shaping.shape(&targets, waypoints);
            (last[1], waypoints[0][RAIL])
        };
        let (last, free) = asked(false, &mut waypoints);
        assert!((0.0..0.005).contains(&(free - last)), "{last} {free}");
        let (last, held) = asked(true, &mut waypoints);
        assert!((0.0..0.001).contains(&(held - (last - 0.03))), "{last} {held}");
    }

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
