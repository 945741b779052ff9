//! Known parameters are recovered: see [`crate::synthetic`].

use crate::synthetic::recover;

#[test]
fn the_known_numbers_of_a_finger_come_back_to_the_noise() {
    let recovery = recover(&[1, 2], 1).unwrap();
    for end in &recovery.passes {
        println!("{}: {:.2?} after {} replays", end.pass.name(), end.rms, end.replays);
    }
    for (joint, [before, after]) in &recovery.held_out {
        println!("{joint}: {before:.2} to {after:.2} times the noise");
        assert!(*before > 5.0 && *after < 1.1, "{joint}");
    }
    println!("median error {:.4}, coverage {:.3}", recovery.median_error(), recovery.coverage());
    // Two joints with seven parameters each. Of 14 intervals of 95 % fewer than 11 cover with a probability of 1 in 240.
    assert_eq!(recovery.numbers.len(), 14);
    assert!(recovery.median_error() < 0.02 && recovery.coverage() >= 11.0 / 14.0);
}
