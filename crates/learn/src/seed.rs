//! One root seed, split by purpose.
//!
//! A purpose is a short text such as `"dropout/critic-0"`. Each purpose has its own stream, so that
//! adding one does not change the draws of the others.

/// The seed of `purpose` under `root`. It must never change, because recorded runs depend on it.
///
/// [`fnv`] over the bytes of the purpose, then two rounds of the
/// SplitMix64 finaliser (Steele, Lea, Flood 2014) that mix the root in.
pub fn split(root: u64, purpose: &str) -> u64 {
    const GOLDEN_GAMMA: u64 = 0x9e37_79b9_7f4a_7c15;
    finalise(finalise(root.wrapping_add(GOLDEN_GAMMA)) ^ fnv(purpose.as_bytes()))
}

/// FNV-1a: the same on every machine and in every version, which the standard library's hashes do
/// not promise (64 bit, <http://www.isthe.com/chongo/tech/comp/fnv/>).
pub fn fnv(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

fn finalise(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn purposes_and_roots_are_independent() {
        let mut seen = std::collections::HashSet::new();
        for root in 0..100 {
            for purpose in ["init", "replay", "dropout/critic-0", "dropout/critic-1", ""] {
                assert!(seen.insert(split(root, purpose)));
            }
        }
    }

    #[test]
    fn the_first_round_is_splitmix64() {
        // First output of SplitMix64 seeded with 0, from the reference implementation at
        // https://prng.di.unimi.it.
        assert_eq!(finalise(0x9e37_79b9_7f4a_7c15), 0xe220_a839_7b1d_cdaf);
    }
}
