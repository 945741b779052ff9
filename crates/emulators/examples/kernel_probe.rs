//! Drives a hand over the kernel's own CAN and hears a keyboard over the kernel's own MIDI; runs
//! inside the guest of `make test-kernel`, which has both as pure software. Each check that holds
//! prints a line that starts with PASS.
//!
//! Time is counted in turns, not by a clock: an emulated processor keeps no 3 ms deadlines.

#![allow(clippy::print_stdout, reason = "a program")]

use std::{
    error::Error,
    fs::{self, File, OpenOptions},
    io::Write,
    process::Command,
    thread::sleep,
    time::Duration,
};

use etude_emulators::{
    FreeHand, HandEmulator, HandEmulatorConfig, KeyboardEmulator, KeyboardEmulatorConfig, Line, ReleaseCoding,
};
use etude_robot::{
    allegro::{Hand, HandConfig, HandEvent, HandState},
    can::{self, CanError, CanFrame, CanTransport},
    keyboard::{
        KEY_COUNT, KeyChange, Keyboard, KeyboardConfig, KeyboardState, LossReason, MidiError, MidiPort,
    },
};

use socketcan::{CanErrorFrame, CanSocket, Socket as _, errors::CAN_ERR_BUSOFF};

type Checked = Result<(), Box<dyn Error>>;

const TURN: Duration = Duration::from_millis(1);
/// Binds and unbinds the gadget that plays the keyboard: plugs and unplugs it.
const PLUG: &str = "/sys/kernel/config/usb_gadget/keys/UDC";

fn main() -> Checked {
    bus_errors()?;
    remote_frame()?;
    hand()?;
    bus_off()?;
    bus_goes_down()?;
    keyboard("raw")?;
    if cfg!(feature = "hardware") {
        keyboard("alsa")?;
    }
    Ok(())
}

fn ensure(holds: bool, otherwise: impl FnOnce() -> String) -> Checked {
    if holds { Ok(()) } else { Err(otherwise().into()) }
}

fn bus_errors() -> Checked {
    let error = can::open("vcan7").err().ok_or("a bus that does not exist was opened")?.to_string();
    ensure(error.contains("ip link add dev vcan7 type vcan"), || error.clone())?;
    println!("PASS can-errors: {error}");
    Ok(())
}

/// All frames that are there.
fn drain(bus: &mut dyn CanTransport) -> Result<Vec<CanFrame>, CanError> {
    std::iter::from_fn(|| bus.receive().transpose()).collect()
}

fn remote_frame() -> Checked {
    let (mut one, mut other) = (can::open("vcan0")?, can::open("vcan0")?);
    let frames = [CanFrame::remote(0x200), CanFrame::new(0x180, &[0x77, 1, 0xA3, 2, 0x3E, 0xFE, 0xE3, 0xFE])];
    let frames: Vec<CanFrame> = frames.into_iter().flatten().collect();
    for &frame in &frames {
        one.send(frame)?;
    }
    sleep(TURN);
    let arrived = drain(other.as_mut())?;
    ensure(arrived == frames, || format!("{frames:?} arrived as {arrived:?}"))?;
    ensure(drain(one.as_mut())?.is_empty(), || "a sender hears itself".to_owned())?;
    println!("PASS can-frames: {arrived:?}");
    Ok(())
}

