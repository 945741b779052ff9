//! Melodies by the thousand: [`melody`] draws one for each seed.
//!
//! A melody has a *character*, which is drawn first: key and mode, metre, tempo and note density,
//! the part of the keyboard, and how often it leaps, rests, has chords, holds notes and leaves its
//! scale. Its bars share two rhythms; phrases of four bars may come again. Chords and held notes
//! are such that the hand reaches them, and a leap is drawn only where the time is long enough for
//! it. docs/sight-reading.md has the figures of a thousand of them.

mod draw;
mod line;
mod rhythm;

use crate::keys::{HIGHEST_PITCH, LOWEST_PITCH};
use crate::meter::{BeatGrid, MeterSegment};
use crate::note::Note;
use crate::song::Song;
use draw::Draw;
use line::Line;
use rhythm::Cell;

/// Semitones above the tonic of the modes' degrees, each with its weight.
const MODES: [(&[u8], f64); 8] = [
    (&[0, 2, 4, 5, 7, 9, 11], 6.0),                 // major
    (&[0, 2, 3, 5, 7, 8, 10], 2.0),                 // minor
    (&[0, 2, 3, 5, 7, 8, 11], 2.0),                 // harmonic minor
    (&[0, 2, 3, 5, 7, 9, 10], 1.0),                 // Dorian
    (&[0, 2, 4, 5, 7, 9, 10], 1.0),                 // Mixolydian
    (&[0, 2, 4, 7, 9], 1.0),                        // major pentatonic
    (&[0, 3, 5, 7, 10], 1.0),                       // minor pentatonic
    (&[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11], 0.5), // chromatic
];

/// Time signatures, each with its weight.
const METRES: [([u8; 2], f64); 4] = [([4, 4], 5.0), ([3, 4], 3.0), ([2, 4], 1.0), ([6, 8], 1.0)];

/// Bars of a phrase.
const PHRASE_BARS: usize = 4;
/// Softest and loudest note, MIDI velocity.
const VELOCITIES: [f64; 2] = [25.0, 118.0];
/// A chord's or a held note's loudness as a part of the melody's.
const ACCOMPANIMENT: f64 = 0.85;
/// Probabilities of a melody that is detached, mostly legato, and without any silence between its
/// notes.
const ARTICULATIONS: [f64; 3] = [0.2, 0.5, 0.3];
/// Spread of the length of a note around that of its melody.
const LENGTH_SPREAD: f64 = 0.05;
/// Shortest note, s.
const MIN_NOTE_SECS: f64 = 0.1;

/// What the notes of a melody have in common.
struct Character {
    metre: [u8; 2],
    beat_secs: f64,
    bars: usize,
    /// Typical time from one onset to the next, s.
    onset_interval_secs: f64,
    rests: f64,
    /// Probability of a chord at each note.
    chords: f64,
    /// Probability of a held note in each bar.
    held: f64,
    /// Part of the time to the next note for which a note sounds, before its spread; from 1 + 2 ×
    /// [`LENGTH_SPREAD`] on every note sounds until the next.
    legato: f64,
    velocity: f64,
}

/// A note of a phrase.
#[derive(Clone)]
struct Event {
    /// Beats after the beginning of the phrase.
    beat: f64,
    beats: f64,
    pitches: Vec<u8>,
    /// Whether it lasts while the melody moves.
    held: bool,
}

