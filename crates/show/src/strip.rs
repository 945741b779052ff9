//! The strip below the pictures of a video: the piano roll, which runs from right to left past a line that is now.

use etude_music::key_is_black;

use crate::replay::{PlayedNote, Shown, Take};

/// Share of a picture's height.
const SHARE: f64 = 0.22;
/// Seconds from the left edge to the right one, and the share of them that is past.
const SPAN_SECS: f64 = 6.0;
const PAST: f64 = 0.3;
/// At least an octave is shown.
const LEAST_ROWS: u8 = 13;

/// Okabe and Ito's colours, told apart by every kind of colour vision, as on the replay page (`viewer/src/theme.js`).
pub(crate) const RIGHT: [u8; 3] = [0x00, 0x72, 0xb2];
pub(crate) const OFF: [u8; 3] = [0xcc, 0x79, 0xa7];
pub(crate) const MISSED: [u8; 3] = [0xd5, 0x5e, 0x00];
pub(crate) const WRONG: [u8; 3] = [0xe6, 0x9f, 0x00];
/// A stroke that is not judged.
const PLAYED: [u8; 3] = [0x62, 0x65, 0x6b];
pub(crate) const DUE: [u8; 3] = [0x56, 0xb4, 0xe9];
/// What is still to come.
const COMING: [u8; 3] = [0x9d, 0xc9, 0xe6];

/// How opaque the inside of a stroke is that comes too early or too late.
pub(crate) const FILL_OF_OFF: f64 = 0.35;
/// From one line of the hatch of a missed note to the next, pixels.
const HATCH: f64 = 5.0;

const PAPER: [u8; 3] = [0xff, 0xff, 0xff];
const SHADE: [u8; 3] = [0xec, 0xea, 0xe6];
const LINE: [u8; 3] = [0xbd, 0xb8, 0xb0];
const INK: [u8; 3] = [0x24, 0x26, 0x2a];

/// The colour of a stroke or of a missed note.
pub(crate) fn colour(shown: Shown) -> [u8; 3] {
    match shown {
        Shown::Right => RIGHT,
        Shown::Off => OFF,
        Shown::Missed => MISSED,
        Shown::Wrong => WRONG,
        Shown::Played => PLAYED,
    }
}

/// A note that is due, or what was played of it.
struct Bar {
    pitch: u8,
    secs: [f64; 2],
    shown: Option<Shown>,
}

/// The strip of one take.
pub(crate) struct Strip {
    width: usize,
    height: usize,
    low: u8,
    high: u8,
    bars: Vec<Bar>,
    bar_lines: Vec<f64>,
    /// The rows of the keys, on which the notes are drawn.
    paper: Vec<u8>,
    pixels: Vec<u8>,
}

impl Strip {
    /// Height of the strip in a picture of `height` pixels; even, as videos want it.
    pub fn height_in(height: u32) -> u32 {
        (SHARE * f64::from(height) / 2.0) as u32 * 2
    }

    /// The strip of `take`; none if no key is due or sounds.
    pub fn new(take: &Take, width: u32, height: u32) -> Option<Self> {
        let (mut low, mut high) = take.compass()?;
        // A row free above and below, and an octave at least.
        (low, high) = (low - 1, high + 1);
        while high - low + 1 < LEAST_ROWS {
            high += 1;
            low -= u8::from(high - low + 1 < LEAST_ROWS);
        }
        let bar = |note: PlayedNote, shown| Bar { pitch: note.pitch, secs: [note.start, note.end], shown };
        let due = take.due_notes.iter().map(|note| bar(*note, None));
        let played = take.stretches().into_iter().map(|stretch| bar(stretch.note, Some(stretch.shown)));
        let (width, height) = (width as usize, height as usize);
        let mut strip = Self {
            width,
            height,
            low,
            high,
            bars: due.chain(played).collect(),
            bar_lines: take.bar_secs.clone(),
            paper: PAPER.repeat(width * height),
            pixels: Vec::new(),
        };
        for pitch in (low..=high).filter(|pitch| key_is_black(usize::from(*pitch))) {
            let rows = strip.rows(pitch, 0.0);
            let canvas = &mut Canvas { pixels: &mut strip.paper, width, height };
            canvas.fill([0.0, width as f64], rows, SHADE);
        }
        Some(strip)
    }

    /// Upper and lower edge of a pitch's row, without the share `inset` of it on either side, pixels.
    fn rows(&self, pitch: u8, inset: f64) -> [f64; 2] {
        let row = self.height as f64 / f64::from(self.high - self.low + 1);
        let top = f64::from(self.high - pitch) * row;
        [top + inset * row, top + (1.0 - inset) * row]
    }

