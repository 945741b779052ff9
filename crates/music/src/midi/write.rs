//! From a song to bytes.
//!
//! The beat grid becomes tempo and time signature events, so that other programs show the right
//! bars. Seconds are rounded to ticks of the tempo *as written*, and each segment starts at the
//! time that a reader will compute, so that rounding errors do not accumulate.

use midly::num::{u4, u7, u24, u28};
use midly::{Format, Header, MetaMessage, MidiMessage, Smf, Timing, Track, TrackEvent, TrackEventKind};

use crate::meter::MeterSegment;
use crate::song::Song;

/// Divisible into triplets, quintuplets and 64ths. A tick is a twentieth of a millisecond at usual
/// tempos, so that recorded performances keep their timing.
const TICKS_PER_QUARTER: u16 = 9600;
const MICROS: f64 = 1e6;
/// Lengths of a quarter note are clamped to this range, in microseconds: below, the ticks of an
/// hour would not fit their integer; above, the tempo would not fit its field.
const QUARTER_MICROS: (f64, f64) = (20_000.0, 16_777_215.0);
const MAX_TITLE_BYTES: usize = 1000;

/// A segment of one tempo as the file will hold it.
struct Span {
    tick: u32,
    secs: f64,
    micros: u32,
}

impl Span {
    fn new(tick: u32, secs: f64, segment: &MeterSegment) -> Span {
        let quarter = segment.beat_secs * MICROS * f64::from(segment.beat_unit) / 4.0;
        let micros = quarter.round().clamp(QUARTER_MICROS.0, QUARTER_MICROS.1) as u32;
        Span { tick, secs, micros }
    }

    fn secs_per_tick(&self) -> f64 {
        f64::from(self.micros) / (f64::from(TICKS_PER_QUARTER) * MICROS)
    }

    fn tick_at(&self, secs: f64) -> u32 {
        self.tick.saturating_add(((secs - self.secs) / self.secs_per_tick()).round().max(0.0) as u32)
    }

    fn secs_at(&self, tick: u32) -> f64 {
        self.secs + f64::from(tick - self.tick) * self.secs_per_tick()
    }
}

/// An event with its tick, and its rank among the events of that tick.
type RankedEvent<'a> = (u32, u32, TrackEventKind<'a>);

/// Ranks within a tick. A release comes before the next stroke of its key; a note of zero ticks
/// ends right after its start.
const RANK_SIGNATURE: u32 = 0;
const RANK_RELEASE: u32 = 1;
const RANK_FIRST_STROKE: u32 = 2;

/// The song as bytes of a format 0 file.
pub(crate) fn write(song: &Song) -> Vec<u8> {
    let mut events: Vec<RankedEvent<'_>> = Vec::with_capacity(song.notes().len() * 2 + 8);
    let spans = tempo_spans(song, &mut events);
    let tick = |secs: f64| {
        let after = spans.partition_point(|span| span.secs <= secs);
        spans[after.max(1) - 1].tick_at(secs)
    };
    for (rank, note) in (RANK_FIRST_STROKE..).zip(song.notes()) {
        let (key, vel) = (u7::from(note.pitch), u7::from(note.velocity));
        let (on, off) = (tick(note.start_secs), tick(note.end_secs));
        events.push((on, rank, midi(MidiMessage::NoteOn { key, vel })));
        let off_rank = if on == off { rank } else { RANK_RELEASE };
        events.push((off, off_rank, midi(MidiMessage::NoteOff { key, vel: 0.into() })));
    }
    let end = (tick(song.duration_secs()), u32::MAX, TrackEventKind::Meta(MetaMessage::EndOfTrack));
    events.push(end);
    events.sort_by_key(|(tick, rank, _)| (*tick, *rank));

    let mut title = song.title().len().min(MAX_TITLE_BYTES);
    while !song.title().is_char_boundary(title) {
        title -= 1;
    }
    let name = TrackEventKind::Meta(MetaMessage::TrackName(&song.title().as_bytes()[..title]));
    let mut track: Track<'_> = vec![TrackEvent { delta: 0.into(), kind: name }];
    let mut now = 0;
    for (tick, _, kind) in events {
        let mut delta = tick - now;
        while delta > u28::max_value().as_int() {
            let rest = TrackEventKind::Meta(MetaMessage::Text(b""));
            track.push(TrackEvent { delta: u28::max_value(), kind: rest });
            delta -= u28::max_value().as_int();
        }
        track.push(TrackEvent { delta: u28::from(delta), kind });
        now = tick;
    }
    let header = Header::new(Format::SingleTrack, Timing::Metrical(TICKS_PER_QUARTER.into()));
    let smf = Smf { header, tracks: vec![track] };
    let mut bytes = Vec::new();
    smf.write(&mut bytes).expect("a track of bounded notes fits a MIDI chunk, and memory takes every byte");
    bytes
}

