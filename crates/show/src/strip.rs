//! The strip below the pictures of a video: the piano roll, which moves from right to left past a
//! line for the current time.

use etude_music::key_is_black;

use crate::replay::{FILL_OF_OUT_OF_TIME, NoteJudgement, Take, TakeNote};

/// Share of a picture's height.
const SHARE: f64 = 0.22;
/// Seconds from the left edge to the right one, and the past share of them.
const SPAN_SECS: f64 = 6.0;
const PAST: f64 = 0.3;
/// At least an octave is shown.
const MIN_ROWS: u8 = 13;

/// A due note that has not been played yet.
const COMING: [u8; 3] = [0x9d, 0xc9, 0xe6];

/// Distance of the hatch lines of a missed note, pixels.
const HATCH: f64 = 5.0;

const PAPER: [u8; 3] = [0xff, 0xff, 0xff];
const SHADE: [u8; 3] = [0xec, 0xea, 0xe6];
const LINE: [u8; 3] = [0xbd, 0xb8, 0xb0];
const INK: [u8; 3] = [0x24, 0x26, 0x2a];

/// A note that is due, or what was played of it.
struct Bar {
    pitch: u8,
    secs: [f64; 2],
    judgement: Option<NoteJudgement>,
}

/// The strip of one take.
pub(crate) struct Strip {
    low: u8,
    high: u8,
    bars: Vec<Bar>,
    bar_lines: Vec<f64>,
    /// The rows of the keys, on which the notes are drawn.
    paper: Canvas,
}

impl Strip {
    /// Height of the strip in a picture of `height` pixels; even, as videos need it.
    pub fn height_in(height: u32) -> u32 {
        (SHARE * f64::from(height) / 2.0) as u32 * 2
    }

    /// The strip of `take`; none without notes.
    pub fn new(take: &Take, width: u32, height: u32) -> Option<Self> {
        let (mut low, mut high) = take.pitch_range()?;
        // An empty row above and below, and an octave at least.
        (low, high) = (low - 1, high + 1);
        while high - low + 1 < MIN_ROWS {
            high += 1;
            low -= u8::from(high - low + 1 < MIN_ROWS);
        }
        let bar =
            |note: TakeNote, judgement| Bar { pitch: note.pitch, secs: [note.start, note.end], judgement };
        let due = take.due_notes.iter().map(|note| bar(*note, None));
        let played = take.judged_notes().into_iter().map(|judged| bar(judged.note, Some(judged.judgement)));
        let (width, height) = (width as usize, height as usize);
        let paper = Canvas { pixels: PAPER.repeat(width * height), width, height };
        let bar_lines = take.bar_secs.clone();
        let mut strip = Self { low, high, bars: due.chain(played).collect(), bar_lines, paper };
        for pitch in (low..=high).filter(|pitch| key_is_black(usize::from(*pitch))) {
            let rows = strip.rows(pitch, 0.0);
            strip.paper.fill([0.0, width as f64], rows, SHADE);
        }
        Some(strip)
    }

    /// Upper and lower edge of a pitch's row without the share `inset` on either side, pixels.
    fn rows(&self, pitch: u8, inset: f64) -> [f64; 2] {
        let row = self.paper.height as f64 / f64::from(self.high - self.low + 1);
        let top = f64::from(self.high - pitch) * row;
        [top + inset * row, top + (1.0 - inset) * row]
    }

    /// The strip at a time: rows from top to bottom, three bytes a pixel. Past notes show their
    /// judgement.
    pub fn paint(&self, secs: f64) -> Vec<u8> {
        let mut canvas = self.paper.clone();
        let (width, height) = (canvas.width as f64, canvas.height as f64);
        let x = move |at: f64| ((at - secs) / SPAN_SECS + PAST) * width;
        for at in &self.bar_lines {
            canvas.fill([x(*at), x(*at) + 1.0], [0.0, height], LINE);
        }
        for bar in &self.bars {
            let [from, to] = bar.secs;
            // Judgements differ in shape too, not only in colour.
            let inset = if bar.judgement == Some(NoteJudgement::Wrong) { 0.28 } else { 0.08 };
            let colour = bar.judgement.map_or(COMING, NoteJudgement::colour);
            let to = if bar.judgement.is_some() { to.min(secs) } else { to };
            if from < to && x(to) > 0.0 && x(from) < width {
                canvas.fill([x(from), x(to)], self.rows(bar.pitch, inset), colour);
                let within = ([x(from) + 1.5, x(to) - 1.5], self.rows(bar.pitch, 0.22));
                match bar.judgement {
                    Some(NoteJudgement::OutOfTime) => canvas.fill(within.0, within.1, pale(colour)),
                    Some(NoteJudgement::Missed) => canvas.hatch(within.0, within.1, colour),
                    _ => {}
                }
            }
        }
        canvas.fill([x(secs) - 1.0, x(secs) + 1.0], [0.0, height], INK);
        canvas.fill([0.0, width], [0.0, 1.0], LINE);
        canvas.pixels
    }
}

/// The colour at [`FILL_OF_OUT_OF_TIME`] on the paper.
fn pale(colour: [u8; 3]) -> [u8; 3] {
    let mixed = |channel: usize| {
        let [from, to] = [PAPER[channel], colour[channel]].map(f64::from);
        (from + FILL_OF_OUT_OF_TIME * (to - from)).round() as u8
    };
    std::array::from_fn(mixed)
}

