//! The controller's cycle: phases that end, set-points on their grid, torques at the hand's clock, and fault checks.

use std::time::Duration;

use super::axes::{AXES, RAIL_AXIS, all_axes, driven, driven_index, period};
use super::following::Following;
use super::motion::Easing;
use super::{Fault, Phase, Record, Robot};
use crate::allegro::{self, HandState};
use crate::can::CanFrame;
use crate::keyboard::KeyboardState;
use crate::limiter::{Axis, Clamp};
use crate::rig::SETPOINT_HZ;
use crate::xarm::ArmState;

/// Farthest from its path along the keyboard at which the arm may begin to follow it, m.
const ON_PATH_M: f64 = 0.005;
/// The same for its orientation, rad.
const ON_PATH_RAD: f64 = 0.03;
/// Largest distance from its range at which a joint of the hand may start, rad: play, and some give of the stop.
const OUTSIDE_RAD: f64 = 0.1;
/// Time after a release in which the hand is still observed, for recordings.
pub const OBSERVED: Duration = Duration::from_secs(1);
/// Longest time between two polls while torques are on. The hand holds the last torque meanwhile.
const LONGEST_GAP: Duration = Duration::from_millis(100);

impl Robot {
    /// The fault that is present now, if any.
    pub(super) fn watch(&mut self, now: Duration, gap: Duration) -> Option<Fault> {
        if !self.is_used() {
            return None;
        }
        if let HandState::Fault(fault) = self.hand.state() {
            return Some(fault.into());
        }
        if let ArmState::Fault(fault) = self.arm.state() {
            return Some(fault.into());
        }
        if let lost @ KeyboardState::Lost { .. } = self.keyboard.state() {
            return Some(Fault::Keyboard(lost.to_string()));
        }
        if gap > LONGEST_GAP && self.is_live() {
            return Some(Fault::Stalled { gap });
        }
        if let Some((joint, by_rad)) = self.following.lost().filter(|_| self.is_live()) {
            return Some(Fault::NotFollowing { joint, by_rad });
        }
        if let Some(doubt) = self.doubts.found().filter(|_| self.is_live()) {
            return Some(Fault::Doubted(doubt.clone()));
        }
        let stretch = self.stream.as_ref().filter(|_| self.phase == Phase::Following)?;
        let age = now.saturating_sub(stretch.end(period()));
        (age.as_secs_f64() > self.config.limits.stale_command_secs).then_some(Fault::StaleCommand { age })
    }

    /// Whether the devices must be connected.
    pub(super) fn is_used(&self) -> bool {
        self.is_live() || self.phase == Phase::Starting
    }

    /// Whether hand and arm were commanded to stop.
    pub(super) fn is_released(&self) -> bool {
        matches!(self.phase, Phase::Stopped | Phase::Fault)
    }

    /// Whether the hand was released a short time ago, and still reports its angles.
    pub(super) fn is_observed(&self, now: Duration) -> bool {
        self.is_released() && self.let_go_at.is_some_and(|at| now.saturating_sub(at) <= OBSERVED)
    }

    /// Whether torques are on.
    pub(super) fn is_live(&self) -> bool {
        matches!(self.phase, Phase::Holding | Phase::Moving | Phase::Following)
    }

    /// Phases that end by themselves, and the set-points that are due.
    pub(super) fn advance(&mut self, now: Duration) -> Result<(), Fault> {
        if self.phase == Phase::Starting {
            if self.hand.state() == HandState::Ready && self.arm.state() == ArmState::Ready {
                self.check_arm()?;
                let keyboard = self.keyboard.state();
                if keyboard != KeyboardState::Present {
                    return Err(Fault::Keyboard(keyboard.to_string()));
                }
                self.settle(now)?;
                self.enter(now, Phase::Holding);
            }
            return Ok(());
        }
        if !self.is_live() {
            return Ok(());
        }
        self.advance_plan(now)?;
        // After a gap, missed set-points are not made up for; the grid stays that of the stream.
        let gap = now.saturating_sub(self.stepped);
        if gap > 4 * period() {
            self.stepped += period() * ((gap.as_nanos() / period().as_nanos()) as u32 - 1);
        }
        while now.saturating_sub(self.stepped) >= period() {
            self.stepped += period();
            self.set_points(self.stepped)?;
        }
        Ok(())
    }

    /// Whether this is the arm of the calibration.
    fn check_arm(&self) -> Result<(), Fault> {
        let (found, expected) = (self.arm.serial().unwrap_or_default(), self.path.arm_serial());
        if found == expected {
            return Ok(());
        }
        Err(Fault::OtherArm { found: found.to_string(), expected: expected.to_string() })
    }

