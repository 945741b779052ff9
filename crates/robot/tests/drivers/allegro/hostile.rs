//! Frames and requests that make no sense: the torques stay within the table.

use std::time::Duration;

use etude_emulators::{HandEmulator, HandEmulatorConfig};
use etude_robot::allegro::{
    DeviceId, Hand, HandConfig, HandState, HostMessage, JOINT_LIMITS_RAD, PWM_LIMITS, WIRE_JOINTS,
};
use etude_robot::can::CanFrame;
use proptest::prelude::*;
use rand::SeedableRng as _;
use rand_pcg::Pcg64;

use super::Bench;

#[test]
fn what_was_sent_is_said_and_within_the_table() {
    let mut config = HandConfig::default();
    config.pwm_limit[2] = 10;
    let mut bench = Bench::new(&config, &HandEmulatorConfig::default());
    bench.start();
    let mut wanted = [1e9; WIRE_JOINTS];
    (wanted[0], wanted[1], wanted[3], wanted[4], wanted[5]) = (f64::NAN, -1e9, f64::INFINITY, -3.99, 374.99);
    let mut out = vec![];
    let sent = bench.hand.send_pwm(bench.now, &wanted, &mut out);
    let mut allowed = PWM_LIMITS;
    (allowed[0], allowed[1], allowed[2], allowed[3], allowed[4], allowed[5]) = (0, -675, 10, 0, -3, 374);
    assert_eq!(sent, allowed);
    let mut on_wire = vec![];
    for frame in &out {
        if let Some(HostMessage::Torque { pwm, .. }) = HostMessage::decode(DeviceId::default(), frame) {
            on_wire.extend(pwm);
        }
    }
    assert_eq!(on_wire, sent);
}

/// Frames that a hand, a host or a broken bus could send: identifiers mostly with a meaning, and
/// this share of them with any bytes, the others with some that let a driver go on.
fn random_frame(random: &mut Pcg64, hostile: f64) -> CanFrame {
    let known = [
        0x100, 0x104, 0x180, 0x184, 0x188, 0x18C, 0x204, 0x200, 0x220, 0x80, 0x84, 0x88, 0x8C, 0xC0, 0xE0,
        0xE4, 0x40,
    ];
    let known = known[random.random_range(0..known.len())];
    let wild = random.random_bool(hostile);
    let id = if wild && random.random_bool(0.1) { random.random_range(0..=CanFrame::MAX_ID) } else { known };
    if random.random_bool(0.1) {
        return CanFrame::remote(id).unwrap();
    }
    // More positions would be those of two hands.
    let id = if !wild && (0x80..=0x8C).contains(&id) && random.random_bool(0.8) { 0x40 } else { id };
    let small = random.random_range(0..100);
    let (data, len) = match id {
        _ if wild => (random.random(), random.random_range(0..=8)),
        0x200 => ([0, 4, 1, 1, 1, 30, 1, 0], 7),
        0xE0 | 0xE4 => ([30; 8], 4),
        0x80..=0x8C => ([small, 0, small, 0, small, 0, small, 0], 8),
        0x220 => (*b"A0000001", 8),
        0x204 => ([3, 0, 0, 0, 0, 0, 0, 0], 6),
        0x100 | 0x104 => ([0; 8], 0),
        _ => (random.random(), 8),
    };
    CanFrame::new(id, &data[..len]).unwrap()
}

fn within_the_table(first_joint: usize, pwm: &[i16]) -> bool {
    pwm.iter().zip(&PWM_LIMITS[first_joint..]).all(|(pwm, limit)| pwm.unsigned_abs() <= limit.unsigned_abs())
}