fn hand() -> Checked {
    let (mut host_bus, mut hand_bus) = (can::open("vcan0")?, can::open("vcan0")?);
    // The clock is ours, the bus is the kernel's: a frame that it hands over late, as it may in an
    // emulated guest, is no fault of the hand's.
    let mut hand = Hand::new(&HandConfig { stale_after_secs: 0.1, ..HandConfig::default() })?;
    let mut emulator = HandEmulator::new(&HandEmulatorConfig::default());
    let mut joints = FreeHand::default();
    let (mut out, mut periods, mut sent) = (Vec::new(), 0_u32, [0; 16]);
    hand.start(Duration::ZERO);
    for turn in 0..3000 {
        let now = TURN * turn;
        for frame in drain(hand_bus.as_mut())? {
            emulator.receive(now, &frame, &mut out);
        }
        joints.step(TURN.as_secs_f64(), &emulator.pwm());
        emulator.set_positions(&joints.positions());
        emulator.tick(now, &mut out);
        out.drain(..).try_for_each(|frame| hand_bus.send(frame))?;

        let mut events = Vec::new();
        for frame in drain(host_bus.as_mut())? {
            events.push(hand.receive(now, &frame));
        }
        events.push(hand.poll(now, &mut out));
        if hand.state() == HandState::Ready && events.contains(&HandEvent::Positions) {
            periods += 1;
            // A weak spring holds each joint 0.1 rad above where it rests.
            let positions = hand.positions();
            let wanted = positions.map(|rad| 200.0 * (0.5 - rad));
            sent = hand.send_pwm(now, &wanted, &mut out);
        }
        out.drain(..).try_for_each(|frame| host_bus.send(frame))?;
    }
    ensure(hand.state() == HandState::Ready, || format!("the hand is {:?}", hand.state()))?;
    ensure(periods > 800, || format!("only {periods} periods of 3 ms in 3 s"))?;
    drain(hand_bus.as_mut())?.iter().for_each(|frame| emulator.receive(TURN * 3000, frame, &mut out));
    ensure(emulator.pwm() == sent, || format!("sent {sent:?}, arrived {:?}", emulator.pwm()))?;
    let apart = hand
        .positions()
        .iter()
        .zip(joints.positions())
        .map(|(told, is)| (told - is).abs())
        .fold(0.0, f64::max);
    ensure(apart < 0.01, || format!("told angles are {apart} rad off"))?;
    println!("PASS can-hand: {periods} periods, angles within {apart:.5} rad");

    out.clear();
    hand.stop(TURN * 3000, &mut out);
    out.drain(..).try_for_each(|frame| host_bus.send(frame))?;
    sleep(TURN);
    drain(hand_bus.as_mut())?.iter().for_each(|frame| emulator.receive(TURN * 3001, frame, &mut out));
    ensure(!emulator.servo_on() && emulator.pwm() == [0; 16], || "the hand was not let go".to_owned())?;
    println!("PASS can-stop: servo off, torque zero");
    Ok(())
}

/// No virtual bus has errors of its own: the frame by which a driver tells of bus-off is sent by
/// hand.
fn bus_off() -> Checked {
    let mut bus = can::open("vcan0")?;
    let kernel = CanSocket::open("vcan0")?;
    let told = CanErrorFrame::new_error(CAN_ERR_BUSOFF, &[0; 8])?;
    kernel.write_frame(&socketcan::CanFrame::Error(told))?;
    sleep(TURN);
    let error = bus.receive().err().ok_or("bus-off was not noticed")?;
    ensure(matches!(error, CanError::Off { .. }), || error.to_string())?;
    // The interface has a carrier, so it is over.
    let _ = bus.receive();
    ensure(bus.receive()?.is_none(), || "a frame out of nothing".to_owned())?;
    println!("PASS can-off: {error}");
    Ok(())
}

fn bus_goes_down() -> Checked {
    let mut bus = can::open("vcan0")?;
    Command::new("ip").args(["link", "set", "vcan0", "down"]).status()?;
    let frame = CanFrame::remote(0x200).ok_or("no frame")?;
    let error = (0..10)
        .find_map(|_| bus.send(frame).err().or_else(|| bus.receive().err()))
        .ok_or("a bus that is down was not noticed")?;
    let again = can::open("vcan0").err().ok_or("a bus that is down was opened")?;
    println!("PASS can-down: {error}; {again}");
    Ok(())
}

/// The raw device of the sound card of this driver: `f_midi` plays the keyboard, `USB-Audio` hears
/// it.
fn raw_device(driver: &str) -> Result<String, Box<dyn Error>> {
    for _ in 0..500 {
        let cards = fs::read_to_string("/proc/asound/cards")?;
        let line = cards.lines().find(|line| line.contains("]: ") && line.contains(driver));
        if let Some(card) = line.and_then(|line| line.split_whitespace().next()) {
            let path = format!("/dev/snd/midiC{card}D0");
            if fs::exists(&path)? {
                return Ok(path);
            }
        }
        sleep(TURN * 10);
    }
    Err(format!("no sound card of {driver}: {:?}", fs::read_to_string("/proc/asound/cards")).into())
}

/// The keyboard's own end of its cable.
struct Piano {
    emulator: KeyboardEmulator,
    line: File,
    now: Duration,
}

impl Piano {
    fn new(config: &KeyboardEmulatorConfig) -> Result<Self, Box<dyn Error>> {
        let line = OpenOptions::new().write(true).open(raw_device("f_midi")?)?;
        Ok(Self { emulator: KeyboardEmulator::new(config)?, line, now: Duration::ZERO })
    }

    /// Lets so much time pass and sends what the keyboard says meanwhile.
    fn say(&mut self, millis: u32) -> Checked {
        let mut bytes = Vec::new();
        self.now += TURN * millis;
        self.emulator.poll(self.now, &mut bytes);
        Ok(self.line.write_all(&bytes)?)
    }
}

/// The driver at the other end of the cable.
struct Listener {
    port: MidiPort,
    keyboard: Keyboard,
    connected: bool,
    now: Duration,
    heard: Vec<KeyChange>,
}

