//! Bars and beats of a song, which messages name with the seconds.
//!
//! The grid is a list of segments, each with one tempo and one time signature. It may begin in the
//! middle of a bar (a pickup), and later than the song (silence in front).

use std::fmt;

/// A position in the score. Bars and beats count from one; bar zero is a pickup, or silence in
/// front.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct Position {
    /// Bar number.
    pub bar: u32,
    /// Beat within the bar; 2.5 is half-way between the second and the third beat.
    pub beat: f64,
}

impl fmt::Display for Position {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let hundredths = (self.beat * 100.0).round() / 100.0;
        write!(f, "bar {}, beat {hundredths}", self.bar)
    }
}

/// A part of a song with one tempo and one time signature.
#[derive(Copy, Clone, Debug, PartialEq)]
pub(crate) struct MeterSegment {
    /// Seconds at which it begins.
    pub start_secs: f64,
    /// Length of a beat in seconds.
    pub beat_secs: f64,
    /// Upper number of the time signature.
    pub beats_per_bar: u8,
    /// Lower number of the time signature: 4 for quarter notes.
    pub beat_unit: u8,
    /// Bar in which it begins.
    pub bar: u32,
    /// Beats of that bar before the segment.
    pub beats_before: f64,
}

impl MeterSegment {
    /// Bar, and beats since its start, `beats` after the start of the segment.
    pub fn after(&self, beats: f64) -> (u32, f64) {
        let elapsed = self.beats_before + beats + BEAT_TOLERANCE;
        let per_bar = f64::from(self.beats_per_bar.max(1));
        let bars = (elapsed / per_bar).floor();
        // `as` saturates: a bar number beyond u32 stays at its largest value.
        let bar = self.bar.saturating_add(bars as u32);
        let within = (elapsed - bars * per_bar - BEAT_TOLERANCE).max(0.0);
        (bar, within)
    }
}

/// A time this close to a beat, in beats, is on it, so that rounding does not give the bar before.
const BEAT_TOLERANCE: f64 = 1e-6;
/// The same for the borders of segments, in seconds.
const SECS_TOLERANCE: f64 = 1e-6;
/// Maximum number of bar lines, more than an hour of music has: a limit for damaged tempos.
const MAX_BAR_LINES: usize = 20_000;

/// The beats of a song: which bar and beat a second falls on.
#[derive(Clone, Debug, PartialEq)]
pub struct BeatGrid {
    segments: Vec<MeterSegment>,
}

impl Default for BeatGrid {
    /// The default of MIDI files: 120 quarter notes a minute in 4/4.
    fn default() -> BeatGrid {
        BeatGrid::regular(0.5, 4, 0.0)
    }
}

impl BeatGrid {
    /// Even beats of `beat_secs` seconds, quarter notes, in bars of `beats_per_bar`. A song that
    /// starts with a pickup gives its length in `pickup_beats`, zero otherwise; those beats are the
    /// end of bar zero.
    pub fn regular(beat_secs: f64, beats_per_bar: u8, pickup_beats: f64) -> BeatGrid {
        let (bar, beats_before) =
            if pickup_beats > 0.0 { (0, f64::from(beats_per_bar) - pickup_beats) } else { (1, 0.0) };
        let first =
            MeterSegment { start_secs: 0.0, beat_secs, beats_per_bar, beat_unit: 4, bar, beats_before };
        BeatGrid { segments: vec![first] }
    }

    /// A grid of segments in order of time; there must be at least one.
    pub(crate) fn from_segments(segments: Vec<MeterSegment>) -> BeatGrid {
        if segments.is_empty() { BeatGrid::default() } else { BeatGrid { segments } }
    }

    pub(crate) fn segments(&self) -> &[MeterSegment] {
        &self.segments
    }

    /// The segment at this many seconds; none before the first.
    fn segment_at(&self, secs: f64) -> Option<&MeterSegment> {
        let index = self.segments.partition_point(|segment| segment.start_secs <= secs + SECS_TOLERANCE);
        index.checked_sub(1).map(|index| &self.segments[index])
    }

    /// Bar and beat at this many seconds.
    pub fn position(&self, secs: f64) -> Position {
        match self.segment_at(secs) {
            None => Position { bar: 0, beat: 1.0 },
            Some(segment) => {
                let (bar, beats) = segment.after((secs - segment.start_secs) / segment.beat_secs);
                Position { bar, beat: beats + 1.0 }
            }
        }
    }

