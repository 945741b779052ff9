use super::*;
use etude_robot::allegro::{self, DeviceId, Finger, HandMessage, HostMessage, Request};
use etude_stage::geometry::KeyShape;
use etude_stage::params::WorldRow;

fn twin(twin_params: &str) -> Twin {
    Twin::new(&TwinParams::parse(twin_params).unwrap(), HandSide::Left).unwrap()
}

/// The middle finger bends at its root under this duty, from above the keys: what the keyboard says
/// in half a second.
fn strike(twin_params: &str, pwm: i16) -> Vec<u8> {
    let mut twin = twin(twin_params);
    let pose = twin.world.start_pose();
    twin.world.reset_to(&pose);
    twin.devices.arm.place(*twin.path.middle());
    let torque = HostMessage::Torque { finger: Finger::Middle, pwm: [0, pwm, 0, 0] };
    for message in [HostMessage::ServoOn, torque] {
        twin.devices.hand.receive(twin.now, &message.encode(DeviceId::default()), &mut Vec::new());
    }
    let mut said = Vec::new();
    for _ in 0..500 {
        twin.step();
        twin.devices.keyboard.poll(twin.now, &mut said);
    }
    said
}

/// In the paper's home the arm holds the hand clear of the keyboard: without power the fingers
/// hang, and no key sounds.
#[test]
fn an_arm_that_is_not_at_the_keys_holds_the_hand_above_them() {
    let mut twin = Twin::new(&TwinParams::load("standard").unwrap(), HandSide::Left).unwrap();
    for _ in 0..2000 {
        twin.step();
    }
    assert!(twin.joints()[1] > 0.5, "{:?}", twin.joints());
    assert!((0..KEY_COUNT).all(|key| twin.world.key_travel(key) < 1e-3));
    assert!(twin.lift > 0.3, "{} m", twin.lift);
    twin.devices.arm.place(*twin.path.middle());
    twin.step();
    assert_eq!(twin.lift, 0.0);
}

#[test]
fn the_world_is_not_the_simulators() {
    let options = |name: &str| TwinParams::load(name).unwrap().hidden.options();
    let simulators = etude_stage::ModelOptions::default();
    for name in ["standard", "worn"] {
        let options = options(name);
        assert_ne!(options.integrator, simulators.integrator);
        assert_ne!(options.cone, simulators.cone);
        assert_ne!(options.keys, simulators.keys);
        assert_ne!(options.keyboard_yaw_rad, simulators.keyboard_yaw_rad);
    }
    assert_eq!(options("standard").step_secs, 0.001);
}

#[test]
fn a_turned_keyboard_has_its_ends_elsewhere() {
    let straight = twin("");
    let turned = twin("[world]\nkeyboard_yaw_rad = 0.01");
    for key in SHOWN_KEYS {
        let [x, y, _] = straight.world.key_target(key);
        let [turned_x, turned_y, _] = turned.world.key_target(key);
        let (sine, cosine) = 0.01f64.sin_cos();
        assert!((turned_x - (x * cosine - y * sine)).abs() < 1e-12, "{key}");
        assert!((turned_y - (x * sine + y * cosine)).abs() < 1e-12, "{key}");
        // The body in the world stands where that says, and is turned.
        let data = turned.world.data();
        let body = data.body(&format!("key_{key}")).unwrap().view(data);
        let shape = KeyShape::of(key);
        let target_from_middle = [shape.target()[0] - shape.x, 0.0];
        assert!((body.xpos[0] + target_from_middle[0] * cosine - turned_x).abs() < 1e-12, "{key}");
        assert!((body.xpos[1] + target_from_middle[0] * sine - turned_y).abs() < 1e-12, "{key}");
        assert!((body.xquat[3] - 0.005f64.sin()).abs() < 1e-12, "{key}");
    }
    let ends =
        [0, KEY_COUNT - 1].map(|key| turned.world.key_target(key)[0] - straight.world.key_target(key)[0]);
    assert!(ends[0] > 0.003 && ends[1] < -0.003, "{ends:?}");
}

