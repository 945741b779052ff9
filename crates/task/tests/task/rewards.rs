//! The reward's terms against numbers worked out by hand from docs/algorithm.md.

use etude_music::{KeySet, key_is_black};
use etude_stage::geometry::WHITE;
use etude_stage::hand::{JOINTS_PER_FINGER, TIP_RADIUS};
use etude_stage::params::JointRow;
use etude_stage::{
    DRIVEN_JOINTS, FINGERS, PhysicalParams, RAIL, StageConfig, StepOutcome, World, kinematics,
};
use etude_task::ACTION_LEN;
use etude_task::fingering::{Goal, Goals};
use etude_task::reward::{StepContext, TERMS, tolerance};

const STILL: [f32; ACTION_LEN] = [0.0; ACTION_LEN];

fn world() -> World {
    World::new(&StageConfig::default(), &PhysicalParams::default()).unwrap()
}

/// The keys of these numbers, 0 the lowest.
fn keys(numbers: &[usize]) -> KeySet {
    let mut set = KeySet::EMPTY;
    for key in numbers {
        set.insert(*key);
    }
    set
}

fn term(name: &str, context: &StepContext) -> f64 {
    let term = TERMS.iter().find(|term| term.name == name).unwrap();
    (term.value)(context)
}

fn context<'a>(world: &'a World, due: &[usize]) -> StepContext<'a> {
    let outcome = StepOutcome::default();
    StepContext {
        world,
        due: keys(due),
        to_hold: keys(due),
        pressed_before: world.pressed(),
        outcome,
        targets: &[0.0; DRIVEN_JOINTS],
        action: &STILL,
        previous_action: &STILL,
        goals: Goals::default(),
    }
}

fn assert_near(value: f64, expected: f64, what: &str) {
    assert!((value - expected).abs() < 1e-9, "{what}: {value}, not {expected}");
}

#[test]
fn keys_earn_for_being_down_where_they_are_due_and_up_where_they_are_not() {
    // What a due key at rest still earns: a tenth to the power of ((1 − 0.05) / 0.5)².
    let up = 0.1f64.powf(1.9 * 1.9);
    let table: [(&[usize], &[usize], f64, f64); 9] = [
        (&[], &[], 0.5, 1.5),
        (&[], &[24], 0.0, 0.0),
        (&[24], &[], 0.5 * up + 0.5, 0.0),
        (&[24], &[24], 1.0, 1.5),
        (&[24], &[26], 0.5 * up, 0.5),
        (&[24], &[24, 26], 0.5, 1.0),
        (&[24, 28], &[24, 28], 1.0, 1.5),
        (&[24, 28], &[24], 0.25 * (1.0 + up) + 0.5, 1.25),
        (&[24, 28], &[24, 26], 0.25 * (1.0 + up), 0.75),
    ];
    let mut world = world();
    let pose = world.start_pose();
    for (due, down, key_press, graded) in table {
        world.pose(&pose, keys(down));
        let context = context(&world, due);
        let what = format!("due {due:?}, down {down:?}");
        assert_near(term("key_press", &context), key_press, &what);
        assert_near(term("graded_key_press", &context), graded, &format!("graded: {what}"));
    }
}

