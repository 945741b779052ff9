//! Which finger plays which key: the assignment behind the optimal-transport reward.

use etude_stage::FINGERS;

/// Assigns fingers to keys so that the summed lateral distance is smallest.
///
/// `keys` and `fingers` are lateral positions along the keyboard, m. `chosen[i]` becomes the finger
/// for `keys[i]`. Each finger is assigned to at most one key; with more keys than fingers, the keys
/// that cost most get none. The search is exhaustive and so exact; ties go to the lower finger.
///
/// The cost is the lateral distance alone, as in the paper ("Reward Design"): a low finger is not
/// preferred over a higher one right above the key.
pub fn assign(keys: &[f64], fingers: &[f64; FINGERS], chosen: &mut [Option<usize>]) {
    let mut best = (0, f64::INFINITY);
    let mut current = [None; MAX_KEYS];
    let count = keys.len().min(chosen.len()).min(MAX_KEYS);
    search(&keys[..count], fingers, 0, 0, (0, 0.0), &mut current, &mut best, chosen);
    for slot in chosen.iter_mut().skip(count) {
        *slot = None;
    }
}

/// Keys beyond this many are ignored: a chord that three fingers can play has fewer.
const MAX_KEYS: usize = 8;

#[allow(clippy::too_many_arguments)] // A recursion over plain state reads better than a struct for it.
fn search(
    keys: &[f64],
    fingers: &[f64; FINGERS],
    index: usize,
    used: u32,
    (served, cost): (usize, f64),
    current: &mut [Option<usize>; MAX_KEYS],
    best: &mut (usize, f64),
    chosen: &mut [Option<usize>],
) {
    if index == keys.len() {
        if served > best.0 || (served == best.0 && cost < best.1) {
            *best = (served, cost);
            chosen[..keys.len()].copy_from_slice(&current[..keys.len()]);
        }
        return;
    }
    for finger in (0..FINGERS).filter(|f| used & (1 << f) == 0) {
        current[index] = Some(finger);
        let distance = (keys[index] - fingers[finger]).abs();
        search(
            keys,
            fingers,
            index + 1,
            used | (1 << finger),
            (served + 1, cost + distance),
            current,
            best,
            chosen,
        );
    }
    let free = FINGERS - used.count_ones() as usize;
    if free < keys.len() - index {
        current[index] = None;
        search(keys, fingers, index + 1, used, (served, cost), current, best, chosen);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assigned(keys: &[f64], fingers: [f64; FINGERS]) -> Vec<Option<usize>> {
        let mut chosen = vec![None; keys.len()];
        assign(keys, &fingers, &mut chosen);
        chosen
    }

    #[test]
    fn one_key_goes_to_the_nearest_finger() {
        assert_eq!(assigned(&[0.03], [-0.04, 0.0, 0.04]), [Some(2)]);
        assert_eq!(assigned(&[], [-0.04, 0.0, 0.04]), []);
    }

    #[test]
    fn two_keys_share_the_fingers_without_conflict() {
        assert_eq!(assigned(&[0.01, 0.02], [-0.04, 0.0, 0.04]), [Some(1), Some(2)]);
    }

    #[test]
    fn keys_beyond_the_fingers_stay_without_one() {
        let chosen = assigned(&[0.0, 0.04, 0.5, -0.04], [-0.04, 0.0, 0.04]);
        assert_eq!(chosen, [Some(1), Some(2), None, Some(0)]);
        assert_eq!(assigned(&[0.0; 12], [0.0; 3]).iter().flatten().count(), 3);
    }
}
