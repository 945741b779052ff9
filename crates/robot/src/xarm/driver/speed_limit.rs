//! The last check of every target before the wire: it must be reachable and close to the one
//! before, and each step that is sent stays within the speed limits.

use super::distance::{flange_distance_m, largest_turn, possible};
use super::fault::TargetError;
use super::state::{Arm, Target};
use crate::xarm::kinematics;

/// Corrections of a shortened path, each of which leaves a small part of what was too long.
const CORRECTIONS: usize = 3;
/// Room for rounding when speeds are compared with their limits.
const ROUNDING: f64 = 1.0 + 1e-6;

impl Arm {
    /// Whether a target may follow the one before.
    pub(super) fn allowed(&self, target: &Target) -> Result<(), TargetError> {
        possible(&target.joints)?;
        if let Some(safety_box) = self.config.box_mm {
            let flange = kinematics::forward(&target.joints).position_m;
            safety_box.holds(&flange).map_err(TargetError::OutsideBox)?;
        }
        let Some(before) = self.target.or(self.sent) else { return Ok(()) };
        let secs = self.step_secs();
        let (joint, turn) = largest_turn(&before.joints, &target.joints);
        let (needed_rad_s, allowed_rad_s) = (turn / secs, self.config.joint_speed_limit_rad_s);
        if needed_rad_s > allowed_rad_s {
            return Err(TargetError::JointTooFast { joint, needed_rad_s, allowed_rad_s });
        }
        let needed_m_s = flange_distance_m(&before.joints, &target.joints) / secs;
        let allowed_m_s = self.config.tcp_speed_limit_m_s;
        if needed_m_s > allowed_m_s {
            return Err(TargetError::FlangeTooFast { needed_m_s, allowed_m_s });
        }
        Ok(())
    }

    /// The last limit before the wire: as much of the path from what was sent last to the target as
    /// the speed limits allow. It is less than all of it only after late replies, as
    /// [`servo`](Arm::servo) refuses what is too fast.
    pub(super) fn within_reach(&self, target: Target) -> Target {
        let Some(sent) = self.sent else { return target };
        let secs = self.step_secs();
        let (_, turn) = largest_turn(&sent.joints, &target.joints);
        let distance = flange_distance_m(&sent.joints, &target.joints);
        let max_m = self.config.tcp_speed_limit_m_s * secs;
        let mut share =
            (self.config.joint_speed_limit_rad_s * secs / turn.max(1e-9)).min(max_m / distance.max(1e-9));
        if share >= 1.0 {
            return target;
        }
        let part = |share: f64| {
            let mut joints = sent.joints;
            for (angle, to) in joints.iter_mut().zip(target.joints) {
                *angle += (to - *angle) * share;
            }
            joints
        };
        // The flange's path is curved: a share of the turns can be more than that share of the
        // path.
        for _ in 0..CORRECTIONS {
            share *= (max_m / flange_distance_m(&sent.joints, &part(share)).max(1e-9)).min(1.0);
        }
        Target { joints: part(share), ..target }
    }

    /// Time that a step may use, s: a period, whatever time has passed since the last target,
    /// because the arm takes each target at full speed.
    fn step_secs(&self) -> f64 {
        self.link.period().as_secs_f64() * ROUNDING
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::xarm::ArmConfig;
    use crate::xarm::kinematics::PAPER_HOME_DEG;

    #[test]
    fn a_shortened_path_keeps_the_flanges_speed_on_a_curve() {
        let joints = PAPER_HOME_DEG.map(f64::to_radians);
        for turn in [0.2, 0.7, 1.5, 2.5] {
            let mut arm = Arm::new(ArmConfig::default()).unwrap();
            arm.sent = Some(Target { joints, at: Some(Duration::from_secs(1)) });
            let mut far = joints;
            far[0] += turn;
            let at = Duration::from_secs(1) + arm.config.servo_period();
            let next = arm.within_reach(Target { joints: far, at: Some(at) });
            let (distance, max) =
                (flange_distance_m(&joints, &next.joints), arm.step_secs() * arm.config.tcp_speed_limit_m_s);
            assert!(distance <= max * (1.0 + 1e-5) && distance > max * 0.9, "{distance} m for {turn} rad");
            assert_ne!(next.joints, far, "shortened");
        }
    }
}
