//! The driver of the arm: computes from the arm's replies and reports what to send next, and stops
//! it on any deviation.
//!
//! It receives the bytes of the command port and of the report port with the time of their arrival;
//! [`poll`](Arm::poll) returns what to send. One request is outstanding at a time; only a stop does
//! not wait for its turn. After a fault the stop is repeated until the arm's reports confirm it,
//! and nothing else is sent until [`start`](Arm::start).

mod config;
mod distance;
mod exchange;
mod fault;
mod speed_limit;
mod state;
mod steps;

use std::time::Duration;

pub use config::ArmConfig;
pub use fault::{ArmError, ArmFault, ArmState, TargetError};
pub use state::Arm;
pub use steps::ArmVersion;

use super::codec::{FrameParser, Register};
use super::delay_monitor::DelayMonitor;
use super::kinematics::{self, ARM_JOINTS, Pose};
use super::link::{Link, LinkSpeed, MANY_LATE};
use super::report::{REPORT_PERIOD, Report, ReportParser};
pub(crate) use distance::largest_turn;
use state::{Halt, Phase, Purpose, Target, Work};
use steps::{MANUAL, SERVO, Step};

impl Arm {
    /// Both ports are connected. Nothing is sent until [`start`](Self::start); a fault stays.
    pub fn connected(&mut self, _now: Duration) {
        self.commands = FrameParser::default();
        self.reports = ReportParser::default();
        (self.outstanding, self.report, self.halt, self.ask_error) = (None, None, None, false);
        self.phase = match self.phase {
            Phase::Fault(fault, _) => Phase::Fault(fault, true),
            _ => Phase::Stopped,
        };
    }

    /// One of the ports is gone. A fault, unless the arm was stopped.
    pub fn disconnected(&mut self, _now: Duration) {
        (self.outstanding, self.halt, self.ask_error) = (None, None, false);
        self.phase = match self.phase {
            Phase::Disconnected | Phase::Stopped => Phase::Disconnected,
            Phase::Working(_) | Phase::Ready | Phase::Manual => Phase::Fault(ArmFault::Disconnected, false),
            Phase::Fault(fault, _) => Phase::Fault(fault, false),
        };
    }

    /// Clears faults and makes the arm ready to follow targets, from any state.
    ///
    /// # Errors
    /// If there is no connection.
    pub fn start(&mut self, now: Duration) -> Result<(), ArmError> {
        if matches!(self.phase, Phase::Disconnected | Phase::Fault(_, false)) {
            return Err(ArmError::NotNow(self.state()));
        }
        (self.outstanding, self.halt, self.ask_error) = (None, None, false);
        // Reports may have been missing before.
        self.report_delay = DelayMonitor::new(REPORT_PERIOD);
        self.link = Link::new(self.config.servo_period());
        self.work(now, steps::START);
        Ok(())
    }

    /// The newest target, joints in rad. [`poll`](Self::poll) sends it at the next tick and again
    /// at each one after that, until there is a newer one. The first one must be near where the arm
    /// is, and each of the next ones within the speed limits of the one before.
    ///
    /// # Errors
    /// If the arm is not ready. If the target is not allowed: that is a fault, and the arm is
    /// stopped.
    pub fn servo(&mut self, now: Duration, joints_rad: [f64; ARM_JOINTS]) -> Result<(), ArmError> {
        if !matches!(self.phase, Phase::Ready) {
            return Err(ArmError::NotNow(self.state()));
        }
        let target = Target { joints: joints_rad, at: Some(now) };
        if let Err(why) = self.allowed(&target) {
            let fault = ArmFault::RefusedTarget(why);
            self.fail(fault);
            return Err(fault.into());
        }
        self.target = Some(target);
        Ok(())
    }

    /// Whether a target that is given now is sent at the next [`poll`](Self::poll), without waiting
    /// for a tick or a reply.
    pub fn takes_target(&self, now: Duration) -> bool {
        let unsent = self.target.is_some_and(|target| target.at > self.sent_at());
        matches!(self.phase, Phase::Ready) && self.outstanding.is_none() && self.is_due(now) && !unsent
    }

    /// Time between two targets: the configured one, or a multiple that the link carries.
    pub fn servo_period(&self) -> Duration {
        self.link.period()
    }

    /// What the link carries.
    pub fn link_speed(&self) -> LinkSpeed {
        self.link.speed()
    }

