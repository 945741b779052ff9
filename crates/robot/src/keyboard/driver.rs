//! Which keys are down: the bytes of the keyboard turned into presses and releases, and what is
//! wrong with it.
//!
//! **What stops the robot, and what only warns.** A *fault* is what makes every further step blind
//! or unsafe, and there is only one: the keyboard is [lost](KeyboardState::Lost). Its keys are part
//! of what the policy sees, so a policy that continued would act on wrong observations; and a
//! keyboard whose cable was pulled may have been moved, so that the hand would come down on a frame
//! where keys are expected. Everything else is a *warning* ([`KeyboardWarning`]): a shifted, stuck
//! or noisy keyboard spoils the music and the score, but the hand moves within the same limits over
//! the same keys, and a sudden stop would not help. Warnings stay until the operator
//! [acknowledges](Keyboard::acknowledge) them; no performance should start while there are any. A
//! loss ends when the keyboard is back: the controller that stopped the robot decides when it may
//! move again.

use std::{fmt, time::Duration};

use etude_checks::RangeError;

use super::{
    KEY_COUNT, KeyboardConfig,
    parser::{MidiEvent, MidiParser},
    shift::{Shift, ShiftWatch},
};

/// Channels of a MIDI stream.
const CHANNELS: usize = 16;

/// A key went down or came up.
///
/// Presses and releases of one key always alternate, even if the stream was damaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KeyChange {
    /// When it was received.
    pub at: Duration,
    /// From the left, 0 to 48.
    pub key: usize,
    /// 1 to 127 for a press, 0 for a release.
    pub velocity: u8,
}

/// Whether the state of the keys is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeyboardState {
    /// It was never connected.
    Absent,
    /// It is connected.
    Present,
    /// It was there and is gone: a fault that stops the robot.
    Lost {
        /// When we noticed.
        at: Duration,
        /// How we noticed.
        reason: LossReason,
    },
}

/// How the loss of a keyboard was noticed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LossReason {
    /// Whatever carries its bytes ended: the cable was pulled, or the program at the other end
    /// stopped.
    Disconnected,
    /// It used to send active sensing, and fell silent.
    Silent,
}

impl fmt::Display for KeyboardState {
    /// What is the matter, and what to do.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Absent => write!(f, "no keyboard yet: plug it in and switch it on"),
            Self::Present => write!(f, "the keyboard is connected"),
            Self::Lost { at, reason } => {
                let how = match reason {
                    LossReason::Disconnected => "was unplugged",
                    LossReason::Silent => "stopped sending active sensing",
                };
                write!(
                    f,
                    "the keyboard {how} at {:.3} s: check its cable and that it was not moved",
                    at.as_secs_f64()
                )
            }
        }
    }
}

/// A warning for the operator, which does not stop the robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeyboardWarning {
    /// Notes that no key of an unshifted keyboard has. They were left out, not corrected.
    Shifted(Shift),
    /// A key was down for longer than the songs ever hold one.
    Stuck {
        /// From the left, 0 to 48.
        key: usize,
    },
    /// Parts of the byte stream could not be read.
    Damaged {
        /// How many since the last acknowledgement.
        pieces: u64,
    },
    /// Presses of keys that were down already, or releases of keys that were up.
    Unpaired {
        /// How many since the last acknowledgement.
        events: u64,
    },
    /// Notes on other channels than the first one: a second keyboard plays into the port. They
    /// count, because nothing says which of the two the robot plays, and a key that is down must
    /// hold the rail back.
    OtherChannels {
        /// Channel of the first note since the last acknowledgement, 0 to 15.
        first: u8,
        /// The other channels: bit `c` is channel `c`.
        others: u16,
        /// Notes on them.
        notes: u64,
    },
}

impl KeyboardWarning {
    /// Whether another warning says no more than this one but a count.
    pub fn is_about_the_same(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Damaged { .. }, Self::Damaged { .. }) | (Self::Unpaired { .. }, Self::Unpaired { .. }) => {
                true
            }
            (Self::OtherChannels { others, .. }, Self::OtherChannels { others: theirs, .. }) => {
                others == theirs
            }
            _ => self == other,
        }
    }
}

