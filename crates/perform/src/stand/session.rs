//! A robot with its controller and its clock. When the stand is dropped, the hand is released and the arm is stopped.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use etude_robot::priority::{Priority, Rank};
use etude_robot::stop::{NOT_LET_GO, NOT_STOPPED};
use etude_robot::wires::{OpenWires, Wires};
use etude_robot::xarm::codec::STOPPED;
use etude_robot::{Pace, Phase, RealTime, Robot};
use etude_twin::Lockstep;

use super::claim::Claim;
use super::guard::{Guard, PERIOD};
use crate::error::PerformError;
use crate::prepare::{STOPPED as STOPPED_BY_ANOTHER, prepare};

/// Time within which arm and hand must confirm that they are stopped.
const CONFIRM: Duration = Duration::from_secs(1);

/// A robot with its controller.
pub struct Stand {
    /// The controller.
    pub robot: Robot,
    /// Lockstep with a twin, or real time over wires.
    pub pace: StandPace,
}

/// How time passes for a robot.
pub enum StandPace {
    /// With a twin, as fast as it can be computed.
    Lockstep(Box<Lockstep>),
    /// By the wall clock, under guard.
    Live(Box<Live>),
}

/// A rig by the wall clock.
pub struct Live {
    pace: RealTime<OpenWires>,
    guard: Guard,
    claim: Arc<Claim>,
    /// `None` where the system does not permit it: on a busy machine the robot may then stop.
    _priority: Option<Priority>,
}

impl Live {
    pub(super) fn new(wires: OpenWires, guard: Guard, claim: Arc<Claim>) -> Self {
        let _priority = Priority::of_this_thread(Rank::Controller).ok();
        Self { pace: RealTime::new(wires), guard, claim, _priority }
    }
}

impl Stand {
    /// Brings the robot up and holds it still for `time`. Returns the fault if the robot stopped itself meanwhile.
    ///
    /// # Errors
    /// If the robot does not get ready.
    pub fn hold(&mut self, time: Duration, interrupt: &AtomicBool) -> Result<Option<String>, PerformError> {
        let Self { robot, pace } = self;
        prepare(robot, pace, None, None, interrupt)?;
        let until = pace.now() + time;
        pace.run_until(robot, until);
        let stopped = (robot.phase() != Phase::Holding).then(|| STOPPED_BY_ANOTHER.to_string());
        Ok(robot.fault().map(ToString::to_string).or(stopped))
    }

    /// Releases the hand, stops the arm, and waits until both have confirmed it.
    ///
    /// # Errors
    /// If they do not: what the operator must do. The guard then tries again.
    pub fn let_go(&mut self) -> Result<(), String> {
        let begun = self.pace.now();
        self.robot.stop(begun, self.pace.wires());
        loop {
            let now = self.pace.now();
            self.pace.run_until(&mut self.robot, now + Duration::from_millis(10));
            let told = self.robot.arm().joints_at().is_some_and(|at| at > begun);
            let arm = told && self.robot.arm().report().is_some_and(|report| report.state == STOPPED);
            let hand = self.robot.hand().has_let_go();
            if arm && hand {
                return Ok(());
            }
            if self.pace.now() > begun + CONFIRM {
                let arm = (!arm).then_some(format!("arm: {NOT_STOPPED}"));
                let hand = (!hand).then_some(format!("hand: {NOT_LET_GO}"));
                return Err([arm, hand].into_iter().flatten().collect::<Vec<_>>().join("; "));
            }
        }
    }
}

impl Drop for Stand {
    /// After a panic the guard acts.
    fn drop(&mut self) {
        if std::thread::panicking() {
            return;
        }
        let untouched = self.robot.phase() == Phase::Off;
        if (untouched || self.let_go().is_ok())
            && let StandPace::Live(live) = &mut self.pace
        {
            live.guard.farewell();
        }
    }
}

impl Pace for StandPace {
    fn now(&self) -> Duration {
        match self {
            Self::Lockstep(lockstep) => lockstep.now(),
            Self::Live(live) => live.pace.now(),
        }
    }

    fn run_until(&mut self, robot: &mut Robot, until: Duration) {
        let live = match self {
            Self::Lockstep(lockstep) => return lockstep.run_until(robot, until),
            Self::Live(live) => live,
        };
        loop {
            if !live.guard.beat() || live.claim.is_told_to_stop() {
                let now = live.pace.now();
                robot.stop(now, live.pace.wires());
            }
            let next = (live.pace.now() + PERIOD).min(until);
            live.pace.run_until(robot, next);
            if next >= until {
                return;
            }
        }
    }

    fn wires(&mut self) -> &mut dyn Wires {
        match self {
            Self::Lockstep(lockstep) => lockstep.wires(),
            Self::Live(live) => live.pace.wires(),
        }
    }
}