    /// The strip at a time: rows from top to bottom, three bytes a pixel. What is past shows how it was played.
    pub fn paint(&mut self, secs: f64) -> &[u8] {
        let (width, height) = (self.width as f64, self.height as f64);
        let x = move |at: f64| ((at - secs) / SPAN_SECS + PAST) * width;
        let mut pixels = std::mem::take(&mut self.pixels);
        pixels.clone_from(&self.paper);
        let canvas = &mut Canvas { pixels: &mut pixels, width: self.width, height: self.height };
        for at in &self.bar_lines {
            canvas.fill([x(*at), x(*at) + 1.0], [0.0, height], LINE);
        }
        for bar in &self.bars {
            let [from, to] = bar.secs;
            // They differ in shape and not only in colour.
            let inset = if bar.shown == Some(Shown::Wrong) { 0.28 } else { 0.08 };
            let colour = bar.shown.map_or(COMING, colour);
            // Only the past has been played.
            let to = if bar.shown.is_some() { to.min(secs) } else { to };
            if from < to && x(to) > 0.0 && x(from) < width {
                canvas.fill([x(from), x(to)], self.rows(bar.pitch, inset), colour);
                let within = ([x(from) + 1.5, x(to) - 1.5], self.rows(bar.pitch, 0.22));
                match bar.shown {
                    Some(Shown::Off) => canvas.fill(within.0, within.1, pale(colour)),
                    Some(Shown::Missed) => canvas.hatch(within.0, within.1, colour),
                    _ => {}
                }
            }
        }
        canvas.fill([x(secs) - 1.0, x(secs) + 1.0], [0.0, height], INK);
        canvas.fill([0.0, width], [0.0, 1.0], LINE);
        self.pixels = pixels;
        &self.pixels
    }
}

/// The colour at [`FILL_OF_OFF`] on the paper.
fn pale(colour: [u8; 3]) -> [u8; 3] {
    let mixed = |channel: usize| {
        let [from, to] = [PAPER[channel], colour[channel]].map(f64::from);
        (from + FILL_OF_OFF * (to - from)).round() as u8
    };
    std::array::from_fn(mixed)
}

struct Canvas<'a> {
    pixels: &'a mut [u8],
    width: usize,
    height: usize,
}

impl Canvas<'_> {
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

    /// Fills a rectangle. Edges within a pixel are mixed with what is there, so that the roll runs smoothly.
    fn fill(&mut self, xs: [f64; 2], ys: [f64; 2], colour: [u8; 3]) {
        let clipped = |[from, to]: [f64; 2], most: usize| {
            let most = most as f64;
            [from.clamp(0.0, most), to.clamp(0.0, most)]
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

    /// Two seconds: C4 is due in the first and played, E4 in the second and missed; G4 sounds in the second and is not due.
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
        let mut strip = Strip::new(&take(), 600, 130).unwrap();
        // 100 pixels a second, now at 180.
        let at = |strip: &mut Strip, secs: f64, x: usize, pitch: u8| -> [u8; 3] {
            let y = strip.rows(pitch, 0.5)[0] as usize;
            let pixels = strip.paint(secs);
            pixels[3 * (y * 600 + x)..][..3].try_into().unwrap()
        };
        // Before it begins, both notes are to come.
        assert_eq!(at(&mut strip, -0.5, 180 + 100, 60), COMING);
        assert_eq!(at(&mut strip, -0.5, 180 + 200, 64), COMING);
        assert_ne!(at(&mut strip, -0.5, 180 + 200, 67), WRONG);
        // In the middle of the first, its beginning was right, its end is to come.
        assert_eq!(at(&mut strip, 0.5, 180 - 25, 60), RIGHT);
        assert_eq!(at(&mut strip, 0.5, 180 + 25, 60), COMING);
        assert_eq!(at(&mut strip, 0.5, 180, 60), INK);
        // At the end the second was missed: an outline, hatched; and another key sounded.
        let edge = strip.rows(64, 0.15)[0] as usize;
        assert_eq!(at(&mut strip, 2.0, 180 - 50, 67), WRONG);
        let pixels = strip.paint(2.0);
        assert_eq!(pixels[3 * (edge * 600 + 130)..][..3], MISSED);
        let middle = strip.rows(64, 0.5)[0] as usize;
        let row: Vec<[u8; 3]> =
            (100..160).map(|x| strip.pixels[3 * (middle * 600 + x)..][..3].try_into().unwrap()).collect();
        assert!(row.contains(&PAPER) && row.contains(&MISSED));
    }
}