    /// The fault of late replies, with how many there were.
    pub fn late_replies(&self) -> ArmFault {
        ArmFault::LateReplies { share: self.link.late_share(), gap: self.link.max_gap() }
    }

    /// Whether so many replies come late that the arm lags for that.
    pub fn has_late_replies(&self) -> bool {
        self.link.late_share() >= MANY_LATE
    }

    /// How long the arm has stood still because no target could be sent, if it has: the time since
    /// the last one.
    pub fn pause(&self, now: Duration) -> Option<Duration> {
        let since = now.saturating_sub(self.sent_at()?);
        (since > self.link.max_gap()).then_some(since)
    }

    /// Whether the link has been measured.
    pub fn has_measured_link(&self) -> bool {
        self.link.is_measured()
    }

    /// Measures the link while the arm stands and is sent no target: appends a question for its
    /// state, one at a time, at the times of targets. Call it before [`poll`](Self::poll).
    pub fn measure_link(&mut self, now: Duration, out: &mut Vec<u8>) {
        let stands = matches!(self.phase, Phase::Ready) && self.target.is_none();
        if stands && self.outstanding.is_none() && self.is_due(now) {
            self.next_tick = Some(now + self.link.period());
            self.request(now, Purpose::Link, Register::GetState, &[], out);
        }
    }

    /// Whether the targets after a pause that ends now come at a longer period. The motion then
    /// begins at rest.
    pub fn slows_down(&self, now: Duration) -> bool {
        self.link.lengthens(now)
    }

    /// A target is sent after a pause; if pauses recur, the ones after it at a longer period.
    pub fn resume(&mut self, now: Duration) {
        self.link.pause(now);
    }

    /// When a target was sent last; `None` before the first.
    pub fn sent_at(&self) -> Option<Duration> {
        self.sent.and_then(|sent| sent.at)
    }

    /// Moves the ticks to a quarter of a period after the grid on which targets are computed, so
    /// that each is sent once. The next tick comes no sooner than it would have.
    pub fn align(&mut self, now: Duration, grid: Duration) {
        let period = self.link.period();
        let earliest = self.next_tick.unwrap_or(now);
        let phase = (grid + period / 4).as_nanos() % period.as_nanos();
        let late = (phase + period.as_nanos() - earliest.as_nanos() % period.as_nanos()) % period.as_nanos();
        self.next_tick = Some(earliest + Duration::from_nanos(late as u64));
    }

    /// Lets the arm be guided by hand, or takes it back.
    ///
    /// # Errors
    /// If it is not ready, or was not guided by hand.
    pub fn manual(&mut self, now: Duration, on: bool) -> Result<(), ArmError> {
        let steps = match (self.phase, on) {
            (Phase::Ready, true) => steps::BY_HAND,
            (Phase::Manual, false) => steps::BACK,
            _ => return Err(ArmError::NotNow(self.state())),
        };
        self.work(now, steps);
        Ok(())
    }

    /// Stops the arm: appends the command at once, in every state, even if a request is
    /// outstanding. A fault stays a fault.
    pub fn stop(&mut self, now: Duration, out: &mut Vec<u8>) {
        if self.active() {
            self.phase = Phase::Stopped;
        }
        (self.target, self.sent) = (None, None);
        let since = self.halt.and_then(|halt| halt.since);
        self.halt = Some(Halt { since, again: now });
        self.send_halt(now, out);
        if matches!(self.phase, Phase::Disconnected | Phase::Fault(_, false)) {
            // Only the reports may be lost, and the command may arrive; no answer is expected.
            (self.halt, self.outstanding) = (None, None);
        }
    }

    /// Bytes from the report port.
    pub fn receive_report(&mut self, now: Duration, mut bytes: &[u8]) {
        let mut is_new = false;
        while let Some(report) = self.reports.next(&mut bytes) {
            let sent_before = self.report.and_then(|(before, _)| before.sent_at);
            if sent_before.is_some() && report.sent_at <= sent_before {
                // A repeated report is ignored; without a new one the arm is stopped soon.
                continue;
            }
            is_new = true;
            self.report = Some((report, now));
            self.report_delay.count(report.sent_at);
            self.check_report(&report, now);
        }
        if is_new {
            let by = self.report_delay.delay(now);
            if by.as_secs_f64() > self.config.report_stale_after_secs {
                self.fail(ArmFault::ReportsLate { by });
            }
        }
        if self.reports.skipped() > 0 && self.active() {
            self.fail(ArmFault::ProtocolNonsense("its reports are not"));
        }
    }

