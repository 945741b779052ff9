//! The arm's link: replies that come late cost time, not the motion.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::time::Duration;

use etude_emulators::faults::FaultPlan;
use etude_robot::joints::RAIL;
use etude_robot::xarm::ArmFault;
use etude_robot::{Fault, Phase};
use etude_twin::{TwinParams, calibration};
use proptest::prelude::*;

use crate::bench::{Bench, rig, start_pose, with_links};
use crate::policy::Policy;

/// Time to the keyboard over a good link, ms, and the most that it may take over a bad one.
const HOMING_MS: u32 = 9500;
const MAX_HOMING_MS: u32 = 3 * HOMING_MS;

/// Holds each reply of the arm back by the next of these times (ms), again from the first after the
/// last.
struct LateReplies {
    delays_ms: Vec<u32>,
    next: usize,
    arrived: Rc<RefCell<Vec<u8>>>,
    waiting: VecDeque<(Duration, Vec<u8>)>,
}

impl LateReplies {
    fn new(bench: &mut Bench, delays_ms: Vec<u32>) -> Self {
        let arrived = Rc::new(RefCell::new(Vec::new()));
        let keep = Rc::clone(&arrived);
        bench.mischief.alter_replies = Some(Box::new(move |bytes| keep.borrow_mut().append(bytes)));
        Self { delays_ms, next: 0, arrived, waiting: VecDeque::new() }
    }

    fn step(&mut self, bench: &mut Bench) {
        while let Some((_, bytes)) = self.waiting.pop_front_if(|(due, _)| *due <= bench.now()) {
            bench.mischief.replies.extend(bytes);
        }
        bench.step();
        let bytes = std::mem::take(&mut *self.arrived.borrow_mut());
        if !bytes.is_empty() {
            let delay = self.delays_ms[self.next % self.delays_ms.len()];
            self.next += 1;
            self.waiting.push_back((bench.now() + Duration::from_millis(delay.into()), bytes));
        }
    }

    /// Milliseconds until the phase.
    fn until(&mut self, bench: &mut Bench, phase: Phase, most: u32) -> Option<u32> {
        (0..most).find(|_| {
            let is_there = bench.robot.phase() == phase;
            if !is_there {
                self.step(bench);
            }
            is_there
        })
    }
}

fn with_arm_link(arm: &FaultPlan) -> TwinParams {
    with_links(&FaultPlan::default(), arm, &FaultPlan::default())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, max_shrink_iters: 30, ..ProptestConfig::default() })]

    /// Whatever pattern the delays have, and whether they are there from the start or come on the
    /// way.
    #[test]
    fn late_replies_cost_the_way_to_the_keyboard_time_in_proportion(
        delays_ms in prop_oneof![
            prop::collection::vec(0_u32..=20, 1..60),
            prop::collection::vec(prop_oneof![4 => Just(0_u32), 1 => 8_u32..=20], 1..60),
        ],
        good_ms in prop_oneof![Just(0_u32), 200_u32..6000],
    ) {
        let mut bench = Bench::new(&TwinParams::load("mild").unwrap(), &calibration("twin"));
        let mut late = LateReplies::new(&mut bench, vec![0]);
        if good_ms == 0 {
            late.delays_ms = delays_ms.clone();
        }
        bench.start();
        prop_assert!(late.until(&mut bench, Phase::Holding, 5000).is_some(), "{:?}", bench.robot.fault());
        bench.robot.home(bench.now(), &start_pose()).unwrap();
        (0..good_ms).for_each(|_| late.step(&mut bench));
        late.delays_ms = delays_ms;
        let took = late.until(&mut bench, Phase::Holding, MAX_HOMING_MS - good_ms);
        prop_assert!(took.is_some(), "{:?}, {:?}", bench.robot.phase(), bench.robot.fault());
    }
}

