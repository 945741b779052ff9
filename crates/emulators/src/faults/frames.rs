//! A bad CAN bus.

use std::{collections::BTreeMap, time::Duration};

use super::plan::{Dice, FaultPlan, FaultPlanError, Link};
use etude_robot::can::CanFrame;

/// Frames on their way at most; later ones are lost. Ten seconds of a hand at full rate.
const MAX_FRAMES: usize = 32_768;

/// One direction of a CAN bus on which things go wrong.
#[derive(Clone, Debug)]
pub struct FaultyFrames {
    dice: Dice,
    /// Frames in the order in which they arrive; the second number keeps those that are due
    /// together in the order they came.
    on_the_way: BTreeMap<(Duration, u64), CanFrame>,
    number: u64,
}

impl FaultyFrames {
    /// A bus with these faults.
    ///
    /// # Errors
    /// If the plan is not valid, or truncates: a frame arrives whole or not at all.
    pub fn new(plan: &FaultPlan) -> Result<Self, FaultPlanError> {
        Ok(Self { dice: Dice::new(plan, Link::Frames)?, on_the_way: BTreeMap::new(), number: 0 })
    }

    /// Whether the link holds at this time; while it does not, a transport should report its loss.
    pub fn is_connected(&self, now: Duration) -> bool {
        self.dice.is_connected(now)
    }

    /// Sends a frame.
    pub fn push(&mut self, now: Duration, frame: CanFrame) {
        let fate = self.dice.throw(now);
        let due = fate.due.saturating_add(fate.held.unwrap_or_default());
        if self.dice.is_cut(now, due) || fate.lost {
            return;
        }
        for _ in 0..=u8::from(fate.duplicated) {
            if self.on_the_way.len() < MAX_FRAMES {
                self.on_the_way.insert((due, self.number), frame);
                self.number += 1;
            }
        }
    }

