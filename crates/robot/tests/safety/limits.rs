//! Whatever a policy asks, an operator does, and devices and wires say or break: the judge finds
//! nothing outside the limits, and nothing panics.

use std::time::Duration;

use etude_emulators::faults::FaultPlan;
use etude_robot::Phase;
use etude_robot::can::CanFrame;
use etude_robot::joints::DRIVEN;
use etude_twin::{FaultKind, TwinParams, calibration};
use proptest::prelude::*;

use crate::bench::{Bench, start_pose, with_links};
use crate::dice::Dice;
use crate::policy::Policy;

/// Something that happens.
#[derive(Clone, Debug)]
enum Event {
    Start,
    /// A start, and if all goes well a policy.
    Play(Policy),
    Stop,
    Hold,
    Home([f64; DRIVEN]),
    Approach([f64; DRIVEN]),
    /// From where the robot stands.
    Follow(Policy),
    /// From so many milliseconds ago or ahead, waypoints at random.
    FollowAnything(i64, Vec<[f64; DRIVEN]>),
    Frames(u64, u8),
    Replies(u64, u8),
    Reports(u64, u8),
    Midi(u64, u8),
    /// A key goes down, or comes up.
    Key(u8, bool),
    /// Hand, arm or keyboard, for so many milliseconds.
    Cut(u8, u8),
    Stall(u8),
    Device(u8),
    Mend,
}

fn any_value() -> impl Strategy<Value = f64> {
    prop_oneof![6 => -2.0..2.0f64, 1 => any::<f64>(), 1 => Just(f64::NAN), 1 => Just(f64::INFINITY)]
}

fn any_pose() -> impl Strategy<Value = [f64; DRIVEN]> {
    prop_oneof![3 => prop::array::uniform(-1.0..1.5f64), 1 => prop::array::uniform(any_value())]
}

fn any_policy() -> impl Strategy<Value = Policy> {
    prop_oneof![
        3 => Just(Policy::Smooth),
        3 => Just(Policy::Jumps),
        3 => Just(Policy::Sweeps),
        2 => Just(Policy::Drags),
        1 => Just(Policy::Nonsense),
        1 => Just(Policy::Still),
        1 => Just(Policy::Silent),
    ]
}

fn any_event() -> impl Strategy<Value = Event> {
    prop_oneof![
        1 => Just(Event::Start),
        6 => any_policy().prop_map(Event::Play),
        1 => Just(Event::Stop),
        1 => Just(Event::Hold),
        2 => any_pose().prop_map(Event::Home),
        2 => any_pose().prop_map(Event::Approach),
        4 => any_policy().prop_map(Event::Follow),
        2 => (-200i64..400, prop::collection::vec(any_pose(), 0..20))
            .prop_map(|(ahead, waypoints)| Event::FollowAnything(ahead, waypoints)),
        1 => any::<(u64, u8)>().prop_map(|(seed, count)| Event::Frames(seed, count)),
        1 => any::<(u64, u8)>().prop_map(|(seed, count)| Event::Replies(seed, count)),
        1 => any::<(u64, u8)>().prop_map(|(seed, count)| Event::Reports(seed, count)),
        1 => any::<(u64, u8)>().prop_map(|(seed, count)| Event::Midi(seed, count)),
        3 => (36u8..85, any::<bool>()).prop_map(|(note, down)| Event::Key(note, down)),
        1 => any::<(u8, u8)>().prop_map(|(wire, millis)| Event::Cut(wire % 3, millis)),
        1 => any::<u8>().prop_map(Event::Stall),
        2 => any::<u8>().prop_map(Event::Device),
        6 => Just(Event::Mend),
    ]
}

