use super::*;
use crate::allegro::{PLAYING, PWM_LIMITS};

const PERIOD: Duration = Duration::from_millis(3);

/// What is found after `count` periods of `what`.
fn after(
    count: u32,
    what: impl Fn(u32) -> ([f64; WIRE_JOINTS], [f64; WIRE_JOINTS], [i16; WIRE_JOINTS]),
) -> Option<Implausible> {
    let mut plausibility = PlausibilityChecks::default();
    for period in 0..count {
        let (positions, reference, pwm) = what(period);
        plausibility.hand(PERIOD * period, &positions, &reference, &pwm, &PWM_LIMITS, [false; PLAYING]);
    }
    plausibility.found().cloned()
}

#[test]
fn a_finger_that_repeats_itself_is_found_and_one_at_rest_is_not() {
    let moving = |period: u32| [0.001 * f64::from(period); WIRE_JOINTS];
    let stuck = |finger: Option<usize>| {
        after(400, |period| {
            let mut positions = moving(period);
            if let Some(finger) = finger {
                positions[4 * finger..4 * finger + 4].fill(0.1);
            }
            (positions, moving(period), [0; WIRE_JOINTS])
        })
    };
    assert_eq!(stuck(None), None);
    let found = stuck(Some(2));
    assert!(matches!(found, Some(Implausible::FingerFrozen { finger: 2, .. })), "{found:?}");
    // One that rests, and sets out 60 ms after it was sent, does not.
    let late = after(400, |period| {
        let sent = |period: u32| 0.01 * f64::from(period.saturating_sub(200));
        ([sent(period.saturating_sub(20)); WIRE_JOINTS], [sent(period); WIRE_JOINTS], [0; WIRE_JOINTS])
    });
    assert_eq!(late, None);
    // One joint that stands is not the encoder's fault, and nobody is sent anywhere at rest.
    let one = after(400, |period| {
        let mut positions = moving(period);
        positions[5] = 0.1;
        (positions, moving(period), [0; WIRE_JOINTS])
    });
    assert_eq!(one, None);
    assert_eq!(after(4000, |_| ([0.1; WIRE_JOINTS], [0.1; WIRE_JOINTS], [0; WIRE_JOINTS])), None);
}

#[test]
fn a_joint_may_push_hard_but_not_for_long() {
    let pushing = |secs: u32, share: f64| {
        after(secs * 333, |period| {
            let mut pwm = [0; WIRE_JOINTS];
            pwm[9] = (f64::from(PWM_LIMITS[9]) * share) as i16;
            ([f64::from(period); WIRE_JOINTS], [f64::from(period); WIRE_JOINTS], pwm)
        })
    };
    assert_eq!(pushing(15, -1.0), None);
    assert!(matches!(pushing(18, -1.0), Some(Implausible::MotorHot { joint: 9, .. })));
    assert_eq!(pushing(120, 0.85), None, "three quarters of the heat");
}

#[test]
fn an_arm_away_from_the_keyboard_is_where_it_was_sent_or_stood() {
    let arm = |on_its_way: bool, what: &dyn Fn(f64) -> ([f64; 7], [f64; 7])| {
        let mut plausibility = PlausibilityChecks::default();
        for report in 0..200 {
            let (joints, sent) = what(f64::from(report) * 0.01);
            plausibility.arm_elsewhere(Duration::from_millis(10) * report, &joints, &sent, on_its_way);
        }
        plausibility.found().cloned()
    };
    // 0.15 s late at 0.3 rad/s.
    assert_eq!(arm(true, &|secs| ([0.3 * (secs - 0.15).max(0.0); 7], [0.3 * secs; 7])), None);
    let off = arm(true, &|secs| ([0.3 * (secs - 0.5); 7], [0.3 * secs; 7]));
    assert!(matches!(off, Some(Implausible::ArmOffPath { joint: 1, .. })), "{off:?}");
    let repeats = arm(true, &|secs| ([0.0; 7], [0.3 * secs; 7]));
    assert!(matches!(repeats, Some(Implausible::ArmFrozenOnPath { .. })), "{repeats:?}");
    assert_eq!(arm(false, &|_| ([0.1; 7], [0.1; 7])), None);
    let moved = arm(false, &|secs| ([0.1 + 0.05 * secs; 7], [0.1; 7]));
    assert!(matches!(moved, Some(Implausible::ArmOffPath { .. })), "{moved:?}");
}

#[test]
fn an_arm_that_stands_or_is_elsewhere_is_found() {
    let arm = |count: u32, what: &dyn Fn(f64) -> ([f64; 7], RailPlace, f64)| {
        let mut plausibility = PlausibilityChecks::default();
        for report in 0..count {
            let (joints, place, sent) = what(f64::from(report) * 0.01);
            plausibility.arm(Duration::from_millis(10) * report, &joints, &place, sent);
        }
        plausibility.found().cloned()
    };
    let place = |rail_m| RailPlace { rail_m, beside_m: 0.001, turned_rad: 0.01 };
    // 70 ms late at 0.8 m/s.
    assert_eq!(arm(60, &|secs| ([secs; 7], place(0.8 * (secs - 0.07)), 0.8 * secs)), None);
    let repeats = arm(60, &|secs| ([0.3; 7], place(0.0), 0.1 * secs));
    assert!(matches!(repeats, Some(Implausible::ArmFrozen { .. })), "{repeats:?}");
    let away = arm(60, &|secs| ([secs; 7], place(0.0), 0.021));
    assert!(matches!(away, Some(Implausible::ArmAway { .. })), "{away:?}");
    let beside = arm(60, &|secs| ([secs; 7], RailPlace { beside_m: 0.02, ..place(0.0) }, 0.0));
    assert!(matches!(beside, Some(Implausible::ArmAway { .. })), "{beside:?}");
    // A short knock is none.
    assert_eq!(arm(60, &|secs| ([secs; 7], place(if secs < 0.14 { 0.09 } else { 0.0 }), 0.0)), None);
    // Half a second after it was sent along the keyboard, it must be there.
    let stops = |behind: f64| {
        arm(120, &|secs| {
            (
                [secs; 7],
                place(0.5 * (secs - 0.1).clamp(0.0, 0.3) - if secs > 0.5 { behind } else { 0.0 }),
                0.5 * secs.min(0.3),
            )
        })
    };
    assert_eq!(stops(0.015), None);
    assert!(matches!(stops(0.045), Some(Implausible::ArmAway { .. })), "{:?}", stops(0.045));
    assert_eq!(arm(600, &|_| ([0.3; 7], place(0.0), 0.0)), None, "at rest");
}