#[test]
fn a_harder_strike_is_louder_on_the_wire() {
    let (soft, hard) = (strike("", 100), strike("", 600));
    assert!(soft.len() >= 3 && hard.len() >= 3, "{soft:?} {hard:?}");
    assert_eq!([soft[0], hard[0]], [0x90, 0x90]);
    assert!(soft[2] > 1 && soft[2] + 10 < hard[2], "{soft:?} {hard:?}");
    for stuck in ["[hand]\ndead_pwm = 100", "[physics]\n\"joint.fingers.friction\" = 0.1"] {
        assert!(strike(stuck, 100).is_empty(), "{stuck}");
    }
    // A key with a preload is not moved by a finger whose weight and push are less.
    assert!(!strike("", 40).is_empty());
    assert!(strike("[physics]\n\"key.preload\" = 1.5", 40).is_empty());
}

/// A finger joint, alone and under a steady duty for 0.2 s: how far it turned, rad.
fn turned_under(twin_params: &str, pwm: i16) -> f64 {
    const JOINT: usize = 5;
    let mut twin = twin(twin_params);
    let before = twin.world.joints()[JOINT];
    let mut duty = [0; allegro::WIRE_JOINTS];
    duty[JOINT] = pwm;
    for _ in 0..200 {
        let mut torques = [0.0; DRIVEN_JOINTS];
        torques[JOINT] = twin.drives.torque(JOINT, &duty, 0.0);
        twin.drive(&torques);
    }
    twin.world.joints()[JOINT] - before
}

#[test]
fn a_joint_sticks_until_it_breaks_loose() {
    // 24 of 1200 are 0.02 N·m: more than moves it on its way, less than breaks it loose.
    let sliding = "[physics]\n\"joint.fingers.friction\" = 0.015";
    let sticking = format!("{sliding}\n\"joint.fingers.friction_at_rest\" = 1.5");
    let dead = "[hand]\ndead_pwm = 24";
    assert!(turned_under("", 24) > 0.1);
    assert!(turned_under(sliding, 24) > 0.05);
    assert!(turned_under(&sticking, 24).abs() < 1e-3, "{}", turned_under(&sticking, 24));
    assert!(turned_under(&sticking, 40) > 0.1);
    // Friction that holds does hold: without it MuJoCo's joints creep.
    assert!(turned_under(sliding, 14).abs() < 1e-3, "{}", turned_under(sliding, 14));
    assert_eq!(turned_under(dead, 24), 0.0);
    let weak = "[hand]\nfull_torque_nm = [1, 0.5, 1, 1]";
    assert!((turned_under(weak, 48) - turned_under("", 24)).abs() < 1e-9);
}

#[test]
fn a_joint_ends_at_its_stop() {
    const JOINT: usize = 4;
    let mut twin = twin("");
    let mut farthest = 0.0f64;
    for _ in 0..300 {
        twin.drive(&std::array::from_fn(|joint| if joint == JOINT { 0.3 } else { 0.0 }));
        farthest = farthest.max(twin.world.joints()[JOINT]);
    }
    let [_, stop] = etude_stage::joint_range(JOINT);
    assert!((stop..stop + 0.03).contains(&farthest), "{farthest} beyond {stop}");
}

#[test]
fn keys_have_their_own_springs_and_thresholds() {
    let spread = |seed: u64| {
        twin(&format!("seed = {seed}\n[keys]\nstiffness_spread = 0.2\nthreshold_spread = 0.1\ntravel = 1.1"))
    };
    let springs = |twin: &Twin| -> Vec<f64> {
        let model = twin.world.data().model();
        (0..KEY_COUNT)
            .map(|key| model.joint(&format!("key_{key}")).unwrap().view(model).stiffness[0])
            .collect()
    };
    let (one, same, other) = (spread(1), spread(1), spread(2));
    assert_eq!(springs(&one), springs(&same));
    assert_ne!(springs(&one), springs(&other));
    assert!(one.twin_params.hidden.options().keys.iter().all(|key| key.travel == 1.1));
    assert_eq!(one.keys.second, same.keys.second);
    assert_ne!(one.keys.second, other.keys.second);
    let nominal = one.world.params().world(WorldRow::KeyStiffness);
    assert!(springs(&one).iter().all(|spring| (spring / nominal - 1.0).abs() <= 0.2));
    assert!(springs(&one).iter().any(|spring| (spring / nominal - 1.0).abs() > 0.1));
    assert!(springs(&twin("seed = 1")).iter().all(|spring| *spring == nominal));
}

