//! The emulator, against the documented protocol.

use std::time::Duration;

use etude_emulators::{ArmEmulator, ArmEmulatorConfig, ConnectionId, ReportKind};
use etude_robot::xarm::codec::{FEEDBACK, Frame, FrameParser, ReplyState, floats, push_floats};
use etude_robot::xarm::kinematics::{ARM_JOINTS, PAPER_HOME_DEG};

const MS: Duration = Duration::from_millis(1);

fn home() -> [f64; ARM_JOINTS] {
    PAPER_HOME_DEG.map(f64::to_radians)
}

fn apart(one: &[f64; ARM_JOINTS], other: &[f64; ARM_JOINTS]) -> f64 {
    one.iter().zip(other).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// A client of the emulator that says what it wants.
struct Client {
    emulator: ArmEmulator,
    id: ConnectionId,
    now: Duration,
    transaction: u16,
    parser: FrameParser,
    /// Kind, register and result of every command that it received.
    feedback: Vec<(u8, u8, u8)>,
}

impl Client {
    fn new() -> Self {
        let mut emulator = ArmEmulator::new(ArmEmulatorConfig::default());
        let id = emulator.connect();
        let (parser, feedback) = (FrameParser::default(), Vec::new());
        Self { emulator, id, now: Duration::ZERO, transaction: 0, parser, feedback }
    }

    /// Enabled, in this mode, and told to run.
    fn running(mode: u8) -> Self {
        let mut client = Self::new();
        for (register, params) in [(11, &[8, 1][..]), (19, &[mode][..]), (12, &[0][..])] {
            client.ask(register, params);
        }
        assert_eq!((client.emulator.state(), client.emulator.mode()), (2, mode));
        client
    }

    fn ask(&mut self, register: u8, params: &[u8]) -> (ReplyState, Vec<u8>) {
        self.transaction += 1;
        let mut bytes = Vec::new();
        Frame::new(self.transaction, 3, &[&[register], params]).unwrap().write(&mut bytes);
        self.emulator.receive(self.now, self.id, &bytes);
        let mut replies = self.hear();
        assert_eq!(replies.len(), 1, "register {register}");
        let reply = replies.remove(0);
        assert_eq!((reply.transaction, reply.protocol, reply.register()), (self.transaction, 3, register));
        let (state, params) = reply.reply().unwrap();
        (state, params.to_vec())
    }

    fn ask_floats(&mut self, register: u8, values: &[f64]) -> (ReplyState, Vec<u8>) {
        let mut params = Vec::new();
        push_floats(&mut params, &values.iter().map(|&value| value as f32).collect::<Vec<_>>());
        self.ask(register, &params)
    }

    fn servo(&mut self, joints: [f64; ARM_JOINTS]) -> ReplyState {
        self.ask_floats(29, &[&joints[..], &[0.0; 3]].concat()).0
    }

    fn run(&mut self, millis: u32) {
        self.now += MS * millis;
        self.emulator.advance(self.now);
        assert!(self.hear().is_empty());
    }

    /// The newest rich report.
    fn rich(&mut self) -> Vec<u8> {
        self.run(400);
        let mut bytes = Vec::new();
        self.emulator.take_reports(ReportKind::Rich, &mut bytes);
        bytes.split_off(bytes.len() - 587)
    }

    fn hear(&mut self) -> Vec<Frame> {
        let (mut bytes, mut replies) = (Vec::new(), Vec::new());
        self.emulator.take(self.id, &mut bytes);
        let mut bytes = bytes.as_slice();
        while let Some(frame) = self.parser.next(&mut bytes) {
            match *frame.body() {
                [FEEDBACK, _, kind, register, _, _, result, ..] => {
                    assert_eq!(frame.body().len(), 15);
                    self.feedback.push((kind, register, result));
                }
                _ => replies.push(frame),
            }
        }
        replies
    }
}

#[test]
fn the_emulator_has_the_documented_states() {
    let mut client = Client::new();
    assert_eq!((client.emulator.state(), client.emulator.mode()), (4, 0));
    for (register, params) in [(11, &[8, 1][..]), (16, &[]), (19, &[1, 0]), (35, &[0; 24]), (37, &[3])] {
        client.ask(12, &[0]);
        assert_eq!(client.emulator.state(), 2);
        let (state, _) = client.ask(register, params);
        assert_eq!(client.emulator.state(), 5, "register {register}");
        assert!(state.has(ReplyState::NOT_READY));
        let joints = client.emulator.joints();
        assert!(client.servo(home().map(|angle| angle + 0.01)).has(ReplyState::NOT_READY));
        client.run(100);
        assert_eq!(joints, client.emulator.joints(), "nothing is accepted in state 5");
    }
    client.ask(12, &[0]);
    assert_eq!(client.ask(13, &[]).1, [2]);
    assert!(!client.servo(home().map(|angle| angle + 0.01)).has(0xFF));
    client.run(50);
    assert_eq!(client.ask(13, &[]).1, [1]);
    client.ask(12, &[3]);
    assert_eq!(client.emulator.state(), 3);
    client.ask(12, &[4]);
    assert_eq!(client.emulator.state(), 4);
    client.run(100);
    client.emulator.inject_error(31);
    let (state, params) = client.ask(15, &[]);
    assert!(state.has(ReplyState::ERROR) && params == [31, 0]);
    client.ask(12, &[0]);
    assert_eq!(client.emulator.state(), 4, "not before the error is cleaned");
    client.ask(16, &[]);
    client.ask(12, &[0]);
    assert_eq!(client.emulator.state(), 2);
    // Without motors nothing moves.
    client.ask(11, &[3, 0]);
    client.ask(12, &[0]);
    assert!(client.servo(home()).has(ReplyState::NOT_READY));
}

#[test]
fn the_emulator_raises_the_documented_errors() {
    let servo = |spoil: fn(&mut [f64; ARM_JOINTS])| {
        let mut client = Client::running(1);
        let mut target = home();
        spoil(&mut target);
        client.servo(target);
        client.run(100);
        (client.emulator.error(), client.emulator.state())
    };
    assert_eq!(servo(|_| {}), (0, 2));
    assert_eq!(servo(|target| target[3] = -0.3), (23, 4));
    assert_eq!(servo(|target| target[3] = f64::NAN), (23, 4));
    assert_eq!(servo(|target| target[0] += 1.0), (24, 4));

    let mut client = Client::running(0);
    client.ask_floats(23, &[&[0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0], &[0.5, 1.0, 0.0][..]].concat());
    assert_eq!((client.emulator.error(), client.emulator.state()), (23, 4));

    // Two joints turn the flange at 2.6 rad/s each about axes far from it: faster than 1.2 m/s, no
    // joint too fast.
    let mut client = Client::running(1);
    let mut target = home();
    for _ in 0..200 {
        target[0] += 0.013;
        target[1] += 0.002;
        client.servo(target);
        client.run(5);
    }
    assert_eq!((client.emulator.error(), client.emulator.state()), (60, 4));
}

#[test]
fn the_emulator_watches_its_box() {
    let sides = |mm: [i32; 6]| mm.map(i32::to_le_bytes).as_flattened().to_vec();
    // Highest and lowest x, y, z; the paper's home is at x 524, y 0, z 585 mm.
    let mut client = Client::running(1);
    client.ask(52, &sides([700, 300, 100, -100, 700, 100]));
    let settings = client.ask(53, &[]).1;
    assert_eq!(settings.len(), 79);
    let words: Vec<i16> =
        settings[1..13].chunks(2).map(|word| i16::from_be_bytes([word[0], word[1]])).collect();
    assert_eq!((words, settings[77]), (vec![700, 300, 100, -100, 700, 100], 0));
    // It is watched once it is switched on, and no motion is needed to be outside.
    let out = |client: &mut Client| {
        let mut target = client.emulator.joints();
        for _ in 0..100 {
            target[0] += 0.003;
            client.servo(target);
            client.run(5);
        }
    };
    out(&mut client);
    client.run(1000);
    assert_eq!((client.emulator.error(), client.emulator.state()), (0, 2));
    client.ask(59, &[1]);
    assert_eq!(client.ask(53, &[]).1[77], 1);
    client.run(1);
    assert_eq!((client.emulator.error(), client.emulator.state()), (35, 4));
    // Led back, it goes on; out again, it stops near the side.
    client.emulator.place(home());
    for (register, params) in [(16, &[][..]), (12, &[0])] {
        client.ask(register, params);
    }
    client.run(10);
    assert_eq!(client.emulator.error(), 0);
    out(&mut client);
    assert_eq!((client.emulator.error(), client.emulator.state()), (35, 4));
    let pose: [f32; 6] = floats(&client.ask(41, &[]).1).unwrap();
    assert!((100.0..115.0).contains(&pose[1]), "{pose:?}");
}

#[test]
fn the_emulator_takes_limits_in_while_it_plans() {
    for (register, most) in [(31, 1e5), (32, 5e4), (33, 499.9), (34, 19.98)] {
        let mut client = Client::running(0);
        assert_eq!(client.ask_floats(register, &[most]), (ReplyState(0), vec![0, 0]), "{register}");
        assert!(client.ask_floats(register, &[most * 1.001]).0.has(ReplyState::INVALID), "{register}");
        assert!(client.ask_floats(register, &[f64::NAN]).0.has(ReplyState::INVALID), "{register}");
        let mut client = Client::running(1);
        assert!(client.ask_floats(register, &[1.0]).0.has(ReplyState::NOT_READY), "{register}");
    }
}

#[test]
fn the_emulator_plans_moves_and_tells_of_their_end() {
    let mut client = Client::running(0);
    client.ask(254, &[3]);
    let mut there = home();
    there[0] += 0.5;
    let (state, queue) = client.ask_floats(23, &[&there[..], &[0.5, 5.0, 0.0]].concat());
    assert_eq!((state, queue), (ReplyState(0), vec![0, 1]));
    client.ask(254, &[0]);
    client.run(500);
    assert_eq!(client.ask(13, &[]).1, [1]);
    client.run(700);
    assert_eq!(client.ask(13, &[]).1, [2]);
    assert!(apart(&client.emulator.joints(), &there) < 1e-6);
    assert_eq!(client.feedback, [(1, 23, 0), (2, 23, 0)]);

    // A stop discards what is left.
    client.ask(254, &[2]);
    client.ask_floats(23, &[&home()[..], &[0.2, 1.0, 0.0]].concat());
    client.ask_floats(23, &[&there[..], &[0.5, 5.0, 0.0]].concat());
    client.feedback.clear();
    client.run(100);
    assert_eq!(client.ask(14, &[]).1, [0, 1]);
    client.ask(12, &[4]);
    assert_eq!(client.feedback, [(2, 23, 2), (2, 23, 2)]);
}

#[test]
fn the_reports_have_the_documented_bytes() {
    let mut client = Client::running(1);
    client.ask_floats(36, &[1.0, 2.0, 3.0, 4.0]);
    client.ask_floats(35, &[5.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    client.emulator.inject_error(23);
    client.run(400);
    for (kind, size) in [(ReportKind::Real, 87), (ReportKind::Normal, 145), (ReportKind::Rich, 587_usize)] {
        let mut bytes = Vec::new();
        client.emulator.take_reports(kind, &mut bytes);
        let report = bytes.split_off(bytes.len() - size);
        assert_eq!((&report[..4], &report[4..7]), (&(size as u32).to_be_bytes()[..], &[0x14, 0, 0][..]));
        let joints: [f32; ARM_JOINTS] = floats(&report[7..]).unwrap();
        assert!(apart(&joints.map(f64::from), &home()) < 1e-6);
        if size > 87 {
            assert_eq!(report[87..91], [0x7F, 0x7F, 23, 0]);
            assert_eq!(floats(&report[91..]), Some([5.0]));
            assert_eq!(floats(&report[115..]), Some([1.0, 2.0, 3.0, 4.0]));
            assert_eq!((&report[131..133], floats(&report[133..])), (&[3, 3][..], Some([0.0, 0.0, -1.0])));
        }
        if size > 145 {
            assert_eq!((&report[145..149], &report[151..157]), (&[7, 7, 0xAA, 0x55][..], &b"v2.4.0"[..]));
            assert_eq!(floats(&report[181..]), Some([7000.0, 0.0, 50_000.0, 0.0, 1000.0]));
        }
    }
}

#[test]
fn the_report_of_the_control_port_has_the_documented_bytes() {
    let mut client = Client::running(4);
    // 0.2 rad/s of the first joint, for no longer than half a second.
    client.ask(81, &[&0.2_f32.to_le_bytes()[..], &[0; 24], &[1], &0.5_f32.to_le_bytes()].concat());
    client.run(400);
    let mut bytes = Vec::new();
    client.emulator.take_reports(ReportKind::Control, &mut bytes);
    bytes.clear();
    client.run(4);
    client.emulator.take_reports(ReportKind::Control, &mut bytes);
    assert_eq!((bytes.len(), &bytes[..4]), (784, &784_u32.to_be_bytes()[..]));
    assert_eq!((&bytes[4..12], bytes[12]), (&404_000_u64.to_be_bytes()[..], 0x41));
    let joints: [f32; ARM_JOINTS] = floats(&bytes[116..]).unwrap();
    assert!(apart(&joints.map(f64::from), &client.emulator.joints()) < 1e-6);
    assert!((joints[0] - 0.08).abs() < 0.003, "{joints:?}");
    let speeds: [f32; ARM_JOINTS] = floats(&bytes[144..]).unwrap();
    assert!((speeds[0] - 0.2).abs() < 1e-5, "{speeds:?}");
    let [x, y, ..]: [f32; 6] = floats(&bytes[472..]).unwrap();
    let [speed_x, speed_y, ..]: [f32; 6] = floats(&bytes[496..]).unwrap();
    assert!((speed_x + 0.2 * y).abs() < 0.1 && (speed_y - 0.2 * x).abs() < 0.1);
    // The time is over, and nothing was sent: the arm stops by itself.
    client.run(150);
    let joints = client.emulator.joints();
    client.run(100);
    assert_eq!((joints, client.emulator.state(), client.emulator.error()), (client.emulator.joints(), 2, 0));
    assert!((joints[0] - 0.1).abs() < 0.003, "{joints:?}");
}

#[test]
fn a_velocity_stops_at_the_joints_limit() {
    let mut client = Client::running(4);
    let mut speeds = [0.0; ARM_JOINTS];
    speeds[3] = 1.0;
    client.ask_floats(81, &speeds);
    client.run(3000);
    assert_eq!((client.emulator.error(), client.emulator.state()), (23, 4));
    assert!((3.9..4.0).contains(&client.emulator.joints()[3]), "{:?}", client.emulator.joints());
}

#[test]
fn a_velocity_lasts_longer_than_any_clock() {
    let mut client = Client::running(4);
    client.run(1000);
    client.ask(81, &[&0.2_f32.to_le_bytes()[..], &[0; 24], &[1], &f32::MAX.to_le_bytes()].concat());
    client.run(5000);
    assert_eq!((client.emulator.error(), client.emulator.state()), (0, 1));
    let joints = client.emulator.joints();
    assert!((joints[0] - 1.0).abs() < 0.01, "{joints:?}");
}

#[test]
fn a_cleaned_configuration_is_as_delivered() {
    let mut client = Client::running(0);
    let delivered = client.rich();
    for (register, value) in [(31, 3000.0), (32, 40_000.0), (33, 30.0), (34, 15.0)] {
        client.ask_floats(register, &[value]);
    }
    client.ask_floats(36, &[1.0, 2.0, 3.0, 4.0]);
    client.ask_floats(51, &[0.0, 1.0, 0.0]);
    client.ask(50, &[1]);
    client.ask(59, &[1]);
    let [far, back] = [1024_i32, -1024].map(i32::to_le_bytes);
    client.ask(52, &[far, back].concat().repeat(3));
    client.ask_floats(35, &[0.0, 0.0, 50.0, 0.0, 0.0, 0.0]);
    client.ask_floats(73, &[10.0, 20.0, 30.0, 0.0, 0.0, 0.0]);
    client.ask(37, &[1]);
    client.ask(38, &[1]);
    client.ask(12, &[0]);
    assert_ne!(client.rich(), delivered);
    client.ask(39, &[]);
    assert_eq!(client.emulator.state(), 5);
    client.ask(12, &[0]);
    assert_eq!(client.rich(), delivered);
}

#[test]
fn the_emulator_bears_other_protocols() {
    let mut client = Client::new();
    let mut take = |bytes: &[u8]| {
        client.emulator.receive(Duration::ZERO, client.id, bytes);
        let mut out = Vec::new();
        client.emulator.take(client.id, &mut out);
        out
    };
    assert_eq!(take(&[0, 0, 0, 1, 0, 2, 0, 0]), [], "the heartbeat of the SDK");
    assert_eq!(take(&[0, 9, 0, 0, 0, 6, 1, 3, 0, 0, 0, 1]), [0, 9, 0, 0, 0, 3, 1, 0x83, 1], "Modbus TCP");
    assert_eq!(take(&[0, 1, 0, 2, 0, 1, 201]), [0, 1, 0, 2, 0, 2, 201, 0x18], "an unknown register");
    assert_eq!(take(&[0, 1, 0, 2, 0, 1, 11])[7] & 0x08, 0x08, "too few parameters");
    // The version has a NUL within its 40 bytes: without one the SDK takes it for 0.1.0.
    let version = take(&[0, 1, 0, 2, 0, 1, 1]);
    assert_eq!(version.len(), 6 + 2 + 40);
    assert!(version[8..].starts_with(b"7,7,XS1304,AC1302,v2.4.0\0"));
    client.emulator.set_silent(true);
    client.emulator.receive(Duration::ZERO, client.id, &[0, 1, 0, 2, 0, 1, 1]);
    assert!(client.hear().is_empty());
}