fn any_parameters() -> impl Strategy<Value = TwinParams> {
    let share = || prop_oneof![6 => Just(0.0), 3 => 0.0..0.05, 1 => 0.0..0.5f64];
    let delay = || prop_oneof![6 => Just(0.0005), 3 => 0.0..0.004, 1 => 0.0..0.05f64];
    let cut = || prop_oneof![6 => Just(None), 1 => (0.3..3.0f64).prop_map(Some)];
    let plan = move || {
        (share(), share(), share(), delay(), delay(), cut()).prop_map(
            |(loss, double, swap, delay, jitter, cut)| FaultPlan {
                loss,
                duplicate: double,
                reorder: swap,
                delay_secs: delay,
                jitter_secs: jitter,
                disconnect_at_secs: cut,
                disconnect_for_secs: cut.map(|_| 0.1),
                ..FaultPlan::default()
            },
        )
    };
    let bytes = move || {
        // A connection mostly keeps its bytes: most of what they say would never be heard
        // otherwise.
        plan().prop_map(|plan| FaultPlan {
            duplicate: 0.0,
            reorder: 0.0,
            truncate: if plan.loss > 0.05 { 1e-3 } else { 0.0 },
            loss: if plan.loss > 0.05 { 1e-4 } else { 0.0 },
            ..plan
        })
    };
    (plan(), bytes(), bytes(), any::<u64>(), any::<bool>(), any::<bool>()).prop_map(
        |(can, arm, midi, seed, times_out, senses)| {
            let mut twin_params = with_links(&can, &arm, &midi);
            for (wanted, change) in
                [(times_out, "[hand]\ntorque_timeout_secs = 0.1"), (senses, "[keyboard]\nsensing_secs = 0.1")]
            {
                twin_params = if wanted { twin_params.with(change).unwrap() } else { twin_params };
            }
            twin_params.with_seed_added(seed)
        },
    )
}

/// A frame such as the hand might send: mostly of its own kinds, with values at random.
fn any_frame(dice: &mut Dice) -> CanFrame {
    let ids = [0x080, 0x084, 0x088, 0x08C, 0x0C0, 0x0E0, 0x0E4, 0x0E8, 0x0EC, 0x200, 0x220, 0x040];
    let id = if dice.chance(0.2) { dice.below(0x800) as u16 } else { ids[dice.below(12) as usize] };
    if dice.chance(0.1) {
        return CanFrame::remote(id).unwrap();
    }
    let length = if dice.chance(0.8) { 8 } else { dice.below(9) as usize };
    CanFrame::new(id, &dice.bytes(length)).unwrap()
}

fn happen(bench: &mut Bench, event: &Event) {
    let now = bench.now();
    let dice = |seed: u64| Dice::new(seed);
    match event {
        Event::Start => bench.start(),
        Event::Play(policy) => {
            bench.start();
            bench.until(500, |bench| bench.robot.phase() != Phase::Starting);
            let _ = bench.try_follow(*policy);
            bench.run(200);
        }
        Event::Stop => bench.stop(),
        Event::Hold => bench.robot.hold(now),
        Event::Home(goal) => drop(bench.robot.home(now, goal)),
        Event::Approach(goal) => drop(bench.robot.approach(now, goal)),
        Event::Follow(policy) => drop(bench.try_follow(*policy)),
        Event::FollowAnything(ahead, waypoints) => {
            let begun = Duration::from_millis(now.as_millis() as u64).saturating_add_signed_millis(*ahead);
            let _ = bench.robot.follow(begun, waypoints);
        }
        Event::Frames(seed, count) => {
            let mut dice = dice(*seed);
            bench.mischief.frames.extend((0..*count).map(|_| any_frame(&mut dice)));
        }
        Event::Replies(seed, count) => bench.mischief.replies = dice(*seed).bytes((*count).into()),
        Event::Reports(seed, count) => bench.mischief.reports = dice(*seed).bytes((*count).into()),
        Event::Midi(seed, count) => bench.mischief.midi = dice(*seed).bytes((*count).into()),
        Event::Key(note, down) => bench.mischief.midi = vec![0x90, *note, u8::from(*down) * 64],
        Event::Cut(wire, millis) => {
            let wires = [FaultKind::CanBusOff, FaultKind::ArmDisconnect, FaultKind::KeyboardUnplugged];
            let cut = wires[usize::from(*wire) % 3];
            bench.begin(cut);
            bench.run((*millis).into());
            bench.end(cut);
        }
        Event::Stall(millis) => {
            bench.stall((*millis).into());
            bench.poll();
        }
        Event::Device(number) => misbehave(bench, *number),
        Event::Mend => {
            bench.lockstep.end_all();
            bench.lockstep.twin.devices.arm.inject_error(0);
            if bench.robot.phase() == Phase::Fault {
                // Only a new connection clears what made no sense.
                bench.begin(FaultKind::ArmDisconnect);
                bench.run(2);
                bench.end(FaultKind::ArmDisconnect);
                bench.run(2);
            }
        }
    }
}

