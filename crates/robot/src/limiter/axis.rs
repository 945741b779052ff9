//! The set-point of one joint, which moves on the grid toward its targets.

use super::axis_state::{AxisState, ROUNDING};
use super::clamp::Clamp;
use super::limits::AxisLimits;

/// Steps of the search for the best admissible acceleration: 2⁻²⁰ of what the jerk allows in one
/// step is far below what a device resolves.
const SEARCH: usize = 20;

/// The set-point of one joint.
#[derive(Clone, Debug)]
pub struct Axis {
    limits: AxisLimits,
    step_secs: f64,
    state: AxisState,
    /// The last three targets, newest first: they distinguish a moving target from one that jumped.
    targets: [f64; 3],
}

impl Axis {
    /// An axis at rest at `position` (moved into the range), whose set-point is computed every
    /// `step_secs`.
    pub fn at_rest(limits: AxisLimits, step_secs: f64, position: f64) -> Self {
        let mut axis = Self { limits, step_secs, state: AxisState::default(), targets: [0.0; 3] };
        axis.rest(position);
        axis
    }

    /// Back to rest at `position`, moved into the range; the middle of the range if it is not
    /// finite.
    pub fn rest(&mut self, position: f64) {
        let [low, high] = self.limits.position;
        let position = if position.is_nan() { (low + high) / 2.0 } else { position.clamp(low, high) };
        self.state = AxisState { position, ..AxisState::default() };
        self.targets = [position; 3];
    }

    /// There was no step for `secs`: it has braked meanwhile, as far as its limits allow. From here
    /// on a step takes `step_secs`.
    pub fn pause(&mut self, secs: f64, step_secs: f64) {
        let has_changed = std::mem::replace(&mut self.step_secs, step_secs) != step_secs;
        if secs > 0.0 {
            let left = self.state.velocity.abs() - self.limits.acceleration * secs;
            let velocity = left.max(0.0).copysign(self.state.velocity);
            self.state = AxisState { velocity, acceleration: 0.0, ..self.state };
        } else if !has_changed {
            return;
        }
        if self.state.velocity == 0.0 || !self.state.is_viable(&self.limits, step_secs) {
            self.rest(self.state.position);
        }
    }

    /// Its limits.
    pub fn limits(&self) -> &AxisLimits {
        &self.limits
    }

    /// The set-point that was computed last.
    pub fn position(&self) -> f64 {
        self.state.position
    }

    /// Velocity of the set-point over the last step.
    pub fn velocity(&self) -> f64 {
        self.state.velocity
    }

    /// Where it comes to rest if it brakes from now on.
    pub fn stop_position(&self) -> f64 {
        let states = self.state.braking(&self.limits, self.step_secs);
        states.last().map_or(self.state.position, |state| state.position)
    }

    /// Moves the set-point one step toward `target`; returns the limit that kept it from reaching
    /// it, if it did not.
    pub fn step(&mut self, target: f64) -> Option<Clamp> {
        let [low, high] = self.limits.position;
        let asked = if target.is_nan() { self.targets[0] } else { target };
        let wanted = asked.clamp(low, high);
        self.targets = [wanted, self.targets[0], self.targets[1]];
        let dt = self.step_secs;
        let exact = ((wanted - self.state.position) / dt - self.state.velocity) / dt;
        let on_stream = wanted != self.targets[1]
            && (self.state.position - self.targets[1]).abs() <= (high - low) * ROUNDING;
        let next = self.state.after(exact, dt);
        let passing = || (!on_stream && self.passes(wanted, next)).then_some(Clamp::Passing);
        let mut clamp = self.reason_against(exact).or_else(passing);
        self.state = if clamp.is_none() { next } else { self.toward(wanted) };
        if (self.state.position - wanted).abs() <= (high - low) * ROUNDING {
            clamp = None;
        }
        if target.is_nan() {
            Some(Clamp::NotANumber)
        } else if asked != wanted {
            Some(Clamp::Position)
        } else {
            clamp
        }
    }

