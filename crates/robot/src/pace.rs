//! How time passes for a robot: by the wall clock over wires, or as fast as a twin can be computed.

use std::time::{Duration, Instant};

use crate::robot::Robot;
use crate::wires::Wires;

/// Lets time pass for a robot and keeps it polled.
pub trait Pace {
    /// The time now, since the start of the program.
    fn now(&self) -> Duration;

    /// Polls the robot until the time is `until`; returns at once if it is later already.
    fn run_until(&mut self, robot: &mut Robot, until: Duration);

    /// Does `work`, which may take long, while the robot is polled by the wall clock. For a twin in
    /// lockstep no time passes meanwhile.
    fn run_while(&mut self, robot: &mut Robot, work: &mut (dyn FnMut() + Send)) {
        let _ = robot;
        work();
    }

    /// The robot's wires.
    fn wires(&mut self) -> &mut dyn Wires;
}

/// Time between two polls of a robot over wires. The hand sends its positions every 3 ms.
const POLL: Duration = Duration::from_micros(250);

/// Real time over wires.
pub struct RealTime<W> {
    started: Instant,
    wires: W,
}

impl<W: Wires> RealTime<W> {
    /// Time begins now.
    pub fn new(wires: W) -> Self {
        Self { started: Instant::now(), wires }
    }
}

impl<W: Wires> Pace for RealTime<W> {
    fn now(&self) -> Duration {
        self.started.elapsed()
    }

    fn run_until(&mut self, robot: &mut Robot, until: Duration) {
        loop {
            let now = self.now();
            robot.poll(now, &mut self.wires);
            let Some(left) = until.checked_sub(now).filter(|left| !left.is_zero()) else { return };
            std::thread::sleep(left.min(POLL));
        }
    }

    fn wires(&mut self) -> &mut dyn Wires {
        &mut self.wires
    }
}
