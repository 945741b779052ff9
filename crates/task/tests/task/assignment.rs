//! The assignment of fingers to keys against brute force: every way to give each finger a key or
//! none.

use etude_stage::FINGERS;
use etude_task::assign;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

/// Most keys served, then least distance, over all `(keys + 1)^FINGERS` choices of a key or nothing
/// for each finger.
fn brute_force(keys: &[f64], fingers: &[f64; FINGERS]) -> (usize, f64) {
    let choices = keys.len() + 1;
    let mut best = (0, f64::INFINITY);
    for code in 0..choices.pow(FINGERS as u32) {
        let choice: Vec<usize> = (0..FINGERS).map(|f| code / choices.pow(f as u32) % choices).collect();
        let twice = |f: usize| choice[f] > 0 && choice[..f].contains(&choice[f]);
        if (0..FINGERS).any(twice) {
            continue;
        }
        let pairs = choice.iter().zip(fingers).filter(|(key, _)| **key > 0);
        let served = pairs.clone().count();
        let cost: f64 = pairs.map(|(key, finger)| (keys[key - 1] - finger).abs()).sum();
        if served > best.0 || (served == best.0 && cost < best.1) {
            best = (served, cost);
        }
    }
    best
}

#[test]
fn the_assignment_is_the_best_there_is() {
    let mut random = Pcg64::seed_from_u64(5);
    for case in 0..4000 {
        let count = random.random_range(0..=8);
        // Half the cases on a grid, so that ties are common.
        let place = |random: &mut Pcg64| {
            if case % 2 == 0 {
                random.random_range(-0.3..0.3)
            } else {
                f64::from(random.random_range(-4i32..4)) * 0.023
            }
        };
        let keys: Vec<f64> = (0..count).map(|_| place(&mut random)).collect();
        let fingers: [f64; FINGERS] = std::array::from_fn(|_| place(&mut random));
        let mut chosen = vec![Some(9); count];
        assign(&keys, &fingers, &mut chosen);
        let mut used = [false; FINGERS];
        let mut cost = 0.0;
        for (key, finger) in chosen.iter().enumerate() {
            if let Some(finger) = *finger {
                assert!(!std::mem::replace(&mut used[finger], true), "finger {finger} twice in {chosen:?}");
                cost += (keys[key] - fingers[finger]).abs();
            }
        }
        let (served, least) = brute_force(&keys, &fingers);
        assert_eq!(chosen.iter().flatten().count(), served, "{keys:?} {fingers:?}");
        if served > 0 {
            assert!((cost - least).abs() < 1e-12, "{cost} and {least} for {keys:?} {fingers:?}");
        }
    }
}
