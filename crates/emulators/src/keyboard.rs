//! An emulated keyboard: the same bytes as a real one, at the same speed.
//!
//! It is not documented how the Keystation codes releases and whether it sends active sensing, so
//! both are settings, and the driver is tested with all of them.

use std::{collections::VecDeque, time::Duration};

use etude_checks::{RangeError, settings};
use serde::{Deserialize, Serialize};

use etude_robot::keyboard::{KEY_COUNT, MAX_LOWEST_PITCH};

/// How a release is coded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ReleaseCoding {
    /// Note-on with velocity 0, which lasr-lab/learning-to-play-piano relies on.
    #[default]
    ZeroVelocity,
    /// Note-off.
    NoteOff,
}

/// What the bytes travel on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Line {
    /// Whole messages, at the next millisecond frame; USB packets have no running status.
    #[default]
    Usb,
    /// A five-pin cable of 31,250 baud: 320 µs a byte, real-time bytes between the bytes of a
    /// message.
    Din,
}

impl Line {
    /// Time that one byte takes.
    const fn byte_time(self) -> Duration {
        match self {
            Self::Usb => Duration::ZERO,
            Self::Din => Duration::from_micros(320),
        }
    }

    /// When something that is ready may start at the earliest.
    fn start(self, ready: Duration) -> Duration {
        const FRAME_NANOS: u128 = 1_000_000;
        match self {
            Self::Din => ready,
            Self::Usb => {
                let rest = ready.as_nanos() % FRAME_NANOS;
                let wait = if rest == 0 { 0 } else { FRAME_NANOS - rest };
                ready.saturating_add(Duration::from_nanos(wait as u64))
            }
        }
    }
}

settings! {
    /// What can be set of a [`KeyboardEmulator`].
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub struct KeyboardEmulatorConfig("keyboard") {
        /// MIDI number of the leftmost key.
        pub lowest_pitch: u8 = 36, 0.0..=MAX_LOWEST_PITCH;
        /// How releases are coded.
        pub release: ReleaseCoding = ReleaseCoding::default();
        /// Whether a status byte that stays the same is left out; on a [`Line::Din`] only.
        pub running_status: bool = false;
        /// What the bytes travel on.
        pub line: Line = Line::default();
        /// Active sensing after so much silence, in seconds. None: never.
        pub sensing_secs: Option<f64> = None, 0.001..=86_400.0;
        /// A timing clock byte every so often, in seconds. None: never.
        pub clock_secs: Option<f64> = None, 0.001..=86_400.0;
    }
}

/// Bytes that wait for the line at most; a message that finds no room is dropped.
const QUEUE_BYTES: usize = 1024;
/// After a longer pause between polls, older clock bytes are left out.
const MEMORY: Duration = Duration::from_secs(10);
/// A time later than all events: a century.
const FOREVER: Duration = Duration::from_secs(3_155_760_000);

/// Sends the presses and releases of its keys over the line.
///
/// Time must not go back from one call to the next.
#[derive(Clone, Debug)]
pub struct KeyboardEmulator {
    lowest_pitch: u8,
    release: ReleaseCoding,
    running_status: bool,
    line: Line,
    sensing: Option<Duration>,
    clock: Option<Duration>,
    plugged: bool,
    /// The keys that are down.
    down: [bool; KEY_COUNT],
    status: Option<u8>,
    queue: VecDeque<(Duration, u8)>,
    line_free_at: Duration,
    clock_at: Duration,
}

impl KeyboardEmulator {
    /// A keyboard that is plugged in at time zero, no key down.
    ///
    /// # Errors
    /// If a setting is not valid.
    pub fn new(config: &KeyboardEmulatorConfig) -> Result<Self, RangeError> {
        let KeyboardEmulatorConfig { lowest_pitch, release, running_status, line, sensing_secs, clock_secs } =
            *config;
        config.check_ranges()?;
        let [sensing, clock] = [sensing_secs, clock_secs].map(|secs| secs.map(Duration::from_secs_f64));
        Ok(Self {
            lowest_pitch,
            release,
            running_status: running_status && line == Line::Din,
            line,
            sensing,
            clock,
            plugged: true,
            down: [false; KEY_COUNT],
            status: None,
            queue: VecDeque::new(),
            line_free_at: Duration::ZERO,
            clock_at: clock.unwrap_or_default(),
        })
    }