#[test]
fn what_the_hand_sends_is_what_its_encoders_read() {
    let mut loose = twin("[hand]\nencoder_backlash_rad = 0.02\nnoise_counts = 0");
    let mut pose = [0.0; DRIVEN_JOINTS];
    pose[5] = 0.5;
    loose.world.reset_to(&pose);
    loose.show_joints();
    let mut answer = Vec::new();
    let device = DeviceId::default();
    let question = HostMessage::Request(Request::Position(Finger::Middle)).encode(device);
    loose.devices.hand.receive(loose.now, &question, &mut answer);
    let Some(HandMessage::Position { counts, .. }) = HandMessage::decode(device, &answer[0]) else {
        panic!("{answer:?}");
    };
    // Half the backlash short of the link, in whole counts.
    assert_eq!(counts, [0, allegro::counts_from_rad(0.49), 0, 0]);
}

/// Full duty, and no friction or damping but the motor's own: the joint's speed is the one in the
/// twin parameters. With friction and viscosity it is slower as the textbook says.
#[test]
fn a_joint_turns_as_fast_as_its_parameter_set_says() {
    const JOINT: usize = 5;
    let fastest = |twin_params: &str| {
        let mut twin = twin(twin_params);
        let mut duty = [0; allegro::WIRE_JOINTS];
        duty[JOINT] = 1200;
        let mut pose = [0.0; DRIVEN_JOINTS];
        // From one stop to the other, away from the keys.
        pose[JOINT] = 1.6;
        pose[JOINT + 1] = 1.6;
        twin.world.reset_to(&pose);
        duty[JOINT] = -1200;
        let mut fastest = 0.0_f64;
        for _ in 0..140 {
            let speed = twin.world.joint_velocities()[JOINT];
            let mut torques = [0.0; DRIVEN_JOINTS];
            torques[JOINT] = twin.drives.torque(JOINT, &duty, speed);
            // The rest of the finger stays as it is.
            for joint in [JOINT - 1, JOINT + 1, JOINT + 2] {
                torques[joint] = 20.0 * (pose[joint] - twin.world.joints()[joint])
                    - 0.2 * twin.world.joint_velocities()[joint];
            }
            twin.drive(&torques);
            fastest = fastest.max(-twin.world.joint_velocities()[JOINT]);
        }
        fastest
    };
    let free = "[physics]\n\"joint.fingers.viscosity\" = 0.0\n[hand]\nno_load_rad_per_sec = ";
    for speed in [7.0, 10.0, 13.0] {
        let measured = fastest(&format!("{free}{speed:?}"));
        assert!((measured / speed - 1.0).abs() < 0.03, "{measured} rad/s, not {speed}");
    }
    let held = "[physics]\n\"joint.fingers.viscosity\" = 0.02\n\"joint.fingers.friction\" = 0.03\n\
                [hand]\nfull_torque_nm = [0.9, 0.9, 0.9, 0.9]\nno_load_rad_per_sec = 9.0";
    let (measured, expected) = (fastest(held), (0.9 - 0.03) / (0.9 / 9.0 + 0.02));
    assert!((measured / expected - 1.0).abs() < 0.03, "{measured} rad/s, not {expected}");
}