    /// Moves the set-point one step toward rest, as fast as the limits allow.
    pub fn brake(&mut self) {
        self.state = self.state.brake(&self.limits, self.step_secs);
        self.targets = [self.state.position; 3];
    }

    /// The first limit that a step with this acceleration would break.
    fn reason_against(&self, acceleration: f64) -> Option<Clamp> {
        let next = self.state.after(acceleration, self.step_secs);
        let slack = 1.0 + ROUNDING;
        let ramp = self.limits.jerk * self.step_secs;
        if next.velocity.abs() > self.limits.velocity * slack {
            Some(Clamp::Velocity)
        } else if acceleration.abs() > self.limits.acceleration * slack {
            Some(Clamp::Acceleration)
        } else if (acceleration - self.state.acceleration).abs() > ramp * slack {
            Some(Clamp::Jerk)
        } else if !next.is_viable(&self.limits, self.step_secs) {
            Some(Clamp::Stopping)
        } else {
            None
        }
    }

    /// The viable state nearest to one that catches up with the target as fast as possible without
    /// passing it.
    fn toward(&self, target: f64) -> AxisState {
        let dt = self.step_secs;
        let ramp = self.limits.jerk * dt;
        let most = self.limits.acceleration;
        let lowest = (self.state.acceleration - ramp).max(-most);
        let highest = (self.state.acceleration + ramp).min(most);
        let direction = (target - self.state.position).signum();
        let passes = |acceleration: f64| self.passes(target, self.state.after(acceleration, dt));
        let (slowest, fastest) = if direction > 0.0 { (lowest, highest) } else { (highest, lowest) };
        let wanted = if !passes(fastest) { fastest } else { last_that(slowest, fastest, |a| !passes(a)) };
        let viable = |acceleration: f64| self.state.after(acceleration, dt).is_viable(&self.limits, dt);
        let safe = self.state.brake(&self.limits, dt);
        if viable(wanted) {
            self.state.after(wanted, dt)
        } else {
            let best = last_that(safe.acceleration, wanted, viable);
            if best == safe.acceleration { safe } else { self.state.after(best, dt) }
        }
    }

    /// Whether braking from `next` passes `target`, seen from a target that moves on as it did.
    fn passes(&self, target: f64, next: AxisState) -> bool {
        let relative = AxisState { velocity: next.velocity - self.target_velocity(), ..next };
        let direction = (target - self.state.position).signum();
        let slack = (target.abs() + 1.0) * ROUNDING;
        relative
            .braking(&self.limits, self.step_secs)
            .any(|state| (state.position - target) * direction > slack)
    }

    /// Speed of the target over the last two steps; zero if it jumped or turned.
    fn target_velocity(&self) -> f64 {
        let [newest, middle, oldest] = self.targets;
        let (last, before) = (newest - middle, middle - oldest);
        if last * before <= 0.0 {
            return 0.0;
        }
        let speed = last.abs().min(before.abs()).copysign(last) / self.step_secs;
        speed.clamp(-self.limits.velocity, self.limits.velocity)
    }
}