/// Half a million frames into a driver, and into an emulator that hears it too; any torques asked
/// for; starts and stops at any time. Gives how often the driver sent a torque.
fn storm(hostile: f64) -> u32 {
    let mut random = Pcg64::seed_from_u64(11);
    let config = HandEmulatorConfig { noise_counts: 100, ..HandEmulatorConfig::default() };
    let mut emulator = HandEmulator::new(&config);
    let mut hand = Hand::new(&HandConfig { stale_after_secs: 0.1, ..HandConfig::default() }).unwrap();
    let (mut now, mut driven) = (Duration::ZERO, 0);
    for _ in 0..500_000 {
        now += Duration::from_micros(random.random_range(0..300));
        let (mut to_host, mut to_hand) = (vec![random_frame(&mut random, hostile)], vec![]);
        emulator.receive(now, &to_host[0].clone(), &mut to_host);
        emulator.tick(now, &mut to_host);
        assert!(within_the_table(0, &emulator.pwm()));
        // Another program that drives the hand is a fault at once.
        let drives = |frame: &CanFrame| {
            HostMessage::decode(DeviceId::default(), frame).is_some_and(|message| message.drives())
        };
        for frame in to_host.iter().filter(|frame| hostile == 1.0 || !drives(frame)) {
            let _ = hand.receive(now, frame);
        }
        let _ = hand.poll(now, &mut to_hand);
        if !matches!(hand.state(), HandState::Starting | HandState::Ready) && random.random_bool(0.1) {
            hand.start(now);
        }
        if random.random_bool(0.0001) {
            hand.stop(now, &mut to_hand);
        }
        let wanted: [f64; WIRE_JOINTS] = std::array::from_fn(|_| f64::from_bits(random.random()));
        let sent = hand.send_pwm(now, &wanted, &mut to_hand);
        assert!(within_the_table(0, &sent));
        driven += u32::from(sent != [0; WIRE_JOINTS]);
        for frame in to_hand {
            let message = HostMessage::decode(DeviceId::default(), &frame);
            if let Some(HostMessage::Torque { finger, pwm }) = message {
                assert!(within_the_table(4 * finger.number(), &pwm));
            }
            emulator.receive(now, &frame, &mut vec![]);
        }
    }
    driven
}

#[test]
fn a_million_random_frames_and_never_more_than_the_table() {
    let driven = [1.0, 0.1, 0.001].map(storm);
    // Anything at all stops it before long; what is almost right does not, and is driven.
    assert!(driven[0] < 1000 && driven[2] > 100_000, "{driven:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Any torques asked of a ready hand, any limits configured: the wire stays within both.
    #[test]
    fn no_request_passes_the_limits(
        wanted in prop::collection::vec(any::<[u64; WIRE_JOINTS]>(), 20), shares in any::<[u8; WIRE_JOINTS]>(),
    ) {
        let mut config = HandConfig::default();
        for (limit, share) in config.pwm_limit.iter_mut().zip(shares) {
            *limit = (i32::from(*limit) * i32::from(share) / 255) as i16;
        }
        let mut bench = Bench::new(&config, &HandEmulatorConfig::default());
        bench.attended = false;
        bench.start();
        for bits in wanted {
            let mut out = vec![];
            let sent = bench.hand.send_pwm(bench.now, &bits.map(f64::from_bits), &mut out);
            prop_assert_eq!(out.len(), 4);
            let within = |(pwm, limit): (&i16, i16)| (-limit..=limit).contains(pwm);
            prop_assert!(sent.iter().zip(config.pwm_limit).all(within));
            let on_wire: Vec<u8> = out.iter().flat_map(|frame| frame.payload().to_vec()).collect();
            prop_assert_eq!(on_wire, sent.map(i16::to_le_bytes).concat());
        }
    }

    /// Wherever the joints are within their limits, the hand starts and its positions are right to
    /// a count.
    #[test]
    fn positions_are_those_of_the_joints(shares in any::<[u8; WIRE_JOINTS]>()) {
        let mut bench = Bench::default();
        let pose = std::array::from_fn(|joint| {
            let [lower, upper] = JOINT_LIMITS_RAD[joint];
            lower + f64::from(shares[joint]) / 255.0 * (upper - lower)
        });
        bench.attended = false;
        bench.free.set_positions(&pose);
        bench.start();
        prop_assert_eq!(bench.hand.state(), HandState::Ready);
        prop_assert!(bench.hand.positions().iter().zip(pose).all(|(told, is)| (told - is).abs() < 1e-4));
    }
}