#[derive(Clone)]
struct Canvas {
    pixels: Vec<u8>,
    width: usize,
    height: usize,
}

impl Canvas {
    /// Fills a rectangle with the paper's colour and diagonal lines, which move with it.
    fn hatch(&mut self, xs: [f64; 2], ys: [f64; 2], colour: [u8; 3]) {
        self.fill(xs, ys, PAPER);
        for row in ys[0].ceil() as usize..ys[1] as usize {
            let mut from = xs[0] + (row as f64 - ys[0]).rem_euclid(HATCH) - HATCH;
            while from < xs[1] {
                let line = [from.max(xs[0]), (from + HATCH / 2.0).min(xs[1])];
                self.fill(line, [row as f64, row as f64 + 1.0], colour);
                from += HATCH;
            }
        }
    }

    /// Fills a rectangle with anti-aliased edges, so that the roll moves smoothly.
    fn fill(&mut self, xs: [f64; 2], ys: [f64; 2], colour: [u8; 3]) {
        let clipped = |[from, to]: [f64; 2], limit: usize| {
            let limit = limit as f64;
            [from.clamp(0.0, limit), to.clamp(0.0, limit)]
        };
        let (xs, ys) = (clipped(xs, self.width), clipped(ys, self.height));
        if xs[0] >= xs[1] || ys[0] >= ys[1] {
            return;
        }
        let share = |[from, to]: [f64; 2], pixel: usize| {
            let pixel = pixel as f64;
            (to.min(pixel + 1.0) - from.max(pixel)).clamp(0.0, 1.0)
        };
        for row in ys[0] as usize..ys[1].ceil() as usize {
            let down = share(ys, row);
            for column in xs[0] as usize..xs[1].ceil() as usize {
                let covered = down * share(xs, column);
                let pixel = &mut self.pixels[3 * (row * self.width + column)..][..3];
                if covered == 1.0 {
                    pixel.copy_from_slice(&colour);
                    continue;
                }
                for (value, new) in pixel.iter_mut().zip(colour) {
                    *value = (f64::from(*value) * (1.0 - covered) + f64::from(new) * covered).round() as u8;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use etude_perform::{Activity, DueNote, Header, KeyMessage, Recording, StepMessage};
    use etude_stage::DRIVEN_JOINTS;

    use super::*;

    /// Two seconds: C4 is due in the first and played, E4 in the second and missed; G4 sounds in
    /// the second and is not due.
    fn take() -> Take {
        let step = |index: usize| StepMessage {
            positions: vec![0.0; DRIVEN_JOINTS],
            pressed: vec![if index < 20 { 60 } else { 67 }],
            ..StepMessage::default()
        };
        let note =
            |pitch, start_secs: f64| DueNote { pitch, start_secs, end_secs: start_secs + 1.0, velocity: 80 };
        let key = |secs, pitch, velocity| KeyMessage { secs, pitch, velocity };
        let header = Header {
            control_hz: 20.0,
            activity: Activity::Rest,
            due: (0..40).map(|index| vec![if index < 20 { 60 } else { 64 }]).collect(),
            due_notes: vec![note(60, 0.0), note(64, 1.0)],
            ..Header::default()
        };
        let keys = vec![key(0.0, 60, 80), key(1.0, 60, 0), key(1.0, 67, 80), key(2.0, 67, 0)];
        let recording = Recording {
            header,
            steps: (0..40).map(step).collect(),
            keys,
            complete: true,
            ..Recording::default()
        };
        Take::new(&recording, "r".to_string()).unwrap()
    }

    #[test]
    fn notes_run_to_the_line_and_show_how_they_were_played() {
        let strip = Strip::new(&take(), 600, 130).unwrap();
        // 100 pixels a second, now at 180.
        let at = |secs: f64, x: usize, pitch: u8| -> [u8; 3] {
            let y = strip.rows(pitch, 0.5)[0] as usize;
            let pixels = strip.paint(secs);
            pixels[3 * (y * 600 + x)..][..3].try_into().unwrap()
        };
        // Before it begins, both notes are to come.
        assert_eq!(at(-0.5, 180 + 100, 60), COMING);
        assert_eq!(at(-0.5, 180 + 200, 64), COMING);
        assert_ne!(at(-0.5, 180 + 200, 67), NoteJudgement::Wrong.colour());
        // In the middle of the first, its beginning was right, its end is to come.
        assert_eq!(at(0.5, 180 - 25, 60), NoteJudgement::Right.colour());
        assert_eq!(at(0.5, 180 + 25, 60), COMING);
        assert_eq!(at(0.5, 180, 60), INK);
        // At the end the second was missed: an outline, hatched; and another key sounded.
        let edge = strip.rows(64, 0.15)[0] as usize;
        assert_eq!(at(2.0, 180 - 50, 67), NoteJudgement::Wrong.colour());
        let pixels = strip.paint(2.0);
        assert_eq!(pixels[3 * (edge * 600 + 130)..][..3], NoteJudgement::Missed.colour());
        let middle = strip.rows(64, 0.5)[0] as usize;
        let row: Vec<[u8; 3]> =
            (100..160).map(|x| pixels[3 * (middle * 600 + x)..][..3].try_into().unwrap()).collect();
        assert!(row.contains(&PAPER) && row.contains(&NoteJudgement::Missed.colour()));
    }
}