    /// A key (from the left, 0 to 48) goes down with a velocity of 1 to 127. Nothing happens if it
    /// is down already.
    pub fn press(&mut self, now: Duration, key: usize, velocity: u8) {
        if let Some(down) = self.down.get_mut(key).filter(|down| self.plugged && !**down) {
            *down = true;
            self.send(now, [0x90, self.lowest_pitch + key as u8, velocity.clamp(1, 127)]);
        }
    }

    /// A key comes up. Nothing happens if it is up already.
    pub fn release(&mut self, now: Duration, key: usize) {
        if self.down.get_mut(key).is_some_and(std::mem::take) {
            let note = self.lowest_pitch + key as u8;
            self.send(
                now,
                match self.release {
                    ReleaseCoding::ZeroVelocity => [0x90, note, 0],
                    ReleaseCoding::NoteOff => [0x80, note, 64],
                },
            );
        }
    }

    /// Unplugs it: bytes on their way are lost, and nothing is sent until [`plug`](Self::plug).
    pub fn unplug(&mut self) {
        self.plugged = false;
        self.queue.clear();
        self.down = [false; KEY_COUNT];
        self.status = None;
    }

    /// Plugs it in again. A key that is still down sends nothing until it is pressed again.
    pub fn plug(&mut self, now: Duration) {
        if !self.plugged {
            self.plugged = true;
            self.line_free_at = now;
            self.clock_at = self.clock.map(|clock| now.saturating_add(clock)).unwrap_or_default();
        }
    }

    /// Appends the bytes that have arrived at the other end by `now`.
    pub fn poll(&mut self, now: Duration, out: &mut Vec<u8>) {
        if !self.plugged {
            return;
        }
        // No step goes beyond the largest time.
        let now = now.min(FOREVER);
        let memory = now.saturating_sub(MEMORY);
        self.clock_at = self.clock_at.max(memory);
        self.line_free_at = self.line_free_at.max(memory);
        while let Some((start, byte)) = self.next() {
            let arrival = start.saturating_add(self.line.byte_time());
            if arrival > now {
                break;
            }
            match byte {
                Next::Clock => self.clock_at = self.clock_at.saturating_add(self.clock.unwrap_or(MEMORY)),
                Next::Queued(_) => drop(self.queue.pop_front()),
                Next::Sensing => {}
            }
            self.line_free_at = arrival;
            out.push(match byte {
                Next::Clock => 0xF8,
                Next::Sensing => 0xFE,
                Next::Queued(byte) => byte,
            });
        }
    }

    /// What the line carries next, and when that starts.
    fn next(&self) -> Option<(Duration, Next)> {
        let start = |ready: Duration| self.line.start(ready).max(self.line_free_at);
        let clock = self.clock.map(|_| (start(self.clock_at), Next::Clock));
        let queued = self.queue.front().map(|&(ready, byte)| (start(ready), Next::Queued(byte)));
        let sensing =
            self.sensing.map(|after| (start(self.line_free_at.saturating_add(after)), Next::Sensing));
        // The first of those that start at the same time: real-time bytes go before the rest of a
        // message.
        [clock, queued, sensing].into_iter().flatten().min_by_key(|&(start, _)| start)
    }

    fn send(&mut self, now: Duration, message: [u8; 3]) {
        if self.queue.len() + message.len() > QUEUE_BYTES {
            return;
        }
        let skipped = usize::from(self.running_status && self.status == message.first().copied());
        self.status = message.first().copied();
        self.queue.extend(message.iter().skip(skipped).map(|&byte| (now, byte)));
    }
}

#[derive(Clone, Copy)]
enum Next {
    Clock,
    Queued(u8),
    Sensing,
}
