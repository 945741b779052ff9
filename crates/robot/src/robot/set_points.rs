//! The limited set-points, on their grid of [`SETPOINT_HZ`].

use std::time::Duration;

use super::axes::{AXES, RAIL_AXIS, driven, driven_index, period};
use super::fault::Fault;
use super::record::Record;
use super::slow_move::Easing;
use crate::allegro::WIRE_JOINTS;
use crate::limiter::{Axis, AxisLimits, Clamp};
use crate::rig_file::SETPOINT_HZ;

/// Largest distance from its range at which a joint of the hand may start, rad: backlash, and some
/// give of the stop.
const MAX_OUTSIDE_RAD: f64 = 0.1;

/// The limited set-points of all axes.
pub(super) struct SetPoints {
    axes: [Axis; AXES],
    /// Set-points before the last step, for the joint loop in between.
    before: [f64; AXES],
    /// The offsets of joints that started outside their ranges, which fade out.
    pub easing: Easing,
    /// When the last ones were due.
    stepped: Duration,
    /// How many were clamped, counted by joint.
    pub clamped: u64,
}

impl SetPoints {
    pub fn new(limits: &[AxisLimits; AXES]) -> Self {
        Self {
            axes: std::array::from_fn(|axis| Axis::at_rest(limits[axis], 1.0 / SETPOINT_HZ, 0.0)),
            before: [0.0; AXES],
            easing: Easing::new(Duration::ZERO, [0.0; AXES]),
            stepped: Duration::ZERO,
            clamped: 0,
        }
    }

    pub fn positions(&self) -> [f64; AXES] {
        self.axes.each_ref().map(Axis::position)
    }

    pub fn rail(&self) -> &Axis {
        &self.axes[RAIL_AXIS]
    }

    /// When the last ones were due.
    pub fn stepped(&self) -> Duration {
        self.stepped
    }

    /// These positions, or the nearest that the ranges allow.
    pub fn within_ranges(&self, mut positions: [f64; AXES]) -> [f64; AXES] {
        for (position, axis) in positions.iter_mut().zip(&self.axes) {
            let [low, high] = axis.limits().position;
            *position = position.clamp(low, high);
        }
        positions
    }

    /// Sets the set-points to the measured positions, at rest. Positions slightly outside a range
    /// are eased into it. How far each was outside.
    pub fn settle(&mut self, now: Duration, measured: [f64; AXES]) -> Result<[f64; AXES], Fault> {
        let mut outside = [0.0; AXES];
        let axes = self.axes.iter_mut().zip(&mut outside).zip(measured);
        for (joint, ((axis, outside), rad)) in axes.enumerate() {
            axis.rest(rad);
            *outside = rad - axis.position();
            if joint != RAIL_AXIS && outside.abs() > MAX_OUTSIDE_RAD {
                let [low, high] = axis.limits().position;
                return Err(Fault::OutsideRange { joint, rad, low, high });
            }
        }
        self.easing = Easing::new(now, outside);
        self.before = self.positions();
        self.stepped = now;
        Ok(outside)
    }

    /// Puts the rail's set-point, at rest, where it moves nothing: the arm is not on its path.
    pub fn move_rail(&mut self, rail_m: f64) {
        self.axes[RAIL_AXIS].rest(rail_m);
    }

    /// Puts the rail's set-point, at rest, where the arm has arrived.
    pub fn settle_rail(&mut self, rail_m: f64) {
        self.move_rail(rail_m);
        self.before = self.positions();
    }

    /// Takes the grid of a stream, so that each waypoint is due a whole period after its beginning,
    /// also if the first command comes a little late. At rest one shorter period does not matter.
    pub fn align(&mut self, begun: Duration) {
        let periods = self.stepped.saturating_sub(begun).as_nanos() / period().as_nanos();
        self.stepped = begun + period() * periods as u32;
    }

    /// The next set-points' time, once it has come. After a gap, missed ones are not made up for;
    /// the grid stays.
    pub fn next_due(&mut self, now: Duration) -> Option<Duration> {
        let gap = now.saturating_sub(self.stepped);
        if gap > 4 * period() {
            self.stepped += period() * ((gap.as_nanos() / period().as_nanos()) as u32 - 1);
        }
        (now.saturating_sub(self.stepped) >= period()).then(|| {
            self.stepped += period();
            self.stepped
        })
    }

    /// One step toward what is `asked`, or toward rest. The rail brakes if something holds it.
    pub fn step(&mut self, asked: Option<[f64; AXES]>, rail_held: Option<Clamp>) -> Record {
        self.before = self.positions();
        let mut clamps: Vec<(usize, Clamp)> = Vec::new();
        match &asked {
            None => self.axes.iter_mut().for_each(Axis::brake),
            Some(asked) => {
                for (index, (axis, target)) in self.axes.iter_mut().zip(asked).enumerate() {
                    let clamp = match rail_held {
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
        let sent = driven(&self.positions());
        let asked = asked.as_ref().map_or(sent, driven);
        Record::SetPoint { at: self.stepped, asked, sent, clamps }
    }

    /// Angles for the hand's joint loop, rad: between the last two set-points, with what is left of
    /// the easing.
    pub fn reference(&self, now: Duration) -> [f64; WIRE_JOINTS] {
        let since = now.saturating_sub(self.stepped).as_secs_f64();
        let share = (since * SETPOINT_HZ).clamp(0.0, 1.0);
        let left = self.easing.left(now);
        std::array::from_fn(|joint| {
            self.before[joint] + (self.axes[joint].position() - self.before[joint]) * share + left[joint]
        })
    }
}