    /// Length of a beat at this many seconds, s; before the first segment that of its beats.
    pub fn beat_secs(&self, secs: f64) -> f64 {
        self.segment_at(secs).unwrap_or(&self.segments[0]).beat_secs
    }

    /// Times of the bar lines from the beginning of the first full bar on, before `until_secs`, s.
    pub fn bar_lines(&self, until_secs: f64) -> Vec<f64> {
        let mut lines = Vec::new();
        for (index, segment) in self.segments.iter().enumerate() {
            let next = self.segments.get(index + 1).map_or(until_secs, |next| next.start_secs);
            let end = next.min(until_secs) - SECS_TOLERANCE;
            let per_bar = f64::from(segment.beats_per_bar.max(1));
            // A segment that begins in the middle of a bar meets its first line later.
            let first = (per_bar - segment.beats_before) % per_bar;
            let line = |bar: u32| segment.start_secs + (first + f64::from(bar) * per_bar) * segment.beat_secs;
            lines.extend((0..).map(line).take_while(|secs| *secs < end).take(MAX_BAR_LINES - lines.len()));
        }
        lines
    }

    /// The same grid, later by this many seconds (earlier if negative).
    pub(crate) fn delayed(&self, secs: f64) -> BeatGrid {
        self.map(|segment| MeterSegment { start_secs: segment.start_secs + secs, ..segment })
    }

    /// The grid of what is left when this many seconds are cut off in front.
    pub(crate) fn after_secs(&self, secs: f64) -> BeatGrid {
        let mut left = self.delayed(-secs).segments;
        let sounding = left.iter().rposition(|segment| segment.start_secs <= SECS_TOLERANCE);
        left.drain(..sounding.unwrap_or(0));
        if let Some(first) = left.first_mut().filter(|first| first.start_secs < 0.0) {
            (first.bar, first.beats_before) = first.after(-first.start_secs / first.beat_secs);
            first.start_secs = 0.0;
        }
        BeatGrid::from_segments(left)
    }

    /// The same grid with all times multiplied.
    pub(crate) fn scaled(&self, factor: f64) -> BeatGrid {
        self.map(|segment| MeterSegment {
            start_secs: segment.start_secs * factor,
            beat_secs: segment.beat_secs * factor,
            ..segment
        })
    }

    fn map(&self, change: impl Fn(MeterSegment) -> MeterSegment) -> BeatGrid {
        BeatGrid { segments: self.segments.iter().copied().map(change).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(grid: &BeatGrid, secs: f64) -> String {
        grid.position(secs).to_string()
    }

    #[test]
    fn beats_count_from_one_and_survive_rounding() {
        let grid = BeatGrid::regular(0.7, 4, 0.0);
        assert_eq!(at(&grid, 0.0), "bar 1, beat 1");
        assert_eq!(at(&grid, 0.7 * 3.5), "bar 1, beat 4.5");
        for beat in 0..1000u32 {
            let position = grid.position(f64::from(beat) * 0.7);
            assert_eq!(position.bar, beat / 4 + 1);
            assert!((position.beat - f64::from(beat % 4 + 1)).abs() < 1e-6);
        }
    }

    #[test]
    fn a_pickup_is_bar_zero() {
        let grid = BeatGrid::regular(1.0, 3, 1.0);
        assert_eq!(at(&grid, 0.0), "bar 0, beat 3");
        assert_eq!(at(&grid, 1.0), "bar 1, beat 1");
        assert_eq!(at(&grid, 4.0), "bar 2, beat 1");
    }

    #[test]
    fn bar_lines_are_where_bars_begin() {
        let pickup = BeatGrid::regular(1.0, 3, 1.0).delayed(1.0);
        assert_eq!(pickup.bar_lines(8.5), [2.0, 5.0, 8.0]);
        for secs in pickup.bar_lines(100.0) {
            assert!((pickup.position(secs).beat - 1.0).abs() < 1e-6);
        }
        assert_eq!(BeatGrid::regular(0.5, 4, 0.0).bar_lines(4.0), [0.0, 2.0]);
        assert_eq!(BeatGrid::regular(1e-9, 1, 0.0).bar_lines(10.0).len(), MAX_BAR_LINES);
    }

    #[test]
    fn silence_in_front_is_bar_zero() {
        let grid = BeatGrid::default().delayed(1.0).scaled(2.0);
        assert_eq!(at(&grid, 0.5), "bar 0, beat 1");
        assert_eq!(at(&grid, 2.0), "bar 1, beat 1");
        assert_eq!(at(&grid, 6.0), "bar 2, beat 1");
    }
}