impl Listener {
    /// One turn, as the robot's controller takes it.
    fn poll(&mut self) -> Result<(), MidiError> {
        let mut bytes = Vec::new();
        let received = self.port.receive(self.now, &mut bytes);
        match (received.is_ok(), self.connected) {
            (true, false) => self.keyboard.connected(self.now, &mut self.heard),
            (false, true) => self.keyboard.disconnected(self.now, &mut self.heard),
            _ => {}
        }
        self.connected = received.is_ok();
        if self.connected {
            self.keyboard.receive(self.now, &bytes, &mut self.heard);
        }
        self.keyboard.poll(self.now, &mut self.heard);
        received
    }

    /// Takes turns until something holds, a few seconds at most.
    fn wait(&mut self, what: &str, holds: impl Fn(&Self) -> bool) -> Checked {
        let mut error = None;
        for _ in 0..3000 {
            self.now += TURN;
            error = self.poll().err().or(error);
            if holds(self) {
                return Ok(());
            }
            sleep(TURN);
        }
        let state = self.keyboard.state();
        Err(format!("{what}: {state}; {error:?}; {} changes", self.heard.len()).into())
    }
}

fn keyboard(way: &str) -> Checked {
    let listened = raw_device("USB-Audio")?;
    let spec = if way == "raw" { format!("raw:{listened}") } else { format!("{way}:keystation") };
    let mut listener = Listener {
        port: MidiPort::new(&spec),
        keyboard: Keyboard::new(&KeyboardConfig::default())?,
        connected: false,
        now: Duration::ZERO,
        heard: Vec::new(),
    };
    listener.wait("opening", |listener| listener.keyboard.state() == KeyboardState::Present)?;

    let mut expected = Vec::new();
    for (release, running_status) in
        [(ReleaseCoding::ZeroVelocity, true), (ReleaseCoding::NoteOff, false), (ReleaseCoding::NoteOff, true)]
    {
        let clock_secs = Some(0.02);
        let config = KeyboardEmulatorConfig {
            release,
            running_status,
            line: Line::Din,
            clock_secs,
            ..KeyboardEmulatorConfig::default()
        };
        let mut piano = Piano::new(&config)?;
        for key in 0..KEY_COUNT {
            piano.emulator.press(piano.now, key, 2 * key as u8 + 1);
            piano.say(2)?;
            piano.emulator.release(piano.now, key);
            expected.extend([(key, 2 * key as u8 + 1), (key, 0)]);
        }
        piano.say(100)?;
        listener.wait("playing", |listener| listener.heard.len() >= expected.len())?;
    }
    let heard: Vec<_> = listener.heard.iter().map(|change| (change.key, change.velocity)).collect();
    ensure(heard == expected, || format!("{heard:?} instead of {expected:?}"))?;
    let warnings: Vec<_> = listener.keyboard.warnings().collect();
    ensure(warnings.is_empty(), || format!("{warnings:?}"))?;
    println!("PASS keyboard-{way}: all {} presses and releases, nothing else", heard.len());

    unplug_and_replug(way, &mut listener)
}

fn unplug_and_replug(way: &str, listener: &mut Listener) -> Checked {
    let udc = fs::read_to_string(PLUG)?;
    let mut piano = Piano::new(&KeyboardEmulatorConfig::default())?;
    piano.emulator.press(piano.now, 24, 100);
    piano.say(1)?;
    listener.wait("pressing", |listener| listener.keyboard.pressed() == 1 << 24)?;
    drop(piano);
    fs::write(PLUG, "\n")?;
    listener
        .wait("unplugging", |listener| matches!(listener.keyboard.state(), KeyboardState::Lost { .. }))?;
    ensure(listener.keyboard.pressed() == 0, || "a key of a lost keyboard is down".to_owned())?;
    let lost = listener.keyboard.state();
    fs::write(PLUG, udc.trim())?;
    raw_device("USB-Audio")?;
    listener.wait("replugging", |listener| listener.keyboard.state() == KeyboardState::Present)?;
    let mut piano = Piano::new(&KeyboardEmulatorConfig {
        sensing_secs: Some(0.27),
        ..KeyboardEmulatorConfig::default()
    })?;
    piano.emulator.press(piano.now, 3, 7);
    piano.say(300)?;
    listener.wait("pressing again", |listener| listener.keyboard.pressed() == 1 << 3)?;
    println!("PASS keyboard-{way}-replug: {lost}; then it came back by itself");

    let silent = |listener: &Listener| {
        matches!(listener.keyboard.state(), KeyboardState::Lost { reason: LossReason::Silent, .. })
    };
    listener.wait("falling silent", silent)?;
    println!("PASS keyboard-{way}-sensing: {}", listener.keyboard.state());
    Ok(())
}