/// The melody of this seed; the same on every machine.
///
/// ```
/// let song = etude_music::melody(7);
/// assert!(song.check_range().is_ok());
/// assert_eq!(song, etude_music::melody(7));
/// ```
pub fn melody(seed: u64) -> Song {
    let mut draw = Draw::new(seed);
    let character = character(&mut draw);
    let tonic = draw.whole(0, 11) as u8;
    let mut line = line(&mut draw, tonic);
    let Character { metre, beat_secs, .. } = character;
    let bar_beats = f64::from(metre[0]);
    let rhythms = [(); 2].map(|()| {
        rhythm::bar(&mut draw, bar_beats, beat_secs, character.onset_interval_secs, character.rests)
    });

    let mut notes = Vec::new();
    let mut before: Vec<Event> = Vec::new();
    for first in (0..character.bars).step_by(PHRASE_BARS) {
        let bars = PHRASE_BARS.min(character.bars - first);
        let again = bars == PHRASE_BARS && can_repeat(&before, &character) && draw.chance(0.4);
        if !again {
            before = phrase(&mut draw, &mut line, &character, &rhythms, bars);
        }
        if first + bars == character.bars {
            end_on_tonic(&mut before, tonic, &line.scale, bar_beats * bars as f64);
        }
        let start_secs = first as f64 * bar_beats * beat_secs;
        for event in &before {
            add_notes(&mut draw, &character, event, start_secs, &mut notes);
        }
    }
    let secs = character.bars as f64 * bar_beats * beat_secs;
    let song = Song::new(format!("Melody {seed}"), notes, secs);
    let beats = MeterSegment {
        start_secs: 0.0,
        beat_secs,
        beats_per_bar: metre[0],
        beat_unit: metre[1],
        bar: 1,
        beats_before: 0.0,
    };
    song.expect("its notes are on the keyboard and its times in order")
        .with_beats(BeatGrid::from_segments(vec![beats]))
}

/// Whether the hand can leap from the last note of a phrase to its first.
fn can_repeat(phrase: &[Event], character: &Character) -> bool {
    let mut melody = phrase.iter().filter(|event| !event.held);
    let (Some(first), Some(last)) = (melody.next(), melody.next_back()) else { return false };
    let pitch = |event: &Event| event.pitches[event.pitches.len() - 1];
    line::leap_is_playable(pitch(last), pitch(first), last.beats * character.beat_secs)
}

fn character(draw: &mut Draw) -> Character {
    let metre = METRES[draw.weighted(&METRES.map(|(_, weight)| weight)).unwrap_or(0)].0;
    let beat_secs = if metre[1] == 8 { draw.log_between(0.22, 0.5) } else { draw.log_between(0.35, 1.0) };
    let bar_secs = f64::from(metre[0]) * beat_secs;
    let bars = ((draw.between(10.0, 20.0) / bar_secs).round() as usize).max(2);
    let often = |draw: &mut Draw, probability: f64, low: f64, high: f64| {
        if draw.chance(probability) { draw.between(low, high) } else { 0.0 }
    };
    Character {
        metre,
        beat_secs,
        bars,
        onset_interval_secs: draw.log_between(0.3, 0.9),
        rests: often(draw, 0.6, 0.03, 0.2),
        chords: often(draw, 0.4, 0.1, 1.0),
        held: often(draw, 0.2, 0.3, 0.8),
        legato: match draw.weighted(&ARTICULATIONS) {
            Some(0) => draw.between(0.45, 0.75),
            Some(1) => draw.between(0.8, 1.0),
            _ => 1.0 + 2.0 * LENGTH_SPREAD,
        },
        velocity: draw.between(45.0, 95.0),
    }
}

/// The scale on this tonic (semitones above a C), from its lowest degree in the melody's part of
/// the keyboard.
fn line(draw: &mut Draw, tonic: u8) -> Line {
    let mode = MODES[draw.weighted(&MODES.map(|(_, weight)| weight)).unwrap_or(0)].0;
    let in_mode = |pitch: &u8| mode.contains(&((pitch + 12 - tonic) % 12));
    let all: Vec<u8> = (LOWEST_PITCH..=HIGHEST_PITCH).filter(in_mode).collect();
    let degrees = if draw.chance(0.1) { draw.whole(13, 22) } else { draw.whole(5, 12) }.min(all.len());
    let lowest = draw.whole(0, all.len() - degrees);
    let scale = all[lowest..lowest + degrees].to_vec();
    let leaps = draw.between(0.03, 0.35);
    let chromatic = if draw.chance(0.3) { draw.between(0.02, 0.12) } else { 0.0 };
    Line::new(scale, leaps, chromatic)
}