    /// The next frame that has arrived by `now`.
    pub fn pop(&mut self, now: Duration) -> Option<CanFrame> {
        let entry = self.on_the_way.first_entry().filter(|entry| entry.key().0 <= now)?;
        Some(entry.remove())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const STEP: Duration = Duration::from_millis(1);

    fn frame(number: u16) -> CanFrame {
        CanFrame::new(0x80, &number.to_le_bytes()).unwrap()
    }

    fn number(frame: CanFrame) -> u16 {
        u16::from_le_bytes(frame.payload().try_into().unwrap())
    }

    /// Pushes one numbered frame a step and pops whatever is due; the numbers that arrived, with
    /// their steps.
    fn run(plan: &FaultPlan, frames: u16) -> Vec<(u16, u32)> {
        let mut bus = FaultyFrames::new(plan).unwrap();
        let mut arrived = Vec::new();
        for step in 0..u32::from(frames) + 2000 {
            let now = STEP * step;
            if let Ok(number) = u16::try_from(step)
                && number < frames
            {
                bus.push(now, frame(number));
            }
            while let Some(frame) = bus.pop(now) {
                arrived.push((number(frame), step));
            }
        }
        arrived
    }

    /// How often each frame arrived.
    fn times(arrived: &[(u16, u32)], frames: u16) -> Vec<u32> {
        let mut times = vec![0; usize::from(frames)];
        arrived.iter().for_each(|&(number, _)| times[usize::from(number)] += 1);
        times
    }

    fn any_plan() -> impl Strategy<Value = FaultPlan> {
        let rate = || prop_oneof![Just(0.0), 0.0..=1.0];
        let cut = prop_oneof![
            Just(None),
            (0.0..0.5, prop_oneof![Just(None), (0.0..0.3).prop_map(Some)]).prop_map(Some)
        ];
        (0.0..0.05, 0.0..0.05, rate(), rate(), rate(), cut, any::<u64>()).prop_map(
            |(delay_secs, jitter_secs, loss, duplicate, reorder, cut, seed)| FaultPlan {
                delay_secs,
                jitter_secs,
                loss,
                duplicate,
                reorder,
                disconnect_at_secs: cut.map(|cut| cut.0),
                disconnect_for_secs: cut.and_then(|cut| cut.1),
                seed,
                ..FaultPlan::default()
            },
        )
    }

    proptest! {
        #[test]
        fn nothing_is_invented_and_nothing_is_missing_without_a_reason(
            plan in any_plan(), frames in 0_u16..500,
        ) {
            let times = times(&run(&plan, frames), frames);
            prop_assert!(times.iter().all(|&times| times <= 2));
            prop_assert!(plan.duplicate > 0.0 || !times.contains(&2));
            let may_miss = plan.loss > 0.0 || plan.disconnect_at_secs.is_some();
            prop_assert!(may_miss || !times.contains(&0));
        }

        #[test]
        fn delays_are_honoured_and_order_is_kept_unless_reordered(plan in any_plan()) {
            let arrived = run(&plan, 300);
            let held_secs = if plan.reorder > 0.0 { 0.01 } else { 0.0 };
            for &(number, step) in &arrived {
                let took = (STEP * step).as_secs_f64() - (STEP * u32::from(number)).as_secs_f64();
                prop_assert!(took >= plan.delay_secs - 1e-9, "{took}");
                // It is asked once a step, so it may be seen up to one step later.
                let latest = plan.delay_secs + plan.jitter_secs + held_secs + STEP.as_secs_f64();
                prop_assert!(took <= latest + 1e-9, "{took} > {latest}");
            }
            prop_assert!(plan.reorder > 0.0 || arrived.is_sorted_by_key(|&(number, _)| number));
        }

        #[test]
        fn the_same_plan_gives_the_same_result(plan in any_plan()) {
            prop_assert_eq!(run(&plan, 200), run(&plan, 200));
        }

        #[test]
        fn a_perfect_link_changes_nothing(seed: u64, frames in 0_u16..500) {
            let arrived = run(&FaultPlan { seed, ..FaultPlan::default() }, frames);
            let expected: Vec<_> = (0..frames).map(|number| (number, u32::from(number))).collect();
            prop_assert_eq!(arrived, expected);
        }
    }

    #[test]
    fn the_rates_are_as_planned() {
        let plan = FaultPlan { loss: 0.2, duplicate: 0.1, reorder: 0.3, seed: 1, ..FaultPlan::default() };
        let arrived = run(&plan, 10_000);
        let times = times(&arrived, 10_000);
        let [lost, duplicated] = [0, 2].map(|n| times.iter().filter(|&&times| times == n).count());
        // Binomial, so within five standard deviations.
        assert!((1800..2200).contains(&lost), "{lost}");
        assert!((680..920).contains(&duplicated), "{duplicated}");
        let held = arrived.iter().filter(|&&(number, step)| step > u32::from(number)).count();
        assert!((2200..2900).contains(&held), "{held} of those that arrived were held back");
        assert!(!arrived.is_sorted_by_key(|&(number, _)| number), "some frames were overtaken");
    }

    #[test]
    fn a_cut_takes_what_is_on_its_way_and_then_heals() {
        let plan = FaultPlan {
            delay_secs: 0.02,
            disconnect_at_secs: Some(0.1),
            disconnect_for_secs: Some(0.05),
            ..FaultPlan::default()
        };
        let arrived = run(&plan, 300);
        let numbers: Vec<u16> = arrived.iter().map(|&(number, _)| number).collect();
        assert_eq!(numbers, (0..80).chain(150..300).collect::<Vec<_>>());
        let bus = FaultyFrames::new(&plan).unwrap();
        assert!(bus.is_connected(STEP * 99) && !bus.is_connected(STEP * 100) && bus.is_connected(STEP * 150));
    }

    #[test]
    fn it_is_bounded() {
        let mut bus = FaultyFrames::new(&FaultPlan { delay_secs: 1.0, ..FaultPlan::default() }).unwrap();
        for number in 0..40_000 {
            bus.push(Duration::ZERO, frame(number));
        }
        let arrived = std::iter::from_fn(|| bus.pop(Duration::from_secs(1)));
        assert_eq!(arrived.count(), MAX_FRAMES);
    }
}
