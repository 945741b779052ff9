//! Saved state: continuing is the same as not stopping, and bytes that are no saved state are
//! refused, never a panic and never the end of the process.

use etude_learn::VectorEnvironment as _;
use etude_task::{PianoVectorEnv, TaskConfig};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use crate::bench::{Actions, nominal, play, restless, short_piece};

const ENVS: usize = 3;

fn piano(config: &TaskConfig, seed: u64) -> PianoVectorEnv {
    PianoVectorEnv::new(config, &short_piece(), ENVS, seed).unwrap()
}

#[test]
fn save_load_continue_equals_not_stopping() {
    for config in [nominal(), restless()] {
        // In silence, while keys are touched, around the song's end, and in a later episode.
        for stop in [0, 7, 14, 22, 30, 31, 50] {
            let mut stayed = piano(&config, 5);
            let mut actions = Actions::new(ENVS, stop);
            play(&mut stayed, &mut actions, stop as usize);
            let saved = stayed.save_state();
            let rest: Vec<Vec<f32>> = (0..45).map(|_| actions.next().to_vec()).collect();
            // Into a fresh one of another seed that has already been somewhere else.
            let mut resumed = piano(&config, 6);
            play(&mut resumed, &mut Actions::new(ENVS, 99), 9);
            resumed.load_state(&saved).unwrap();
            assert_eq!(resumed.save_state(), saved, "saving again gives the same bytes");
            let (mut a, mut b) = (crate::bench::batch(&stayed), crate::bench::batch(&stayed));
            for (step, actions) in rest.iter().enumerate() {
                stayed.step(actions, &mut a);
                resumed.step(actions, &mut b);
                assert!(a == b, "stopped at {stop}, differs {step} steps later");
            }
            assert!(stayed.save_state() == resumed.save_state());
        }
    }
}

#[test]
fn bytes_that_are_no_state_are_refused() {
    let mut piano = piano(&restless(), 1);
    let saved = piano.save_state();
    for bytes in [
        &b""[..],
        b"\n\n",
        b"{}\n{}\n{}",
        b"null\nnull\nnull",
        b"\xff\xfe\n\x00\n[",
        &saved[..saved.len() / 2],
    ] {
        assert!(piano.load_state(bytes).is_err(), "{:?}", String::from_utf8_lossy(bytes));
    }
    let mut two = PianoVectorEnv::new(&restless(), &short_piece(), 2, 1).unwrap();
    let message = two.load_state(&saved).unwrap_err().to_string();
    assert!(message.contains('3') && message.contains('2'), "{message}");
}

/// Random damage: some of it is refused, the rest is another valid state; the worlds step on in any
/// case.
#[test]
fn damaged_states_are_refused_or_played_but_never_panic() {
    let mut piano = piano(&restless(), 1);
    play(&mut piano, &mut Actions::new(ENVS, 3), 12);
    let saved = piano.save_state();
    let mut random = Pcg64::seed_from_u64(17);
    let mut refused = 0;
    for _ in 0..300 {
        let mut bytes = saved.clone();
        for _ in 0..random.random_range(1..4) {
            let place = random.random_range(0..bytes.len());
            match random.random_range(0..4) {
                0 => bytes[place] = random.random_range(0..=255),
                1 => bytes[place] = b"0123456789-.e,[]"[random.random_range(0..16)],
                2 => drop(bytes.drain(place..(place + random.random_range(1..20)).min(bytes.len()))),
                _ => bytes.insert(place, b"0123456789"[random.random_range(0..10)]),
            }
            if bytes.is_empty() {
                break;
            }
        }
        refused += usize::from(piano.load_state(&bytes).is_err());
        play(&mut piano, &mut Actions::new(ENVS, 4), 1);
    }
    println!("{refused} of 300 damaged states refused");
    assert!(refused > 100);
    piano.load_state(&saved).unwrap();
    assert_eq!(piano.save_state(), saved, "and a sound one still loads");
}

