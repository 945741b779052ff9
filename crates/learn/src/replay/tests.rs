use proptest::prelude::*;

use super::*;

const ACTION: usize = 2;

fn layout(binary: usize) -> ObservationLayout {
    ObservationLayout { real: 3, binary }
}

/// A transition whose values follow from its number.
fn values(number: u64, layout: ObservationLayout) -> (Vec<f32>, Vec<f32>, Vec<f32>) {
    let observation = |n: u64| -> Vec<f32> {
        (0..layout.len() as u64)
            .map(|i| if i < layout.real as u64 { (n * 10 + i) as f32 } else { ((n >> (i % 7)) & 1) as f32 })
            .collect()
    };
    (observation(number), vec![number as f32; ACTION], observation(number + 1))
}

fn ends(number: u64) -> bool {
    number % 13 == 4
}

fn push(replay: &mut Replay, number: u64) {
    let (observation, action, next_observation) = values(number, replay.layout);
    replay.push(Transition {
        observation: &observation,
        action: &action,
        reward: number as f32,
        ends: ends(number),
        next_observation: &next_observation,
    });
}

fn filled_by(binary: usize, capacity: usize, num_envs: usize, count: u64) -> Replay {
    let mut replay = Replay::new(layout(binary), ACTION, capacity, num_envs);
    (0..count).for_each(|number| push(&mut replay, number));
    replay
}

fn filled(binary: usize, capacity: usize, count: u64) -> Replay {
    filled_by(binary, capacity, 1, count)
}

const ONE_STEP: Horizon = Horizon { steps: 1, discount: 0.5 };

/// One row of a batch's observations, unpacked.
fn unpacked(inputs: &Inputs, row: usize, binary: usize) -> Vec<f32> {
    let mut values = inputs.dense()[row * inputs.stride()..][..3].to_vec();
    values.resize(3 + binary, 0.0);
    for &one in &inputs.ones()[inputs.offsets()[row] as usize..inputs.offsets()[row + 1] as usize] {
        values[3 + one as usize] = 1.0;
    }
    values
}

proptest! {
    #[test]
    fn samples_are_held_transitions_with_all_their_parts(
        binary in 0usize..200, capacity in 1usize..60, num_envs in 1usize..5, count in 1u64..150, steps in 1usize..6,
    ) {
        let replay = filled_by(binary, capacity, num_envs, count);
        prop_assert_eq!(replay.len() as u64, count.min(capacity as u64));
        let mut batch = Batch::new(layout(binary), ACTION, 64);
        replay.sample(&mut Stream::new(count, "sample"), 64, Horizon { steps, discount: 0.5 }, &mut batch);
        for row in 0..64 {
            let number = batch.action[row * ACTION] as u64;
            prop_assert!((replay.oldest()..count).contains(&number));
            // The straight way to the same: walk on while the episode does, adding rewards.
            let (mut last, mut reward, mut discount) = (number, number as f64, 0.5);
            for _ in 1..steps {
                if ends(last) || last + num_envs as u64 >= count {
                    break;
                }
                last += num_envs as u64;
                reward += discount * last as f64;
                discount *= 0.5;
            }
            prop_assert_eq!(batch.reward[row], reward as f32);
            prop_assert_eq!(batch.discount[row], discount as f32);
            let (observation, action, _) = values(number, layout(binary));
            let (_, _, next_observation) = values(last, layout(binary));
            prop_assert_eq!(&batch.action[row * ACTION..(row + 1) * ACTION], &action[..]);
            prop_assert_eq!(unpacked(&batch.observation, row, binary), observation);
            prop_assert_eq!(unpacked(&batch.next_observation, row, binary), next_observation);
        }
    }

    #[test]
    fn segments_restore_the_ring(binary in 0usize..130, capacity in 1usize..30, count in 0u64..80, cut in 0.0f64..1.0) {
        let replay = filled(binary, capacity, count);
        let middle = replay.oldest() + ((replay.len() as f64) * cut) as u64;
        let mut copy = Replay::new(layout(binary), ACTION, capacity, 1);
        copy.start_at(replay.oldest());
        for segment in [Segment { begin: replay.oldest(), end: middle }, Segment { begin: middle, end: count }] {
            copy.decode(segment, &replay.encode(segment)).unwrap();
        }
        prop_assert_eq!(copy.total(), replay.total());
        for number in replay.oldest()..count {
            let one = Segment { begin: number, end: number + 1 };
            prop_assert_eq!(copy.encode(one), replay.encode(one));
        }
    }

    #[test]
    fn damaged_segments_are_refused(flip in any::<prop::sample::Index>(), bit in 0u8..8, cut in any::<prop::sample::Index>()) {
        let replay = filled(70, 16, 10);
        let segment = Segment { begin: 0, end: 10 };
        let bytes = replay.encode(segment);
        let mut flipped = bytes.clone();
        flipped[flip.index(bytes.len())] ^= 1 << bit;
        let mut copy = Replay::new(layout(70), ACTION, 16, 1);
        prop_assert!(copy.decode(segment, &flipped).is_err());
        prop_assert!(copy.decode(segment, &bytes[..cut.index(bytes.len())]).is_err());
        prop_assert_eq!(copy.total(), 0);
    }
}

#[test]
fn sampling_is_uniform() {
    let replay = filled(0, 10, 10);
    let mut batch = Batch::new(layout(0), ACTION, 10_000);
    replay.sample(&mut Stream::new(1, "sample"), 10_000, ONE_STEP, &mut batch);
    let mut counts = [0; 10];
    batch.reward.iter().for_each(|&reward| counts[reward as usize] += 1);
    assert!(counts.iter().all(|&count| (850..1150).contains(&count)), "{counts:?}");
}

#[test]
fn wrong_order_and_wrong_numbers_have_their_own_errors() {
    let replay = filled(0, 16, 10);
    let mut copy = Replay::new(layout(0), ACTION, 16, 1);
    let segment = Segment { begin: 5, end: 10 };
    assert!(copy.decode(segment, &replay.encode(segment)).unwrap_err().contains("does not follow"));
    let mut poisoned = filled(0, 16, 9);
    let (observation, action, next_observation) = values(9, layout(0));
    poisoned.push(Transition {
        observation: &observation,
        action: &action,
        reward: f32::NAN,
        ends: false,
        next_observation: &next_observation,
    });
    let all = Segment { begin: 0, end: 10 };
    assert!(copy.decode(all, &poisoned.encode(all)).unwrap_err().contains("not a finite number"));
}
