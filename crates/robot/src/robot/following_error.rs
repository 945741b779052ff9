//! Checks that the hand's joints follow their references: a joint that is blocked, or whose motor
//! has failed, does not.

use std::time::Duration;

use crate::allegro::{JOINT_LIMITS_RAD, WIRE_JOINTS};
use crate::rig_file::LimitsConfig;

/// Share of a joint's range that it may be from its reference at most: a joint with a short range
/// could otherwise be blocked at its stop without ever being far enough.
const MAX_SHARE_OF_RANGE: f64 = 0.25;

/// Watches how far each joint of the hand is from its reference, and for how long.
#[derive(Clone, Debug, Default)]
pub(super) struct FollowingError {
    far_since: [Option<Duration>; WIRE_JOINTS],
    found: Option<(usize, f64)>,
}

impl FollowingError {
    /// Takes a period's angles and where they should have been, rad.
    pub fn take(
        &mut self,
        at: Duration,
        positions: &[f64; WIRE_JOINTS],
        reference: &[f64; WIRE_JOINTS],
        limits: &LimitsConfig,
    ) {
        let pairs = positions.iter().zip(reference);
        for (joint, (since, (position, reference))) in self.far_since.iter_mut().zip(pairs).enumerate() {
            let by_rad = (position - reference).abs();
            let [low, high] = JOINT_LIMITS_RAD[joint];
            if by_rad <= limits.following_rad.min(MAX_SHARE_OF_RANGE * (high - low)) {
                *since = None;
                continue;
            }
            let age = at.saturating_sub(*since.get_or_insert(at));
            if age.as_secs_f64() > limits.following_secs {
                self.found = Some((joint, by_rad));
            }
        }
    }

    /// A joint, as on the wire, that has been far from its reference for too long, and how far,
    /// rad.
    pub fn found(&self) -> Option<(usize, f64)> {
        self.found
    }
}

/// The joint that is farthest from where it should be, and how far, rad.
pub(super) fn farthest(positions: &[f64; WIRE_JOINTS], reference: &[f64]) -> (usize, f64) {
    let far = positions.iter().zip(reference).map(|(position, reference)| (position - reference).abs());
    far.enumerate().fold((0, 0.0), |most, far| if far.1 > most.1 { far } else { most })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_who_stays_away_is_lost() {
        let limits = LimitsConfig { following_secs: 0.5, ..LimitsConfig::default() };
        let at = Duration::from_millis;
        let mut following = FollowingError::default();
        let mut positions = [0.0; WIRE_JOINTS];
        let mut take = |following: &mut FollowingError, millis: u64, rad: f64| {
            positions[5] = rad;
            following.take(at(millis), &positions, &[0.1; WIRE_JOINTS], &limits);
            following.found()
        };
        assert_eq!(take(&mut following, 0, 0.8), None);
        assert_eq!(take(&mut following, 499, 0.8), None);
        // It was back in between.
        assert_eq!(take(&mut following, 502, 0.2), None);
        for millis in (505..=1005).step_by(3) {
            assert_eq!(take(&mut following, millis, -0.6), None, "{millis}");
        }
        let lost = take(&mut following, 1009, -0.6).unwrap();
        assert!(lost.0 == 5 && (lost.1 - 0.7).abs() < 1e-9);
        assert_eq!(farthest(&positions, &[0.0; 17]), (5, 0.6));
    }
}