#[test]
fn fingers_earn_for_the_keys_that_the_cheapest_lateral_assignment_gives_them() {
    let mut world = world();
    let mut pose = world.start_pose();
    pose[RAIL] = 0.05;
    world.pose(&pose, KeySet::EMPTY);
    let pads: [[f64; 3]; FINGERS] = std::array::from_fn(|finger| world.finger_pad(finger));
    let closeness = |finger: usize, key: usize| {
        let target = world.key_target(key);
        let squares: f64 = (0..3).map(|axis| (pads[finger][axis] - target[axis]).powi(2)).sum();
        tolerance(squares.sqrt(), 0.01, 0.05)
    };
    let aside = |finger: usize, key: usize| (pads[finger][1] - world.key_target(key)[1]).abs();
    let earned = |due: &[usize]| term("optimal_transport", &context(&world, due));

    assert_near(earned(&[]), 1.0, "nothing due");
    let mut told_apart = 0;
    for one in 20..34 {
        let nearest = (0..FINGERS).min_by(|a, b| aside(*a, one).total_cmp(&aside(*b, one))).unwrap();
        assert_near(earned(&[one]), closeness(nearest, one), &format!("key {one}"));
        for other in one + 1..34 {
            let pairs = (0..FINGERS).flat_map(|a| (0..FINGERS).map(move |b| (a, b))).filter(|(a, b)| a != b);
            let cost = |(a, b): &(usize, usize)| aside(*a, one) + aside(*b, other);
            let (a, b) = pairs.min_by(|x, y| cost(x).total_cmp(&cost(y))).unwrap();
            // Two assignments may cost the same from side to side; both fingers' order along the
            // keyboard decides then.
            let mean = |a, b| 0.5 * (closeness(a, one) + closeness(b, other));
            let (value, swapped) = (earned(&[one, other]), (cost(&(a, b)) - cost(&(b, a))).abs() < 1e-12);
            assert!(
                (value - mean(a, b)).abs() < 1e-9 || swapped && (value - mean(b, a)).abs() < 1e-9,
                "keys {one} and {other}: {value}"
            );
            told_apart += usize::from((mean(a, b) - mean(b, a)).abs() > 1e-3);
        }
    }
    assert!(told_apart > 10, "a wrong assignment would hardly show: {told_apart}");
    // More keys than fingers: the mean is over the fingers, and the most is 1.
    let chord = earned(&[22, 24, 26, 28, 29]);
    assert!(chord > 0.0 && chord <= 1.0, "{chord}");
}

#[test]
fn power_and_changes_of_action_and_collisions_cost() {
    let world = world();
    let quiet = context(&world, &[]);
    let busy = StepOutcome { finger_power: 2.0, rail_power: 100.0, collided: true, ..StepOutcome::default() };
    let loud = StepContext { outcome: busy, ..context(&world, &[]) };
    assert_near(term("energy", &quiet), 0.0, "no power");
    assert_near(term("energy", &loud), -2.3, "power");
    assert_near(term("collision", &quiet), 0.5, "no collision");
    assert_near(term("collision", &loud), 0.0, "a collision");

    let mut action = STILL;
    action[RAIL] = 1.0;
    action[0] = -0.5;
    let changed = StepContext { action: &action, ..context(&world, &[]) };
    assert_near(term("action_change", &quiet), 0.0, "the same action");
    assert_near(term("action_change", &changed), -1.25 / ACTION_LEN as f64, "another action");
}

#[test]
fn a_finger_that_holds_a_key_pays_for_targets_out_of_reach() {
    let mut params = PhysicalParams::default();
    params.set("joint.fingers.encoder_bias", 0.05).unwrap();
    let world = World::new(&StageConfig::default(), &params).unwrap();
    let mut targets = world.joints();
    let plain = Goal { key: 24, over: [0.0; 2], wait_steps: 0, age_steps: 4, velocity: 64 };
    let goal = |key, wait_steps| Some(Goal { key, wait_steps, ..plain });
    let earned = |targets: &[f64; DRIVEN_JOINTS], sounded: &[usize], goals: Goals| {
        term(
            "holding",
            &StepContext { targets, pressed_before: keys(sounded), goals, ..context(&world, &[24]) },
        )
    };
    let one_holds = [None, goal(24, 0), goal(26, 3)];
    assert_near(earned(&targets, &[24], one_holds), 0.5, "targets where the joints are");
    // Of the middle finger two joints; another finger and the rail, which do not count.
    targets[JOINTS_PER_FINGER] += 0.9;
    targets[2 * JOINTS_PER_FINGER - 1] -= 0.3;
    targets[2 * JOINTS_PER_FINGER] += 0.5;
    targets[RAIL] += 0.2;
    assert_near(earned(&targets, &[24], one_holds), 0.5 - 1.2 / 4.0, "it holds");
    assert_near(earned(&targets, &[26], one_holds), 0.0, "it strikes: its key did not sound before");
    let two = [None, goal(24, 0), goal(26, 0)];
    assert_near(earned(&targets, &[24, 26], two), (1.0 - 1.2 / 4.0 - 0.5 / 4.0) / 2.0, "two fingers hold");
    assert_near(earned(&targets, &[24], two), (0.5 - 1.2 / 4.0) / 2.0, "one of two");
    assert_near(earned(&targets, &[24], [None, goal(24, 2), None]), 0.0, "it waits");
    // All fingers, whatever they do, but not the rail.
    let tracking = term("tracking", &StepContext { targets: &targets, ..context(&world, &[]) });
    assert_near(tracking, -1.7 / 12.0, "all targets");
}