/// The saved state of one environment, with its numbers at hand. The generator's are too long for a
/// JSON value, so they are kept as text.
struct Saved {
    value: serde_json::Value,
    random: String,
}

impl Saved {
    fn of(piano: &PianoVectorEnv) -> Self {
        let text = String::from_utf8(piano.save_state()).unwrap();
        let random =
            text.split_once(r#""random":"#).and_then(|(_, rest)| rest.split_once(r#","step":"#)).unwrap().0;
        let mut value: serde_json::Value = serde_json::from_str(&text).unwrap();
        value["random"] = "RANDOM".into();
        Self { value, random: random.to_string() }
    }

    /// The bytes with the number at `pointer` replaced.
    fn with(&self, pointer: &str, number: &str) -> Vec<u8> {
        let mut value = self.value.clone();
        *value.pointer_mut(pointer).unwrap() = serde_json::from_str(number).unwrap();
        serde_json::to_string(&value).unwrap().replace(r#""RANDOM""#, &self.random).into_bytes()
    }
}

/// Damage that is well formed: each number of the state replaced by an extreme one.
#[test]
fn extreme_numbers_in_a_state_are_refused_or_played_but_never_panic() {
    let mut piano = PianoVectorEnv::new(&nominal(), &short_piece(), 1, 1).unwrap();
    play(&mut piano, &mut Actions::new(1, 3), 20);
    let saved = Saved::of(&piano);
    assert!(piano.load_state(&saved.with("/step", "3")).is_ok(), "the way of damaging is sound itself");
    let pointers = numbers(&saved.value, String::new());
    assert!(pointers.len() > 300, "{} numbers", pointers.len());
    let asleep = saved.value.pointer("/snapshot/asleep").unwrap().as_array().unwrap().len();
    assert_eq!(asleep, 50);
    let mut accepted = 0;
    for pointer in pointers {
        for extreme in
            ["-1", "0", "1", "40", "1e300", "-1e300", "9223372036854775807", "18446744073709551615"]
        {
            let loaded = piano.load_state(&saved.with(&pointer, extreme));
            accepted += usize::from(loaded.is_ok());
            let stepped = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
                play(&mut piano, &mut Actions::new(1, 4), 1);
            }));
            assert!(stepped.is_ok(), "{pointer} = {extreme} was loaded ({}) and panics", loaded.is_ok());
        }
    }
    println!("{accepted} extreme states are states");
    assert!(accepted > 100, "{accepted}");
}

/// Paths of all numbers; of long lists only every seventh one beyond the first few.
fn numbers(value: &serde_json::Value, path: String) -> Vec<String> {
    use serde_json::Value;
    match value {
        Value::Number(_) => vec![path],
        Value::Array(items) => items
            .iter()
            .enumerate()
            .filter(|(index, _)| *index < 8 || index % 7 == 0)
            .flat_map(|(index, item)| numbers(item, format!("{path}/{index}")))
            .collect(),
        Value::Object(fields) => {
            fields.iter().flat_map(|(name, item)| numbers(item, format!("{path}/{name}"))).collect()
        }
        _ => Vec::new(),
    }
}

/// MuJoCo ends the whole process over sleeping trees that are not in a cycle, so they must never
/// reach it.
#[test]
fn broken_sleep_cycles_are_refused() {
    let mut piano = PianoVectorEnv::new(&nominal(), &short_piece(), 1, 1).unwrap();
    play(&mut piano, &mut Actions::new(1, 3), 3);
    let saved = Saved::of(&piano);
    for (tree, next) in [(0, "1"), (3, "50"), (3, "49"), (7, "2147483647")] {
        let bytes = saved.with(&format!("/snapshot/asleep/{tree}"), next);
        let refused = piano.load_state(&bytes).unwrap_err().to_string();
        assert!(refused.contains("cycles"), "{tree} to {next}: {refused}");
    }
    assert!(piano.load_state(&saved.with("/snapshot/asleep/3", "-5")).is_ok(), "waking one is fine");
}