/// The value closest to `to` for which `holds` was seen to hold, searched by halving from `from`;
/// `from` if for none.
fn last_that(from: f64, to: f64, holds: impl Fn(f64) -> bool) -> f64 {
    let (mut good, mut bad) = (from, to);
    for _ in 0..SEARCH {
        let middle = (good + bad) / 2.0;
        if holds(middle) {
            good = middle;
        } else {
            bad = middle;
        }
    }
    good
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const STEP: f64 = 0.005;

    fn finger() -> AxisLimits {
        AxisLimits { position: [-0.196, 1.61], velocity: 7.0, acceleration: 500.0, jerk: 100_000.0 }
    }

    fn rail() -> AxisLimits {
        AxisLimits { position: [-0.337, 0.337], velocity: 0.8, acceleration: 7.5, jerk: 1500.0 }
    }

    fn slow() -> AxisLimits {
        AxisLimits { position: [-1.0, 1.0], velocity: 0.5, acceleration: 2.0, jerk: 20.0 }
    }

    fn any_limits() -> impl Strategy<Value = AxisLimits> {
        let drawn = (0.01f64..3.0, 0.05f64..10.0, 0.5f64..1000.0, 1.0f64..300_000.0);
        let drawn = drawn.prop_map(|(half, velocity, acceleration, jerk)| AxisLimits {
            position: [-half, half],
            velocity,
            acceleration,
            jerk,
        });
        prop_oneof![Just(finger()), Just(rail()), Just(slow()), drawn]
    }

    fn any_target() -> impl Strategy<Value = f64> {
        prop_oneof![
            8 => -2.0f64..2.0,
            2 => -0.4f64..0.4,
            1 => any::<f64>(),
            1 => Just(f64::NAN),
            1 => Just(f64::INFINITY),
            1 => Just(f64::NEG_INFINITY),
        ]
    }

    fn assert_kept(limits: &AxisLimits, sent: &[f64]) {
        let [low, high] = limits.position;
        let slack = 1.0 + 1e-6;
        let mut before = [0.0; 2];
        for pair in sent.windows(2) {
            assert!(pair[1] >= low - 1e-8 * (high - low) && pair[1] <= high + 1e-8 * (high - low));
            let velocity = (pair[1] - pair[0]) / STEP;
            let acceleration = (velocity - before[0]) / STEP;
            let jerk = (acceleration - before[1]) / STEP;
            // Differences of rounded numbers, taken three times.
            let noise = [1e-13 / STEP, 1e-12 / STEP / STEP, 1e-12 / STEP / STEP / STEP];
            assert!(velocity.abs() <= limits.velocity * slack + noise[0], "velocity {velocity}");
            assert!(
                acceleration.abs() <= limits.acceleration * slack + noise[1],
                "acceleration {acceleration}"
            );
            assert!(jerk.abs() <= limits.jerk * slack + noise[2], "jerk {jerk}");
            before = [velocity, acceleration];
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 400, ..Default::default() })]
        #[test]
        fn nothing_that_is_asked_breaks_a_limit(
            limits in any_limits(),
            start in -1.0f64..1.0,
            asked in prop::collection::vec((any_target(), 1usize..40, prop::bool::weighted(0.05)), 1..20),
        ) {
            let mut axis = Axis::at_rest(limits, STEP, start);
            let mut sent = vec![axis.position(); 2];
            for (target, steps, brake) in asked {
                for _ in 0..steps {
                    if brake { axis.brake() } else { axis.step(target); }
                    sent.push(axis.position());
                }
            }
            assert_kept(&limits, &sent);
        }

        #[test]
        fn noise_breaks_no_limit(limits in any_limits(), asked in prop::collection::vec(any_target(), 1..200)) {
            let mut axis = Axis::at_rest(limits, STEP, 0.0);
            let mut sent = vec![axis.position(); 2];
            for target in asked {
                axis.step(target);
                sent.push(axis.position());
            }
            assert_kept(&limits, &sent);
        }

        /// What is not named went through unchanged.
        #[test]
        fn every_difference_is_named(
            limits in any_limits(),
            asked in prop::collection::vec(prop_oneof![any_target(), -0.01f64..0.01], 1..200),
        ) {
            let mut axis = Axis::at_rest(limits, STEP, 0.0);
            let slack = (limits.position[1] - limits.position[0]) * 1e-8;
            for target in asked {
                let clamp = axis.step(target);
                let there = (axis.position() - target).abs() <= slack;
                prop_assert!(clamp.is_some() || there, "at {} of {}", axis.position(), target);
            }
        }

        #[test]
        fn a_target_that_stands_still_is_reached_without_passing_it(limits in any_limits(), start in -0.9f64..0.9, end in -0.9f64..0.9) {
            let [low, high] = limits.position;
            let place = |fraction: f64| low + (high - low) * (fraction + 1.0) / 2.0;
            let (start, end) = (place(start), place(end));
            let mut axis = Axis::at_rest(limits, STEP, start);
            let direction = (end - start).signum();
            let mut furthest = start;
            for _ in 0..20_000 {
                axis.step(end);
                if axis.position() * direction > furthest * direction { furthest = axis.position(); }
                if (axis.position() - end).abs() < 1e-9 && axis.velocity().abs() < 1e-9 { break; }
            }
            prop_assert!((axis.position() - end).abs() < 1e-6, "{} instead of {end}", axis.position());
            let passed = (furthest - end) * direction;
            prop_assert!(passed < 1e-6 + limits.jerk * STEP.powi(3), "passed it by {passed}");
            prop_assert!(passed < 1e-6 || (end - start).abs() <= limits.jerk * STEP.powi(3), "passed it by {passed}");
        }
    }

    #[test]
    fn a_stream_within_the_limits_passes_unchanged() {
        let mut axis = Axis::at_rest(rail(), STEP, 0.0);
        for step in 0..1000 {
            // 5 cm and back twice a second: at most 0.31 m/s and 2 m/s², and starting without a
            // jerk.
            let secs = f64::from(step) * STEP;
            let target = 0.05 * (1.0 - (std::f64::consts::TAU * secs).cos()) * (secs / 2.0).min(1.0);
            assert_eq!(axis.step(target), None, "at {secs} s");
            assert!((axis.position() - target).abs() < 1e-12);
        }
    }

    #[test]
    fn a_step_takes_about_the_least_time_that_the_limits_allow() {
        let limits = rail();
        let mut axis = Axis::at_rest(limits, STEP, 0.0);
        let distance: f64 = 0.2;
        let steps = (1..1000).find(|_| {
            axis.step(distance);
            (axis.position() - distance).abs() < 1e-4
        });
        // Accelerate, cruise, brake; the jerk limit costs a few milliseconds at each corner.
        let ideal = distance / limits.velocity + limits.velocity / limits.acceleration;
        let secs = steps.unwrap() as f64 * STEP;
        assert!(secs < ideal + 0.05, "{secs} s, at least {ideal} s");
    }

    #[test]
    fn a_moving_target_is_caught_up_with() {
        let mut axis = Axis::at_rest(rail(), STEP, -0.3);
        let mut behind = f64::INFINITY;
        for step in 0..300 {
            let target = -0.25 + 0.2 * f64::from(step) * STEP;
            axis.step(target);
            behind = target - axis.position();
        }
        assert!(behind.abs() < 1e-6, "{behind} m behind");
    }

    #[test]
    fn clamps_are_named() {
        let mut axis = Axis::at_rest(rail(), STEP, 0.0);
        assert_eq!(axis.step(f64::NAN), Some(Clamp::NotANumber));
        assert_eq!(axis.step(1.0), Some(Clamp::Position));
        axis.rest(0.0);
        assert_eq!(axis.step(0.1), Some(Clamp::Velocity));
        axis.rest(0.0);
        assert_eq!(axis.step(0.001), Some(Clamp::Acceleration));
        let mut axis = Axis::at_rest(slow(), STEP, 0.0);
        assert_eq!(axis.step(0.000_01), Some(Clamp::Jerk));
        // Within every limit, and yet it would be passed if it stood still from now on.
        let mut axis = Axis::at_rest(finger(), STEP, 0.0);
        let mut passing = 0;
        for target in (1..100).map(|n| f64::from(n) * 5e-4) {
            axis.rest(0.0);
            axis.step(0.02);
            passing += usize::from(axis.step(target) == Some(Clamp::Passing));
        }
        assert!(passing > 0);
    }
}