impl fmt::Display for KeyboardWarning {
    /// What was noticed, and what to do.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Shifted(shift) => write!(f, "{shift}"),
            Self::Stuck { key } => {
                write!(
                    f,
                    "key {key} (from the left, the first is 0) stays down: see whether it or a finger is \
                     jammed"
                )
            }
            Self::Damaged { pieces } => {
                write!(
                    f,
                    "the keyboard's bytes were damaged {pieces} times: check the cable, use a shorter one or \
                     another port"
                )
            }
            Self::Unpaired { events } => write!(
                f,
                "{events} presses or releases do not pair up, so some were lost: check the cable, and that \
                 nothing else plays into this port"
            ),
            Self::OtherChannels { first, others, notes } => {
                // People and keyboards count channels from 1.
                let others = (0..16).filter(|channel| others & (1 << channel) != 0);
                let others: Vec<String> = others.map(|channel| (channel + 1).to_string()).collect();
                write!(
                    f,
                    "the first note came on MIDI channel {}, and {notes} on channel {}: a second keyboard plays into \
                     this port, and its notes count as the robot's; unplug it, then play again",
                    first + 1,
                    others.join(", ")
                )
            }
        }
    }
}

/// The driver of the keyboard, without input or output itself.
///
/// Each cycle: hand it all bytes that have come ([`receive`](Self::receive)), then the time
/// ([`poll`](Self::poll)). A keyboard that sends no active sensing and whose cable breaks without
/// notice looks the same as one that is not played.
#[derive(Clone, Debug)]
pub struct Keyboard {
    lowest_pitch: u8,
    stuck_after: Duration,
    sensing_timeout: Duration,
    parser: MidiParser,
    state: KeyboardState,
    pressed: u64,
    /// Keys that were pressed or released since the connection: the first release of another
    /// belongs to a press before it.
    seen: u64,
    pressed_at: [Duration; KEY_COUNT],
    /// When the last byte came, once the keyboard has shown that it sends active sensing.
    sensed_at: Option<Duration>,
    shift_watch: ShiftWatch,
    shift: Option<Shift>,
    /// Keys that stayed down for too long: this press, and any press since the last
    /// acknowledgement.
    stuck_now: u64,
    stuck: u64,
    /// Presses of keys that were down already and releases of keys that were up, since the last
    /// acknowledgement.
    unpaired: u64,
    /// Damaged parts of the stream at the last acknowledgement.
    damage_seen: u64,
    /// Notes on each channel since the last acknowledgement, and the channel of the first.
    channel_notes: [u64; CHANNELS],
    first_channel: Option<u8>,
}

impl Keyboard {
    /// The driver of a keyboard that is not connected yet.
    ///
    /// # Errors
    /// If a setting makes no sense.
    pub fn new(config: &KeyboardConfig) -> Result<Self, RangeError> {
        config.check_ranges()?;
        Ok(Self {
            lowest_pitch: config.lowest_pitch,
            stuck_after: Duration::from_secs_f64(config.stuck_after_secs),
            sensing_timeout: Duration::from_secs_f64(config.sensing_timeout_secs),
            parser: MidiParser::new(),
            state: KeyboardState::Absent,
            pressed: 0,
            seen: 0,
            pressed_at: [Duration::ZERO; KEY_COUNT],
            sensed_at: None,
            shift_watch: ShiftWatch::new(config.lowest_pitch),
            shift: None,
            stuck_now: 0,
            stuck: 0,
            unpaired: 0,
            damage_seen: 0,
            channel_notes: [0; CHANNELS],
            first_channel: None,
        })
    }

    /// The connection was made, for the first time or again. Keys that were down are released,
    /// because releases may have been missed.
    pub fn connected(&mut self, now: Duration, changes: &mut Vec<KeyChange>) {
        self.release_all(now, changes);
        self.parser.restart();
        self.shift_watch.restart();
        self.seen = 0;
        self.sensed_at = None;
        self.state = KeyboardState::Present;
    }

    /// The connection ended. All keys are released.
    pub fn disconnected(&mut self, now: Duration, changes: &mut Vec<KeyChange>) {
        if self.state == KeyboardState::Present {
            self.lose(now, LossReason::Disconnected, changes);
        }
    }

    /// Bytes from the keyboard, in any pieces; appends what they changed. That bytes come proves
    /// that it is there.
    pub fn receive(&mut self, now: Duration, bytes: &[u8], changes: &mut Vec<KeyChange>) {
        if bytes.is_empty() {
            return;
        }
        self.state = KeyboardState::Present;
        for &byte in bytes {
            match self.parser.push(byte) {
                Some(MidiEvent::NoteOn { channel, note, velocity }) => {
                    self.count(channel);
                    self.press(now, note, velocity, changes);
                }
                Some(MidiEvent::NoteOff { note, .. }) => self.release(now, note, changes),
                Some(MidiEvent::ActiveSensing) => self.sensed_at = Some(now),
                None => {}
            }
        }
        self.sensed_at = self.sensed_at.map(|_| now);
    }