    /// Sets the set-points to the measured positions, at rest. Positions slightly outside a range are eased into it.
    fn settle(&mut self, now: Duration) -> Result<(), Fault> {
        let place = self.place();
        let mut outside = [0.0; AXES];
        let measured = self.hand.positions().into_iter().chain([place.rail_m]);
        for (joint, ((axis, outside), rad)) in
            self.axes.iter_mut().zip(&mut outside).zip(measured).enumerate()
        {
            axis.rest(rad);
            *outside = rad - axis.position();
            if joint != RAIL_AXIS && outside.abs() > OUTSIDE_RAD {
                let [low, high] = axis.limits().position;
                return Err(Fault::OutsideRange { joint, rad, low, high });
            }
        }
        let on_path = place.beside_m <= ON_PATH_M
            && place.turned_rad <= ON_PATH_RAD
            && outside[RAIL_AXIS].abs() <= ON_PATH_M;
        self.arm_stood = self.arm.joints();
        self.arm_sent = self.arm_stood.filter(|_| on_path);
        self.arm_aside = match &self.arm_sent {
            Some(stood) => {
                let rail_m = place.rail_m;
                let on = self.path.joints(rail_m, stood).map_err(|source| Fault::Reach { rail_m, source })?;
                std::array::from_fn(|joint| stood[joint] - on[joint])
            }
            None => Default::default(),
        };
        self.easing = Easing::new(now, outside);
        self.following = Following::default();
        self.doubts.begin_anew();
        self.before = self.setpoints();
        self.arm_axis.rest(self.axes[RAIL_AXIS].position());
        self.stepped = now;
        self.arm.align(now, now);
        Ok(())
    }

    fn set_points(&mut self, at: Duration) -> Result<(), Fault> {
        self.before = self.setpoints();
        let asked = match (&self.plan, &self.stream) {
            (Some(plan), _) => Some(plan.slow.at(at)),
            (None, Some(stretch)) => {
                stretch.at(at, period()).map(|joints| all_axes(joints, &self.config.limits.thumb_rad))
            }
            (None, None) => None,
        };
        let mut clamps: Vec<(usize, Clamp)> = Vec::new();
        match &asked {
            None => self.axes.iter_mut().for_each(Axis::brake),
            Some(asked) => {
                let held = self.holds_rail();
                for (index, (axis, target)) in self.axes.iter_mut().zip(asked).enumerate() {
                    let clamp = match held {
                        Some(clamp) if index == RAIL_AXIS => {
                            axis.brake();
                            Some(clamp)
                        }
                        _ => axis.step(*target),
                    };
                    clamps.extend(clamp.map(|clamp| (driven_index(index), clamp)));
                }
            }
        }
        self.clamped += clamps.len() as u64;
        let sent = driven(&self.setpoints());
        let asked = asked.as_ref().map_or(sent, driven);
        self.journal.push(Record::SetPoint { at, asked, sent, clamps });
        Ok(())
    }

    /// Gives the arm the next target if it can be sent now. After late replies the rail's set-point is far ahead: the arm catches up with
    /// it within the same limits, from rest if it has stood still meanwhile.
    pub(super) fn lead_arm(&mut self, now: Duration) -> Result<(), Fault> {
        if !self.is_live() || !self.arm.takes_target(now) {
            return Ok(());
        }
        let pause = self.arm.sent_at().map_or(Duration::ZERO, |at| now.saturating_sub(at));
        let paused = pause > self.config.arm.servo_period() * 7 / 4;
        if let Some(way) = self.plan.as_mut().and_then(|plan| plan.way.as_mut()) {
            let joints = way.next(now, paused)?;
            return Ok(self.arm.servo(now, joints)?);
        }
        let Some(near) = self.arm_sent else { return Ok(()) };
        if paused {
            self.arm_axis.rest(self.arm_axis.position());
        }
        if self.drags(&self.arm_axis) {
            self.arm_axis.brake();
        } else {
            self.arm_axis.step(self.axes[RAIL_AXIS].position());
        }
        let rail_m = self.arm_axis.position() + self.easing.left(now)[RAIL_AXIS];
        let mut joints = self.path.joints(rail_m, &near).map_err(|source| Fault::Reach { rail_m, source })?;
        let left = self.easing.share(now);
        for (joint, aside) in joints.iter_mut().zip(self.arm_aside) {
            *joint += aside * left;
        }
        self.arm.servo(now, joints)?;
        self.arm_sent = Some(joints);
        Ok(())
    }

    /// One period of the joint loop.
    pub(super) fn drive(&mut self, now: Duration, frames: &mut Vec<CanFrame>) {
        let at = self.hand.positions_at().unwrap_or(now);
        let positions = self.hand.positions();
        if !self.is_live() {
            if self.phase == Phase::Starting || self.is_observed(now) {
                self.journal.push(Record::Idle { at, positions });
            }
            return;
        }
        let since = now.saturating_sub(self.stepped).as_secs_f64();
        let share = (since * SETPOINT_HZ).clamp(0.0, 1.0);
        let left = self.easing.left(now);
        let reference: [f64; allegro::JOINTS] = std::array::from_fn(|joint| {
            self.before[joint] + (self.axes[joint].position() - self.before[joint]) * share + left[joint]
        });
        self.following.take(at, &positions, &reference, &self.config.limits);
        let wanted = self.joint_loop.pwm(at, &positions, &reference, self.palm_down);
        let pwm = self.hand.torque(now, &wanted, frames);
        self.doubts.hand(at, &positions, &reference, &pwm, self.may_press(&positions));
        self.journal.push(Record::Hand { at, positions, reference, wanted, pwm });
    }
}