/// Just below its dead band a joint stands, just above it turns; in the parameter sets that ship as
/// in one that is drawn.
#[test]
fn a_joint_stands_below_its_dead_band() {
    for name in ["standard", "worn", "random:3"] {
        // Its weight is another matter.
        let twin_params = TwinParams::load(name).unwrap().with("[world]\ngravity = false").unwrap();
        for joint in [0, 1, 5, 10] {
            let hidden = &twin_params.hidden;
            let band = hidden.dead_band(&hidden.params().unwrap(), joint);
            let turned = |pwm: f64| {
                let mut twin = Twin::new(&twin_params, HandSide::Left).unwrap();
                let before = twin.world.joints()[joint];
                let mut duty = [0; allegro::WIRE_JOINTS];
                duty[joint] = pwm as i16;
                for _ in 0..200 {
                    let mut torques = [0.0; DRIVEN_JOINTS];
                    torques[joint] = twin.drives.torque(joint, &duty, twin.world.joint_velocities()[joint]);
                    twin.drive(&torques);
                }
                (twin.world.joints()[joint] - before).abs()
            };
            let (stands, turns) = (turned(0.95 * band), turned(1.1 * band + 1.0));
            assert!(
                stands < 2e-3 && turns > 5e-3,
                "{name} {joint}: {band} of 1200, {stands} and {turns} rad"
            );
        }
    }
}

/// A turning joint keeps turning as before when its motor's torque turns round, for the time that
/// the motor takes to cross the backlash.
#[test]
fn a_torque_crosses_the_backlash_before_it_slows_the_joint() {
    const JOINT: usize = 5;
    let reversed = |twin_params: &str| {
        let mut twin = twin(twin_params);
        let mut duty = [0; allegro::WIRE_JOINTS];
        let mut step = |pwm: i16| {
            duty[JOINT] = pwm;
            let (speeds, drives) = (twin.world.joint_velocities(), &twin.drives);
            let mut torques = [0.0; DRIVEN_JOINTS];
            torques[JOINT] =
                twin.backlash.pass(JOINT, |speed| drives.torque(JOINT, &duty, speed), speeds[JOINT]);
            twin.drive(&torques);
            twin.world.joint_velocities()[JOINT]
        };
        let fast = (0..30).map(|_| step(60)).last().unwrap();
        (1..200_u32).find(|_| step(-60) < 0.99 * fast).unwrap()
    };
    let numbers = "[physics]\n\"joint.fingers.armature\" = 0.001\n\"joint.fingers.viscosity\" = 0.0\n[hand]\nmotor_backlash_rad = ";
    assert!(reversed(&format!("{numbers}0.0")) <= 2);
    for play in [0.005, 0.02] {
        // 0.05 N·m on the motor's own inertia, seen from the joint.
        let expected = (2.0 * play / (0.05 / 0.001_f64)).sqrt() * 1e3;
        let measured = f64::from(reversed(&format!("{numbers}{play}")));
        assert!((measured - expected).abs() <= 2.0, "{play} rad: {measured} ms, not {expected}");
    }
}

/// The hand hangs where its arm really is, while the arm's joints say something else.
#[test]
fn an_arm_holds_its_hand_where_its_parameter_set_says() {
    let straight = twin("");
    let off = twin("seed = 3\n[arm]\nsag_m = 0.001\nerror_m = 0.0003");
    let tip = |mut twin: Twin, rail: f64| {
        let mut pose = [0.0; DRIVEN_JOINTS];
        pose[RAIL] = rail;
        twin.world.reset_to(&pose);
        // MuJoCo computes places before it moves on.
        twin.drive(&[0.0; DRIVEN_JOINTS]);
        assert!((twin.joints()[RAIL] - rail).abs() < 1e-6, "the rail does not see it");
        twin.world.fingertip(1)
    };
    let expected = off.mount.offset(0.3).unwrap();
    let (straight, off) = (tip(straight, 0.3), tip(off, 0.3));
    assert!(
        expected[2] < -0.0004
            && (0..3).all(|axis| (off[axis] - straight[axis] - expected[axis]).abs() < 1e-6)
    );
}
