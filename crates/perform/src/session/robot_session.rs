//! A robot with its controller and its clock. When the session is dropped, the hand is released and
//! the arm is stopped.

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
use super::guard::{Guard, HEARTBEAT_INTERVAL};
use super::motor_heat_file::HeatFile;
use super::worker::Worker;
use crate::error::PerformError;
use crate::prepare::{STOPPED as STOPPED_BY_ANOTHER, prepare};

/// Time within which arm and hand must confirm that they are stopped.
const STOP_TIMEOUT: Duration = Duration::from_secs(1);

/// Time between two checks whether work is done.
const POLL_INTERVAL: Duration = Duration::from_micros(100);

/// A robot with its controller.
pub struct Session {
    /// The controller.
    pub robot: Robot,
    /// Lockstep with a twin, or real time over wires.
    pub pace: SessionPace,
}

/// How time passes for a robot.
pub enum SessionPace {
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
    heat: HeatFile,
    worker: Arc<Worker>,
    /// `None` where the system does not permit it: on a busy machine the robot may then stop.
    _priority: Option<Priority>,
}

impl Live {
    /// The `robot` learns how hot its motors are.
    pub(super) fn new(
        wires: OpenWires,
        guard: Guard,
        claim: Arc<Claim>,
        heat: HeatFile,
        worker: Worker,
        robot: &mut Robot,
    ) -> Self {
        let _priority = Priority::of_this_thread(Rank::Controller).ok();
        let pace = RealTime::new(wires);
        robot.set_motor_heat(heat.read(pace.now()));
        Self { pace, guard, claim, heat, worker: Arc::new(worker), _priority }
    }

    /// Stops the robot if its guard has ended or a stop was requested.
    fn watch(&mut self, robot: &mut Robot) {
        let has_guard = self.guard.heartbeat();
        if self.is_stop_requested(robot) || !has_guard {
            let now = self.pace.now();
            robot.stop(now, self.pace.wires());
        }
    }

    fn is_stop_requested(&self, robot: &mut Robot) -> bool {
        let requested = self.claim.is_stop_requested();
        if requested {
            robot.stop_was_requested(self.pace.now());
        }
        requested
    }
}

impl Session {
    /// Brings the robot up and holds it still for `time`. Returns the fault of a safety stop
    /// meanwhile.
    ///
    /// # Errors
    /// If the robot does not get ready.
    pub fn hold(&mut self, time: Duration, interrupt: &AtomicBool) -> Result<Option<String>, PerformError> {
        let Self { robot, pace } = self;
        prepare(robot, pace, None, None, interrupt)?;
        let until = pace.now() + time;
        pace.run_until(robot, until);
        let stopped = (robot.phase() != Phase::Holding).then(|| STOPPED_BY_ANOTHER.to_string());
        let fault = robot.fault().map(ToString::to_string).or(stopped);
        let astray = || {
            let (joint, by_rad) = robot.astray()?;
            Some(format!(
                "joint {joint} of the hand does not hold still: it is {by_rad:.2} rad from its set-point, so its motor may turn the wrong \
                 way, or something moves it"
            ))
        };
        Ok(fault.or_else(astray))
    }

    /// Releases the hand, stops the arm, and waits until both have confirmed it. One that has never
    /// answered was never given power: there is nothing to confirm, and nothing for the guard to
    /// do.
    ///
    /// # Errors
    /// If they do not: what the operator must do. The guard then tries again.
    pub fn let_go(&mut self) -> Result<(), String> {
        let begun = self.pace.now();
        self.robot.stop(begun, self.pace.wires());
        loop {
            let now = self.pace.now();
            self.pace.run_until(&mut self.robot, now + Duration::from_millis(10));
            let (arm, hand) = (self.robot.arm(), self.robot.hand());
            let reported = arm.joints_at().is_some_and(|at| at > begun);
            let stands = reported && arm.report().is_some_and(|report| report.state == STOPPED);
            let arm = stands || arm.version().is_none() && arm.report().is_none();
            let hand = hand.has_confirmed_release() || !hand.was_reached();
            if arm && hand {
                return Ok(());
            }
            if self.pace.now() > begun + STOP_TIMEOUT {
                let arm = (!arm).then_some(format!("arm: {NOT_STOPPED}"));
                let hand = (!hand).then_some(format!("hand: {NOT_LET_GO}"));
                return Err([arm, hand].into_iter().flatten().collect::<Vec<_>>().join("; "));
            }
        }
    }
}

impl Drop for Session {
    /// After a panic the guard acts.
    fn drop(&mut self) {
        if std::thread::panicking() {
            return;
        }
        let mut released = true;
        if self.robot.phase() != Phase::Off {
            released = self.let_go().is_ok();
            self.robot.leave(self.pace.wires());
        }
        let SessionPace::Live(live) = &mut self.pace else { return };
        if released {
            live.guard.farewell();
        }
        live.heat.write(live.pace.now(), &self.robot.motor_heat());
    }
}

impl Pace for SessionPace {
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
            live.watch(robot);
            let next = (live.pace.now() + HEARTBEAT_INTERVAL).min(until);
            live.pace.run_until(robot, next);
            if next >= until {
                // A fault meanwhile may be the work of the stop.
                live.is_stop_requested(robot);
                return;
            }
        }
    }

    /// The work has a thread of its own, so that it does not hold up the hand's loop. If it hangs,
    /// the robot stops because no command comes.
    fn run_while(&mut self, robot: &mut Robot, work: &mut (dyn FnMut() + Send)) {
        let Self::Live(live) = self else { return work() };
        let worker = live.worker.clone();
        worker.run(work, || {
            live.watch(robot);
            let next = live.pace.now() + POLL_INTERVAL;
            live.pace.run_until(robot, next);
        });
    }

    fn wires(&mut self) -> &mut dyn Wires {
        match self {
            Self::Lockstep(lockstep) => lockstep.wires(),
            Self::Live(live) => live.pace.wires(),
        }
    }
}

#[cfg(test)]
mod tests;
