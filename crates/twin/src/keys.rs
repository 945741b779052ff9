//! Keys with two contacts, as a real keyboard's. The first closes early in a key's travel, the
//! second deeper.
//!
//! A key sounds when its second contact closes; the sooner that comes after the first, the louder.
//! It stops sounding when its first contact opens again; only then can it sound again. The contacts
//! are sampled once a millisecond.

use std::time::Duration;

use etude_music::KEY_COUNT;
use etude_stage::strike_velocity;

use crate::hidden_params::{KeyParams, STEP};

/// An event of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum KeyEvent {
    /// It sounds, with this MIDI velocity.
    Press(u8),
    /// It stops sounding.
    Release,
}

/// Where a key is between its contacts.
#[derive(Clone, Copy, Debug, Default)]
enum Contacts {
    /// Both are open.
    #[default]
    Open,
    /// The first one closed at this time.
    First(Duration),
    /// Both have closed, and the first is closed still.
    Sounding,
}

/// The contacts of all keys.
pub(crate) struct Keys {
    first: f64,
    pub(crate) second: [f64; KEY_COUNT],
    loudest_secs: f64,
    softest_secs: f64,
    contacts: [Contacts; KEY_COUNT],
}

impl Keys {
    /// Keys whose second contacts are at `second`, as shares of travel.
    pub(crate) fn new(keys: &KeyParams, second: [f64; KEY_COUNT]) -> Self {
        Self {
            first: keys.first_contact,
            second,
            loudest_secs: keys.loudest_secs,
            softest_secs: keys.softest_secs,
            contacts: [Contacts::Open; KEY_COUNT],
        }
    }

    /// Samples all keys, which are down by `travel` (a share), and passes their events to `emit`.
    pub(crate) fn update(
        &mut self,
        now: Duration,
        travel: impl Fn(usize) -> f64,
        mut emit: impl FnMut(usize, KeyEvent),
    ) {
        for key in 0..KEY_COUNT {
            let travel = travel(key);
            let (first, second) = (travel >= self.first, travel >= self.second[key]);
            let begun = match self.contacts[key] {
                Contacts::First(begun) => begun,
                _ => now,
            };
            self.contacts[key] = match self.contacts[key] {
                Contacts::Sounding if first => Contacts::Sounding,
                Contacts::Sounding => {
                    emit(key, KeyEvent::Release);
                    Contacts::Open
                }
                _ if second => {
                    emit(key, KeyEvent::Press(self.velocity(now.saturating_sub(begun))));
                    Contacts::Sounding
                }
                _ if first => Contacts::First(begun),
                _ => Contacts::Open,
            };
        }
    }

    /// MIDI velocity of a key whose contacts closed so far apart.
    fn velocity(&self, between: Duration) -> u8 {
        strike_velocity(between.max(STEP).as_secs_f64(), self.loudest_secs, self.softest_secs)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn keys() -> Keys {
        Keys::new(&KeyParams::default(), [0.5; KEY_COUNT])
    }

    /// What key 7 says while it goes through these places, one a millisecond.
    fn said(places: &[f64]) -> Vec<(usize, KeyEvent)> {
        let (mut keys, mut said) = (keys(), Vec::new());
        for (millis, place) in places.iter().enumerate() {
            let travel = |key: usize| if key == 7 { *place } else { 0.1 };
            keys.update(Duration::from_millis(millis as u64), travel, |key, say| {
                assert_eq!(key, 7);
                said.push((millis, say));
            });
        }
        said
    }

    #[test]
    fn a_key_sounds_at_the_second_contact_and_until_the_first_opens() {
        let places = [0.0, 0.2, 0.35, 0.45, 0.55, 0.9, 0.45, 0.6, 0.31, 0.29, 0.0];
        let said = said(&places);
        assert_eq!(said.len(), 2, "{said:?}");
        assert!(matches!(said[0], (4, KeyEvent::Press(_))));
        assert_eq!(said[1], (9, KeyEvent::Release));
    }

    #[test]
    fn a_key_that_turns_back_between_its_contacts_says_nothing() {
        assert_eq!(said(&[0.0, 0.4, 0.49, 0.2, 0.45, 0.0]), []);
    }

    #[test]
    fn velocity_is_the_time_between_the_contacts() {
        let keys = keys();
        let velocity = |millis: u64| keys.velocity(Duration::from_millis(millis));
        assert_eq!([velocity(0), velocity(4), velocity(150), velocity(100_000)], [127, 127, 1, 1]);
        // Half way by the logarithm.
        assert!((63..=65).contains(&keys.velocity(Duration::from_secs_f64((0.004f64 * 0.15).sqrt()))));
        let slow: Vec<_> = (0..100).map(|step| f64::from(step) * 0.01).collect();
        let fast: Vec<_> = (0..20).map(|step| f64::from(step) * 0.05).collect();
        let (KeyEvent::Press(slow), KeyEvent::Press(fast)) = (said(&slow)[0].1, said(&fast)[0].1) else {
            panic!()
        };
        assert!(slow < fast, "{slow} {fast}");
    }

    proptest! {
        #[test]
        fn presses_and_releases_alternate(places in prop::collection::vec(-0.2..1.2f64, 1..200)) {
            let said = said(&places);
            for (number, (_, say)) in said.iter().enumerate() {
                match say {
                    KeyEvent::Press(velocity) => prop_assert!(number % 2 == 0 && (1..=127).contains(velocity)),
                    KeyEvent::Release => prop_assert!(number % 2 == 1),
                }
            }
        }
    }
}
