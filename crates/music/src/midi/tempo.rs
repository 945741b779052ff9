//! Ticks to seconds, and to bars.

use super::chunks::Division;
use crate::error::MidiError;
use crate::file_limits::MAX_TEMPO_CHANGES;
use crate::meter::{BeatGrid, MeterSegment};

/// Default tempo: 120 quarter notes a minute (Standard MIDI Files 1.0).
const DEFAULT_MICROS_PER_QUARTER: u32 = 500_000;
const QUARTERS_PER_WHOLE: f64 = 4.0;
const MICROS: f64 = 1e6;
/// Smallest note that a time signature may count, as a power of two: the 64th.
const SMALLEST_BEAT_POWER: u8 = 6;

/// A change of tempo or of time signature at a tick.
#[derive(Copy, Clone, Debug)]
pub(super) enum Change {
    /// Length of a quarter note in microseconds.
    Tempo(u32),
    /// Beats in a bar, and the beat as a fraction of a whole note.
    Signature { beats_per_bar: u8, beat_unit: u8 },
}

impl Change {
    /// A time signature event, unless no music could have it; bars are labels, so an odd one is not
    /// an error.
    pub fn signature(numerator: u8, denominator_power: u8) -> Option<Change> {
        (numerator > 0 && denominator_power <= SMALLEST_BEAT_POWER)
            .then(|| Change::Signature { beats_per_bar: numerator, beat_unit: 1 << denominator_power })
    }
}

/// All changes of a file, collected from every track.
#[derive(Default)]
pub(super) struct Changes(Vec<(u64, Change)>);

impl Changes {
    pub fn push(&mut self, tick: u64, change: Change) -> Result<(), MidiError> {
        if self.0.len() >= MAX_TEMPO_CHANGES {
            return Err(MidiError(format!(
                "the file changes tempo or time signature more than {MAX_TEMPO_CHANGES} times; export it with a simpler \
                 tempo track"
            )));
        }
        self.0.push((tick, change));
        Ok(())
    }

    /// The map of a file with this division. Changes at one tick take effect in the order of their
    /// tracks.
    pub fn into_map(mut self, division: Division) -> TempoMap {
        self.0.sort_by_key(|(tick, _)| *tick);
        let mut map = TempoMap { division, tempos: vec![], segments: vec![] };
        map.tempos.push(Tempo { tick: 0, secs: 0.0, micros_per_quarter: DEFAULT_MICROS_PER_QUARTER });
        map.segments.push((0, map.segment(0.0, DEFAULT_MICROS_PER_QUARTER, 4, 4, 1, 0.0)));
        for (tick, change) in self.0 {
            map.apply(tick, change);
        }
        map
    }
}

struct Tempo {
    tick: u64,
    secs: f64,
    micros_per_quarter: u32,
}

/// Where each tick lies in seconds and in bars.
pub(super) struct TempoMap {
    division: Division,
    tempos: Vec<Tempo>,
    segments: Vec<(u64, MeterSegment)>,
}

impl TempoMap {
    /// Seconds from the start of the file.
    pub fn secs(&self, tick: u64) -> f64 {
        match self.division {
            Division::Seconds(secs_per_tick) => tick as f64 * secs_per_tick,
            Division::PerQuarter(ticks_per_quarter) => {
                let after = self.tempos.partition_point(|tempo| tempo.tick <= tick);
                // The first tempo is at tick zero, so there is always one before.
                let tempo = &self.tempos[after.max(1) - 1];
                let ticks = (tick - tempo.tick) as f64;
                let micros = ticks * f64::from(tempo.micros_per_quarter);
                tempo.secs + micros / (f64::from(ticks_per_quarter) * MICROS)
            }
        }
    }

    pub fn into_beats(self) -> BeatGrid {
        BeatGrid::from_segments(self.segments.into_iter().map(|(_, segment)| segment).collect())
    }

    fn apply(&mut self, tick: u64, change: Change) {
        let secs = self.secs(tick);
        let (Some(tempo), Some(&(since, last))) = (self.tempos.last(), self.segments.last()) else { return };
        let mut micros = tempo.micros_per_quarter;
        let (mut beats_per_bar, mut beat_unit) = (last.beats_per_bar, last.beat_unit);
        let (mut bar, mut beats_before) = last.after(self.beats_between(since, tick, &last));
        match change {
            Change::Tempo(new) => {
                micros = new;
                let tempo = Tempo { tick, secs, micros_per_quarter: micros };
                replace_or_push(&mut self.tempos, tempo, |last| last.tick == tick);
            }
            Change::Signature { beats_per_bar: beats, beat_unit: unit } => {
                (beats_per_bar, beat_unit) = (beats, unit);
                // A new signature begins a bar, even if the old one was not full.
                bar = if beats_before > 1e-3 { bar.saturating_add(1) } else { bar };
                beats_before = 0.0;
            }
        }
        let segment = self.segment(secs, micros, beats_per_bar, beat_unit, bar, beats_before);
        replace_or_push(&mut self.segments, (tick, segment), |last| last.0 == tick);
    }

    fn beats_between(&self, from: u64, to: u64, segment: &MeterSegment) -> f64 {
        match self.division {
            Division::Seconds(secs_per_tick) => (to - from) as f64 * secs_per_tick / segment.beat_secs,
            Division::PerQuarter(ticks) => {
                (to - from) as f64 / f64::from(ticks) * f64::from(segment.beat_unit) / QUARTERS_PER_WHOLE
            }
        }
    }

    fn segment(
        &self,
        start_secs: f64,
        micros_per_quarter: u32,
        beats_per_bar: u8,
        beat_unit: u8,
        bar: u32,
        beats_before: f64,
    ) -> MeterSegment {
        let quarter_secs = f64::from(micros_per_quarter) / MICROS;
        let beat_secs = quarter_secs * QUARTERS_PER_WHOLE / f64::from(beat_unit);
        MeterSegment { start_secs, beat_secs, beats_per_bar, beat_unit, bar, beats_before }
    }
}

fn replace_or_push<T>(list: &mut Vec<T>, item: T, same: impl Fn(&T) -> bool) {
    match list.last_mut() {
        Some(last) if same(last) => *last = item,
        _ => list.push(item),
    }
}