fn misbehave(bench: &mut Bench, number: u8) {
    let now = bench.now();
    let arm = &mut bench.lockstep.twin.devices.arm;
    let fault = match number % 12 {
        0 => FaultKind::ArmStuck,
        1 => FaultKind::ArmSilent,
        2 => FaultKind::ArmMute,
        3 => FaultKind::ArmError(number / 2),
        4 => FaultKind::ArmStopped,
        5 => FaultKind::BoardHot(number),
        6 => FaultKind::HandHot(number / 64, number),
        7 => FaultKind::HandFault(number),
        8 => FaultKind::HandOff,
        9 => FaultKind::KeyboardUnplugged,
        10 => return bench.end(FaultKind::KeyboardUnplugged),
        _ => {
            let other = arm.connect();
            arm.receive(now, other, &[0, 1, 0, 2, 0, 2, 12, [0, 3, 4, 6][usize::from(number % 4)]]);
            return arm.disconnect(other);
        }
    };
    bench.begin(fault);
}

trait SignedMillis {
    fn saturating_add_signed_millis(self, millis: i64) -> Self;
}

impl SignedMillis for Duration {
    fn saturating_add_signed_millis(self, millis: i64) -> Self {
        let size = Self::from_millis(millis.unsigned_abs());
        if millis < 0 { self.saturating_sub(size) } else { self.saturating_add(size) }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, max_shrink_iters: 300, ..ProptestConfig::default() })]

    #[test]
    fn nothing_outside_the_limits_is_ever_sent(
        twin_params in any_parameters(),
        at_the_keyboard: bool,
        first in any_policy(),
        script in prop::collection::vec((any_event(), 1u32..150), 1..25),
    ) {
        let mut bench = if at_the_keyboard {
            Bench::at_the_keyboard(&twin_params)
        } else {
            Bench::new(&twin_params, &calibration("twin"))
        };
        happen(&mut bench, &Event::Play(first));
        for (event, millis) in &script {
            happen(&mut bench, event);
            bench.run(*millis);
        }
        // However it went: an operator's stop is a stop.
        bench.stop();
        bench.run(200);
        prop_assert!(matches!(bench.robot.phase(), Phase::Stopped | Phase::Fault));
    }
}

/// Sweeps along the keyboard while a finger presses keys and lets them go, and replies of the arm
/// are held back.
#[test]
fn a_hand_brakes_while_it_drags_a_finger() {
    let mut bench = Bench::at_the_keyboard(&TwinParams::load("mild").unwrap());
    let start = start_pose();
    bench.lockstep.twin.place_fingers(&std::array::from_fn(|joint| start[joint]));
    bench.run(20);
    bench.start_and_hold();
    bench.follow(Policy::Drags);
    for round in 0..40 {
        // At another place of a sweep in each round.
        bench.run(100 + 37 * round % 300);
        bench.hold_replies(2 * round);
        bench.run(400);
    }
    assert_eq!(bench.robot.phase(), Phase::Following, "{:?}", bench.robot.fault());
    let judge = &bench.judge;
    println!("{} m/s, {} of {} targets", judge.worst_step_m / 0.005, judge.dragged, judge.targets);
    assert!(judge.worst_step_m > 0.9 * bench.robot.config().limits.rail_velocity * 0.005);
    assert!(judge.dragged > 50, "{}", judge.dragged);
}

/// The property above is worth something only if robots do move in it.
#[test]
fn a_judge_has_something_to_judge() {
    let mut bench = Bench::at_the_keyboard(&TwinParams::load("mild").unwrap());
    bench.start_and_hold();
    bench.follow(Policy::Jumps);
    bench.run(2000);
    assert_eq!(bench.robot.phase(), Phase::Following, "{:?}", bench.robot.fault());
    assert!(bench.robot.clamped() > 1000, "{}", bench.robot.clamped());
    assert!(bench.judge.targets > 390 && bench.judge.set_points > 390);
    assert!(bench.judge.frames > 2000, "{}", bench.judge.frames);
}