fn phrase(
    draw: &mut Draw,
    line: &mut Line,
    character: &Character,
    rhythms: &[Vec<Cell>; 2],
    bars: usize,
) -> Vec<Event> {
    let bar_beats = f64::from(character.metre[0]);
    let mut events = Vec::new();
    let mut since = f64::INFINITY;
    for bar in 0..bars {
        let cells = if draw.chance(0.15) {
            rhythm::bar(draw, bar_beats, character.beat_secs, character.onset_interval_secs, character.rests)
        } else {
            rhythms[usize::from(draw.chance(0.4))].clone()
        };
        let start = bar as f64 * bar_beats;
        let mut beat = start;
        let first = events.len();
        for cell in cells {
            if !cell.is_rest {
                let pitch = line.next(draw, since);
                let others = if draw.chance(character.chords) { line.chord(draw, pitch) } else { Vec::new() };
                let pitches = others.into_iter().chain([pitch]).collect();
                events.push(Event { beat, beats: cell.beats, pitches, held: false });
                since = 0.0;
            }
            since += cell.beats * character.beat_secs;
            beat += cell.beats;
        }
        let over = &events[first..];
        let single = over.len() > 1 && over.iter().all(|event: &Event| event.pitches.len() == 1);
        if single && draw.chance(character.held) {
            let pitches: Vec<u8> = over.iter().map(|event| event.pitches[0]).collect();
            if let Some(pitch) = line.held(draw, &pitches) {
                events.push(Event { beat: start, beats: bar_beats, pitches: vec![pitch], held: true });
            }
        }
    }
    events
}

/// Ends the last phrase, of `beats` beats, with the tonic that is nearest to its last note and
/// sounds until the end.
fn end_on_tonic(events: &mut Vec<Event>, tonic: u8, scale: &[u8], beats: f64) {
    let Some(last) = events.iter().rposition(|event| !event.held) else { return };
    let from = events[last].pitches[events[last].pitches.len() - 1];
    let tonics = scale.iter().filter(|pitch| **pitch % 12 == tonic);
    let pitch = tonics.min_by_key(|pitch| pitch.abs_diff(from)).copied().unwrap_or(from);
    events[last] = Event { beats: beats - events[last].beat, pitches: vec![pitch], ..events[last].clone() };
    let start = events[last].beat;
    events.retain(|event| !event.held || event.beat + event.beats <= start);
}

/// The notes of `event`, in a phrase that begins at `start_secs`.
fn add_notes(draw: &mut Draw, character: &Character, event: &Event, start_secs: f64, notes: &mut Vec<Note>) {
    let beat_secs = character.beat_secs;
    let start = start_secs + event.beat * beat_secs;
    let all = event.beats * beat_secs;
    let legato = if event.held {
        0.97
    } else {
        (character.legato * draw.between(1.0 - LENGTH_SPREAD, 1.0 + LENGTH_SPREAD)).min(1.0)
    };
    let secs = (all * legato).max(MIN_NOTE_SECS.min(all));
    let bar_beats = f64::from(character.metre[0]);
    let accent = if event.beat % bar_beats < 1e-9 { 8.0 } else { 0.0 };
    // Louder towards the middle of a phrase.
    let arc = 8.0 * (std::f64::consts::PI * event.beat / (bar_beats * PHRASE_BARS as f64)).sin();
    let velocity = character.velocity + accent + arc + draw.between(-6.0, 6.0);
    for (index, pitch) in event.pitches.iter().enumerate() {
        let is_melody = !event.held && index + 1 == event.pitches.len();
        let velocity = if is_melody { velocity } else { velocity * ACCOMPANIMENT };
        let velocity = velocity.clamp(VELOCITIES[0], VELOCITIES[1]).round() as u8;
        notes.push(Note { pitch: *pitch, velocity, start_secs: start, end_secs: start + secs });
    }
}