    /// Time passes: notices silence and stuck keys. Pass all received bytes first.
    pub fn poll(&mut self, now: Duration, changes: &mut Vec<KeyChange>) {
        let silent = self.sensed_at.is_some_and(|at| now.saturating_sub(at) > self.sensing_timeout);
        if silent && self.state == KeyboardState::Present {
            self.lose(now, LossReason::Silent, changes);
        }
        for (key, &since) in self.pressed_at.iter().enumerate() {
            let bit = self.pressed & (1 << key) & !self.stuck_now;
            if bit != 0 && now.saturating_sub(since) > self.stuck_after {
                self.stuck_now |= bit;
                self.stuck |= bit;
            }
        }
    }

    /// The keys that are down: bit `k` is key `k` from the left; bits from 49 up are never set.
    pub fn pressed(&self) -> u64 {
        self.pressed
    }

    /// Whether the keyboard is connected; [`KeyboardState::Lost`] is a fault.
    pub fn state(&self) -> KeyboardState {
        self.state
    }

    /// The warnings, until they are [acknowledged](Self::acknowledge).
    pub fn warnings(&self) -> impl Iterator<Item = KeyboardWarning> + '_ {
        let (pieces, events) = (self.parser.damaged() - self.damage_seen, self.unpaired);
        let stuck = (0..KEY_COUNT).filter(|key| self.stuck & (1 << key) != 0);
        let shifted = self.shift.map(KeyboardWarning::Shifted).into_iter();
        shifted
            .chain(stuck.map(|key| KeyboardWarning::Stuck { key }))
            .chain((pieces > 0).then_some(KeyboardWarning::Damaged { pieces }))
            .chain((events > 0).then_some(KeyboardWarning::Unpaired { events }))
            .chain(self.other_channels())
    }

    /// The operator has seen the warnings: they go, and come back only if their cause does.
    pub fn acknowledge(&mut self) {
        (self.unpaired, self.damage_seen) = (0, self.parser.damaged());
        (self.shift, self.stuck) = (None, 0);
        (self.channel_notes, self.first_channel) = ([0; CHANNELS], None);
        self.shift_watch.restart();
    }

    /// Counts a note of a channel.
    fn count(&mut self, channel: u8) {
        self.first_channel.get_or_insert(channel);
        if let Some(notes) = self.channel_notes.get_mut(usize::from(channel)) {
            *notes += 1;
        }
    }

    /// The warning of notes on more than one channel.
    fn other_channels(&self) -> Option<KeyboardWarning> {
        let first = self.first_channel?;
        let notes = (0..).zip(self.channel_notes).filter(|(channel, _)| *channel != first);
        let (others, notes) = notes
            .filter(|(_, notes)| *notes > 0)
            .fold((0, 0), |(others, sum), (channel, notes)| (others | 1_u16 << channel, sum + notes));
        (notes > 0).then_some(KeyboardWarning::OtherChannels { first, others, notes })
    }

    fn lose(&mut self, now: Duration, reason: LossReason, changes: &mut Vec<KeyChange>) {
        self.release_all(now, changes);
        self.parser.restart();
        self.state = KeyboardState::Lost { at: now, reason };
    }

    fn release_all(&mut self, now: Duration, changes: &mut Vec<KeyChange>) {
        for key in (0..KEY_COUNT).filter(|key| self.pressed & (1 << key) != 0) {
            changes.push(KeyChange { at: now, key, velocity: 0 });
        }
        (self.pressed, self.stuck_now) = (0, 0);
    }

    /// The key of a note, if the keyboard has it.
    fn key(&mut self, note: u8) -> Option<usize> {
        self.shift = self.shift_watch.hear(note).or(self.shift);
        note.checked_sub(self.lowest_pitch).map(usize::from).filter(|&key| key < KEY_COUNT)
    }

    fn press(&mut self, now: Duration, note: u8, velocity: u8, changes: &mut Vec<KeyChange>) {
        let Some(key) = self.key(note) else { return };
        if self.pressed & (1 << key) != 0 {
            // It cannot go down twice without coming up: the release was lost, the new onset is
            // real.
            self.unpaired += 1;
            changes.push(KeyChange { at: now, key, velocity: 0 });
        }
        self.pressed |= 1 << key;
        self.seen |= 1 << key;
        self.stuck_now &= !(1 << key);
        if let Some(since) = self.pressed_at.get_mut(key) {
            *since = now;
        }
        changes.push(KeyChange { at: now, key, velocity });
    }

    fn release(&mut self, now: Duration, note: u8, changes: &mut Vec<KeyChange>) {
        let Some(key) = self.key(note) else { return };
        let first = self.seen & (1 << key) == 0;
        self.seen |= 1 << key;
        if self.pressed & (1 << key) == 0 {
            self.unpaired += u64::from(!first);
            return;
        }
        self.pressed &= !(1 << key);
        self.stuck_now &= !(1 << key);
        changes.push(KeyChange { at: now, key, velocity: 0 });
    }
}