#[test]
fn the_palm_earns_for_the_place_where_it_is_and_not_for_what_its_encoder_reads() {
    let place = world();
    let middle = (place.key_target(24)[1] + place.key_target(28)[1]) / 2.0;
    for bias in [0.0, 0.1] {
        let mut params = PhysicalParams::default();
        params.set_joint(JointRow::EncoderBias, RAIL, bias);
        let mut world = World::new(&StageConfig::default(), &params).unwrap();
        for (beside, expected) in [(0.0, 1.0), (0.03, 1.0), (-0.18, tolerance(0.18, 0.03, 0.3))] {
            let mut pose = world.start_pose();
            pose[RAIL] = middle + beside + bias;
            world.pose(&pose, KeySet::EMPTY);
            let value = term("hand_position", &context(&world, &[24, 28]));
            assert!(
                (value - expected).abs() < 1e-6,
                "bias {bias}, {beside} m beside: {value}, not {expected}"
            );
        }
        assert_near(term("hand_position", &context(&world, &[])), 1.0, "nothing due");
    }
}

#[test]
fn sliding_costs_while_keys_are_down_and_twice_as_much_on_neighbours() {
    let mut params = PhysicalParams::default();
    // Keys that rise so slowly that they are down after a control step without a finger on them.
    params
        .set("key.damping", PhysicalParams::rows().find(|row| row.0 == "key.damping").unwrap().1.range[1])
        .unwrap();
    let mut world = World::new(&StageConfig::default(), &params).unwrap();
    for (down, factor) in
        [(&[][..], 0.0), (&[24], 3.0), (&[24, 26], 3.0), (&[24, 25], 6.0), (&[30, 35, 36], 6.0)]
    {
        let pose = world.start_pose();
        world.pose(&pose, keys(down));
        let mut targets = pose;
        targets[RAIL] += 0.2;
        world.step(&targets);
        world.step(&targets);
        assert_eq!(world.pressed(), keys(down), "a key has risen");
        let velocity = world.joint_velocities()[RAIL];
        assert!(velocity > 0.05, "{velocity}");
        let value = term("sliding", &context(&world, &[]));
        assert_near(value, 1.0 - factor * velocity * velocity, &format!("down {down:?}"));
    }
}

#[test]
fn keys_that_are_not_due_cost_by_how_far_they_are_down() {
    let mut world = world();
    let pose = world.start_pose();
    world.pose(&pose, keys(&[24, 26, 31]));
    let table: [(&[usize], f64); 4] = [(&[], 3.0), (&[24], 2.0), (&[24, 26, 31], 0.0), (&[40], 3.0)];
    for (due, cost) in table {
        let value = term("wrong_travel", &context(&world, due));
        assert!((value + cost).abs() < 1e-3, "due {due:?}: {value}, not −{cost}");
    }
    // The squared travel on the way up: lifting a key half pays.
    let mut last = -3.0;
    for _ in 0..4 {
        let before = [24, 26, 31].map(|key| world.key_travel(key));
        world.step(&pose);
        let squares = |travel: &dyn Fn(usize) -> f64| {
            -(0..49).map(|key| travel(key).clamp(0.0, 1.0).powi(2)).sum::<f64>()
        };
        let wrong =
            |pressed_before| term("wrong_travel", &StepContext { pressed_before, ..context(&world, &[]) });
        let value = wrong(keys(&[24, 26, 31]));
        assert_near(value, squares(&|key| world.key_travel(key)), "keys that are let go");
        assert!(value > last || value > -1e-3, "{value} after {last}");
        last = value;
        // Had they been silent before the step, they would count where they were deepest in it,
        // which is near its beginning.
        let brushed = wrong(KeySet::EMPTY);
        assert_near(brushed, squares(&|key| world.deepest_travel(key)), "keys that are brushed");
        for (key, before) in [24, 26, 31].into_iter().zip(before) {
            assert!(world.deepest_travel(key) > world.key_travel(key).max(0.5 * before), "{before}");
        }
    }
}

#[test]
fn a_key_that_the_fingering_leaves_early_neither_earns_nor_costs() {
    let mut world = world();
    let pose = world.start_pose();
    let up = 0.1f64.powf(1.9 * 1.9);
    for (down, expected) in [(&[24][..], 1.0), (&[24, 28], 1.0), (&[28], 0.5 * up + 0.5), (&[24, 29], 0.5)] {
        world.pose(&pose, keys(down));
        let context = StepContext { to_hold: keys(&[24]), ..context(&world, &[24, 28]) };
        assert_near(term("key_press", &context), expected, &format!("down {down:?}"));
    }
}

