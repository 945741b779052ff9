//! MIDI velocity of a strike, as keyboards measure it: by the time between a key's two contacts.
//!
//! The velocity falls evenly with the logarithm of that time. The times are judgements: no manual
//! of the Keystation gives them.

/// Travel between the first contact and the one at which a key sounds, as a share of the whole.
pub const CONTACTS_APART: f64 = 0.2;
/// Time between the contacts of the loudest strike, s.
pub const LOUDEST_SECS: f64 = 0.004;
/// The same of the softest, s.
pub const SOFTEST_SECS: f64 = 0.15;

/// Largest MIDI velocity.
const MAX_VELOCITY: f64 = 127.0;

/// A strike of a key in the simulator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Strike {
    /// The key (0 is the lowest C).
    pub key: usize,
    /// Its velocity on MIDI's scale but without its ends: above 127 for strikes that are harder
    /// than the loudest.
    pub unrounded_velocity: f64,
}

/// Velocity, 1 to 127, of a strike whose contacts close `between_secs` apart, where `loudest_secs`
/// and less is the loudest and `softest_secs` and more the softest.
pub fn strike_velocity(between_secs: f64, loudest_secs: f64, softest_secs: f64) -> u8 {
    midi(unrounded_velocity(between_secs, loudest_secs, softest_secs))
}

/// The velocity without the ends of MIDI's scale.
pub(crate) fn unrounded_velocity(between_secs: f64, loudest_secs: f64, softest_secs: f64) -> f64 {
    let share = (between_secs / loudest_secs).ln() / (softest_secs / loudest_secs).ln();
    MAX_VELOCITY - (MAX_VELOCITY - 1.0) * share
}

/// An unrounded velocity as MIDI velocity.
pub(crate) fn midi(unrounded_velocity: f64) -> u8 {
    unrounded_velocity.round().clamp(1.0, MAX_VELOCITY) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn velocity_falls_evenly_with_the_logarithm() {
        let velocity = |secs| strike_velocity(secs, LOUDEST_SECS, SOFTEST_SECS);
        assert_eq!([0.0, 0.004, 0.15, 1e9, f64::INFINITY].map(velocity), [127, 127, 1, 1, 1]);
        assert_eq!(velocity((LOUDEST_SECS * SOFTEST_SECS).sqrt()), 64);
        assert!(unrounded_velocity(0.001, LOUDEST_SECS, SOFTEST_SECS) > 150.0);
    }
}