/// Each link that an ordinary network may be brings the robot to the keyboard, and it follows, or
/// the fault names the link.
#[test]
fn a_link_with_jitter_plays_or_is_named() {
    println!("| delay | jitter | servo_hz | to the keyboard | targets a second | follows |");
    println!("|---|---|---|---|---|---|");
    for (delay_ms, jitter_ms) in
        [(0.3, 0.0), (0.3, 10.0), (2.0, 2.5), (2.0, 3.0), (2.0, 6.0), (5.0, 0.0), (5.0, 10.0)]
    {
        for servo_hz in [100.0, 200.0] {
            let name = format!("{delay_ms} ms, {jitter_ms} ms, {servo_hz} Hz");
            let arm = FaultPlan {
                delay_secs: delay_ms / 1e3,
                jitter_secs: jitter_ms / 1e3,
                ..FaultPlan::default()
            };
            let mut rig = rig();
            rig.arm.servo_hz = servo_hz;
            let mut bench = Bench::with_rig(&rig, &with_arm_link(&arm), &calibration("twin"));
            bench.start_and_hold();
            bench.robot.home(bench.now(), &start_pose()).unwrap();
            let took = bench.until(MAX_HOMING_MS, |bench| bench.robot.phase() != Phase::Moving);
            assert!(
                took.is_some() && bench.robot.phase() == Phase::Holding,
                "{name}: {:?}",
                bench.robot.fault()
            );
            bench.follow(Policy::Smooth);
            bench.run(10_000);
            let follows = match bench.robot.fault() {
                None => "yes".to_string(),
                Some(fault @ Fault::Arm(ArmFault::LateReplies { .. })) => fault.to_string(),
                Some(fault) => panic!("{name}: {fault}"),
            };
            let hz = 1.0 / bench.robot.arm().servo_period().as_secs_f64();
            println!(
                "| {delay_ms} ms | {jitter_ms} ms | {servo_hz} | {:.1} s | {hz:.0} | {follows} |",
                f64::from(took.unwrap()) / 1e3
            );
        }
    }
}

/// A pause of the network now and then costs the hand a little of its way along the keyboard.
#[test]
fn single_pauses_do_not_end_a_performance() {
    for pause_ms in [20, 50, 100] {
        let mut bench = Bench::at_the_keyboard(&TwinParams::load("standard").unwrap());
        let mut late = LateReplies::new(&mut bench, vec![0]);
        bench.start();
        late.until(&mut bench, Phase::Holding, 5000).unwrap();
        bench.follow(Policy::Smooth);
        let mut most: f64 = 0.0;
        for ms in 0..15_000 {
            late.delays_ms = vec![if ms % 1500 < 5 { pause_ms } else { 0 }];
            late.step(&mut bench);
            assert_eq!(bench.robot.phase(), Phase::Following, "{pause_ms} ms: {:?}", bench.robot.fault());
            most = most.max((bench.lockstep.twin.joints()[RAIL] - bench.robot.sent()[RAIL]).abs());
        }
        println!("pauses of {pause_ms} ms: at most {:.0} mm from the set-point", most * 1e3);
        assert!(bench.robot.arm().link_speed().hz > 199.0 && most < 0.06, "{pause_ms} ms: {most} m");
    }
}

/// With low limits the arm makes up for a pause slowly: that must not look as if something held it.
#[test]
fn late_replies_with_the_limits_of_a_first_day_are_none_of_a_fault() {
    let mut rig = rig();
    (rig.limits.rail_velocity, rig.limits.rail_acceleration, rig.limits.rail_jerk) = (0.2, 1.0, 1500.0);
    let mut bench = Bench::with_rig(&rig, &TwinParams::load("standard").unwrap(), &calibration("twin"));
    bench.place_arm_at_the_keyboard();
    let mut late = LateReplies::new(&mut bench, vec![0]);
    bench.start();
    late.until(&mut bench, Phase::Holding, 5000).unwrap();
    bench.follow(Policy::Smooth);
    for ms in 0..15_000 {
        late.delays_ms = vec![if ms % 100 < 5 { 12 } else { 0 }];
        late.step(&mut bench);
        assert_eq!(bench.robot.phase(), Phase::Following, "{ms} ms: {:?}", bench.robot.fault());
    }
}

/// Pauses that no rate bridges are named as what they are, with how many and what to do.
#[test]
fn a_link_that_pauses_again_and_again_is_named() {
    let mut bench = Bench::new(&TwinParams::load("mild").unwrap(), &calibration("twin"));
    let mut late = LateReplies::new(&mut bench, vec![0]);
    bench.start();
    late.until(&mut bench, Phase::Holding, 5000).unwrap();
    bench.robot.home(bench.now(), &start_pose()).unwrap();
    late.delays_ms = vec![0, 0, 100];
    late.until(&mut bench, Phase::Fault, 60_000).expect("it continues for ever");
    let Some(Fault::Arm(fault @ ArmFault::LateReplies { share, .. })) = bench.robot.fault() else {
        panic!("{:?}", bench.robot.fault())
    };
    assert!((share - 1.0 / 3.0).abs() < 0.02, "{fault}");
    assert_eq!(
        fault.to_string(),
        "33 % of the arm's replies took more than 35 ms: connect its control box by cable, close other programs, then start again"
    );
}