#[test]
fn a_finger_earns_for_its_own_goal_and_for_no_other() {
    let mut world = world();
    let pose = world.start_pose();
    world.pose(&pose, KeySet::EMPTY);
    let goal =
        |key: usize, wait_steps| Some(Goal { key, over: [0.0; 2], wait_steps, age_steps: 4, velocity: 64 });
    let away = |finger: usize, key: usize| {
        let (pad, mut target) = (world.finger_pad(finger), world.key_target(key));
        // Where the fingering presses, 28 mm and 34 mm from the middle of the key's length, and not
        // where the paper's reward aims.
        target[0] += if key_is_black(key) { 0.034 - 0.35 * 0.045 } else { 0.028 - 0.35 * 0.075 };
        let squares = (0..3).map(|axis| (pad[axis] - target[axis]).powi(2));
        tolerance(squares.sum::<f64>().sqrt(), 0.01, 0.05)
    };
    let earned = |goals: Goals| term("fingering", &StepContext { goals, ..context(&world, &[]) });
    assert_near(earned([None; FINGERS]), 1.0, "without a goal");
    let playing = [goal(22, 0), None, goal(27, 0)];
    assert_near(earned(playing), (away(0, 22) + away(2, 27)) / 2.0, "two play");
    let mixed = [goal(22, 0), goal(24, 7), None];
    assert_near(earned(mixed), away(0, 22), "one plays");
    let swapped = earned([goal(27, 0), None, goal(22, 0)]);
    assert!((swapped - earned(playing)).abs() > 0.05, "fingers can be told apart: {swapped}");
}

#[test]
fn a_strike_earns_by_how_near_it_is_to_the_velocity_of_its_note() {
    let mut world = world();
    // The middle finger over middle C, then far below its top; it strikes some key there.
    let start = world.start_pose();
    let over = |height: f64| {
        let z = WHITE.top() + TIP_RADIUS + height;
        let angles = kinematics::reach(StageConfig::default().side, 1, [0.028, 0.0, z], 0.0).unwrap();
        let mut pose = start;
        pose[RAIL] = 0.0;
        pose[JOINTS_PER_FINGER..2 * JOINTS_PER_FINGER].copy_from_slice(&angles);
        pose
    };
    world.reset_to(&over(0.02));
    let struck = (0..10).any(|_| {
        world.step(&over(-0.02));
        !world.strikes().is_empty()
    });
    assert!(struck);
    let strike = world.strikes()[0];
    let event = world.events()[0];
    let struck = strike.key;
    assert_eq!(event.key, struck);
    assert_eq!(f64::from(event.velocity), strike.unrounded_velocity.round().clamp(1.0, 127.0));
    let earned = |name: &str, key: usize, age_steps: usize, velocity: u8, sounded: &[usize]| {
        let goal = Goal { key, over: [0.0; 2], wait_steps: 0, age_steps, velocity };
        let goals = [None, Some(goal), None];
        term(name, &StepContext { goals, pressed_before: keys(sounded), ..context(&world, &[24]) })
    };
    for velocity in [1, 64, 127] {
        let error = (strike.unrounded_velocity - f64::from(velocity)).abs() / 127.0;
        for (name, margin) in [("velocity", 0.4), ("dynamics", 0.5)] {
            let expected = tolerance(error, 0.05, margin);
            assert_near(earned(name, struck, 0, velocity, &[]), expected, "a note that begins");
            assert_near(earned(name, struck + 7, 0, velocity, &[]), 0.0, "a note that is not struck");
            assert_near(earned(name, struck, 2, velocity, &[]), 0.0, "a note that sounds already");
        }
        // A soft strike may come a control step late. A key that sounded before is struck once
        // more, which no note asks for.
        let late = |name: &str, sounded: &[usize]| earned(name, struck, 1, velocity, sounded);
        assert_near(late("dynamics", &[]), tolerance(error, 0.05, 0.5), "a step late");
        assert_near(late("dynamics", &[struck]), 0.0, "struck again");
        assert_near(late("velocity", &[]), 0.0, "a step late");
    }
}
