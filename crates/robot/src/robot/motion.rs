//! What moves the set-points: a plan of slow moves, or a trajectory; without either they brake and
//! hold.

use std::time::Duration;

use super::arm_path::ArmPath;
use super::axes::{AXES, all_axes, period};
use super::fault::Fault;
use super::homing_plan::HomingPlan;
use super::trajectory::Trajectory;
use crate::joints::DRIVEN;

/// The plan or the trajectory that is under way.
#[derive(Debug, Default)]
pub(super) struct MotionSource {
    pub plan: Option<HomingPlan>,
    trajectory: Option<Trajectory>,
}

impl MotionSource {
    /// Ends both.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Ends the trajectory.
    pub fn end_trajectory(&mut self) {
        self.trajectory = None;
    }

    /// Replaces what is left of the trajectory.
    pub fn follow(&mut self, begun: Duration, waypoints: &[[f64; DRIVEN]]) {
        let mut kept = self.trajectory.take().map(|trajectory| trajectory.waypoints).unwrap_or_default();
        kept.clear();
        kept.extend_from_slice(waypoints);
        self.trajectory = Some(Trajectory { begun, waypoints: kept });
    }

    /// Where the axes are to be at `at`; nowhere else if nothing moves them.
    pub fn asked(&self, at: Duration, thumb_rad: &[f64; 4]) -> Option<[f64; AXES]> {
        match (&self.plan, &self.trajectory) {
            (Some(plan), _) => Some(plan.slow.at(at)),
            (None, Some(trajectory)) => trajectory.at(at, period()).map(|joints| all_axes(joints, thumb_rad)),
            (None, None) => None,
        }
    }

    /// The arm's path to the keyboard, while it is on it.
    pub fn arm_path(&mut self) -> Option<&mut ArmPath> {
        self.plan.as_mut()?.path.as_mut()
    }

    /// Whether the arm takes much longer to the keyboard than it should.
    pub fn is_late(&self, now: Duration) -> bool {
        let path = self.plan.as_ref().and_then(|plan| plan.path.as_ref());
        path.is_some_and(|path| path.is_late(now))
    }

    /// Whether the arm is on its path to the keyboard.
    pub fn has_arm_path(&self) -> bool {
        self.plan.as_ref().is_some_and(|plan| plan.path.is_some())
    }

    /// Whether the arm goes to the keyboard, or will.
    pub fn brings_arm(&self) -> bool {
        self.plan.as_ref().is_some_and(|plan| plan.via.is_some())
    }

    /// The fault of a trajectory whose last waypoint was due too long ago.
    pub fn check_age(&self, now: Duration, max_secs: f64) -> Result<(), Fault> {
        let Some(trajectory) = &self.trajectory else { return Ok(()) };
        let age = now.saturating_sub(trajectory.end(period()));
        if age.as_secs_f64() > max_secs { Err(Fault::StaleCommand { age }) } else { Ok(()) }
    }
}