    /// Appends what to send to the command port now.
    pub fn poll(&mut self, now: Duration, out: &mut Vec<u8>) {
        self.check_times(now);
        if let Phase::Working(work) = self.phase {
            if self.outstanding.is_none() && now >= work.ask_at {
                self.take_step(now, work, out);
            }
        } else if matches!(self.phase, Phase::Ready) && self.target.is_some() {
            self.tick(now, out);
        }
        self.send_halt(now, out);
        if self.ask_error && self.outstanding.is_none() {
            self.ask_error = false;
            self.request(now, Purpose::WhichError, Register::Errors, &[], out);
        }
    }

    /// What the arm is doing.
    pub fn state(&self) -> ArmState {
        match self.phase {
            Phase::Disconnected => ArmState::Disconnected,
            Phase::Stopped => ArmState::Stopped,
            Phase::Working(_) => ArmState::Starting,
            Phase::Ready => ArmState::Ready,
            Phase::Manual => ArmState::Manual,
            Phase::Fault(fault, _) => ArmState::Fault(fault),
        }
    }

    /// The joints of the newest report, rad.
    pub fn joints(&self) -> Option<[f64; ARM_JOINTS]> {
        self.report.map(|(report, _)| report.joints_rad.map(f64::from))
    }

    /// When the newest report arrived.
    pub fn joints_at(&self) -> Option<Duration> {
        self.report.map(|(_, at)| at)
    }

    /// The flange for [`joints`](Self::joints), by our own kinematics.
    pub fn pose(&self) -> Option<Pose> {
        self.joints().map(|joints| kinematics::forward(&joints))
    }

    /// The newest report.
    pub fn report(&self) -> Option<&Report> {
        self.report.as_ref().map(|(report, _)| report)
    }

    /// The last target that was sent, rad.
    pub fn sent(&self) -> Option<[f64; ARM_JOINTS]> {
        self.sent.filter(|sent| sent.at.is_some()).map(|sent| sent.joints)
    }

    /// The version that the arm reports; known once started.
    pub fn version(&self) -> Option<&ArmVersion> {
        self.version.as_ref()
    }

    /// The arm's serial number; known once started.
    pub fn serial(&self) -> Option<&str> {
        self.serial.as_deref()
    }

    fn work(&mut self, now: Duration, steps: &'static [Step]) {
        (self.target, self.sent) = (None, None);
        self.phase = Phase::Working(Work { steps, at: 0, since: now, ask_at: now });
    }

    /// The mode of the newest report.
    fn mode(&self) -> u8 {
        self.report.map_or(0, |(report, _)| report.mode)
    }

    fn active(&self) -> bool {
        matches!(self.phase, Phase::Working(_) | Phase::Ready | Phase::Manual)
    }

    /// Latches a fault: commands the stop, and requests the error number.
    fn fail(&mut self, fault: ArmFault) {
        if !self.active() {
            return;
        }
        self.phase = Phase::Fault(fault, true);
        (self.target, self.sent) = (None, None);
        self.halt = Some(Halt { since: None, again: Duration::ZERO });
        self.ask_error = true;
    }

    /// Compares a new report with the expected state.
    fn check_report(&mut self, report: &Report, now: Duration) {
        let (state, mode) = (report.state, report.mode);
        if self.halt.is_some_and(|halt| halt.since.is_some_and(|since| now > since)) && state >= 4 {
            self.halt = None;
        }
        let wanted = match self.phase {
            Phase::Ready => SERVO,
            Phase::Manual => MANUAL,
            Phase::Working(work) if work.forbids(state) => {
                return self.fail(ArmFault::UnexpectedState { state, mode });
            }
            _ => return,
        };
        if mode != wanted || !(1..=2).contains(&state) {
            return self.fail(ArmFault::UnexpectedState { state, mode });
        }
        let Some(sent) = self.sent else { return };
        let (joint, by_rad) = largest_turn(&report.joints_rad.map(f64::from), &sent.joints);
        if by_rad > self.config.following_limit_rad {
            self.fail(ArmFault::NotFollowing { joint, by_rad });
        }
    }
}