fn midi(message: MidiMessage) -> TrackEventKind<'static> {
    TrackEventKind::Midi { channel: u4::from(0), message }
}

/// Lays the beat grid into ticks and writes its events.
fn tempo_spans<'a>(song: &Song, events: &mut Vec<RankedEvent<'a>>) -> Vec<Span> {
    let segments = song.beats().segments();
    // The segment in force at the start of the song; a grid that starts later lends its tempo to
    // the silence.
    let first = segments.partition_point(|segment| segment.start_secs <= 0.0).max(1) - 1;
    let opening = &segments[first];
    let mut spans = vec![Span::new(0, 0.0, opening)];
    events.push((0, RANK_SIGNATURE, tempo(spans[0].micros)));
    if opening.start_secs <= 0.0 {
        open_bar(opening, &spans[0], events);
    }
    let later = segments.iter().skip(if opening.start_secs > 0.0 { first } else { first + 1 });
    let mut signature = (opening.beats_per_bar, opening.beat_unit, opening.start_secs > 0.0);
    for segment in later.take_while(|segment| segment.start_secs <= song.duration_secs()) {
        let Some(span) = spans.last() else { break };
        let tick = span.tick_at(segment.start_secs);
        let next = Span::new(tick, span.secs_at(tick), segment);
        if next.micros != span.micros {
            events.push((tick, RANK_SIGNATURE, tempo(next.micros)));
        }
        if signature != (segment.beats_per_bar, segment.beat_unit, false) {
            if signature.2 {
                open_bar(segment, &Span { tick, ..next }, events);
            } else {
                events.push((tick, RANK_SIGNATURE, time_signature(segment.beats_per_bar, segment.beat_unit)));
            }
            signature = (segment.beats_per_bar, segment.beat_unit, false);
        }
        spans.push(next);
    }
    spans
}

/// The signature at the start; after a pickup of whole beats, a short bar of its own comes first.
fn open_bar<'a>(segment: &MeterSegment, span: &Span, events: &mut Vec<RankedEvent<'a>>) {
    let since_secs = (span.secs - segment.start_secs).max(0.0);
    let (_, beats_before) = segment.after(since_secs / segment.beat_secs);
    let pickup = f64::from(segment.beats_per_bar) - beats_before;
    let mut tick = span.tick;
    if beats_before > 1e-3 && (pickup - pickup.round()).abs() < 1e-3 {
        events.push((tick, RANK_SIGNATURE, time_signature(pickup.round() as u8, segment.beat_unit)));
        tick = span.tick_at(span.secs + pickup * segment.beat_secs);
    }
    events.push((tick, RANK_SIGNATURE, time_signature(segment.beats_per_bar, segment.beat_unit)));
}

fn tempo(micros: u32) -> TrackEventKind<'static> {
    TrackEventKind::Meta(MetaMessage::Tempo(u24::from(micros)))
}

fn time_signature(beats_per_bar: u8, beat_unit: u8) -> TrackEventKind<'static> {
    let power = beat_unit.max(1).ilog2() as u8;
    TrackEventKind::Meta(MetaMessage::TimeSignature(beats_per_bar, power, 24, 8))
}
