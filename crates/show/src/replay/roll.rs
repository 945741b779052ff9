//! The piano roll of a take: the strokes, and the notes that were missed, as stretches of time, and as a drawing.

use maud::{Markup, html};

use super::take::{PlayedNote, Take};
use crate::strip::{FILL_OF_OFF, colour};

/// Width of a second and height of a key, in the drawing's units.
const SECOND: f64 = 80.0;
const KEY: usize = 8;

/// What is shown of a stroke or of a due note, judged as on the replay page (`viewer/src/classify.js`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shown {
    /// A stroke that plays a due note in its time.
    Right,
    /// A stroke that plays a due note too early or too late.
    Off,
    /// A due note that no stroke plays.
    Missed,
    /// A stroke that plays no due note.
    Wrong,
    /// A stroke of a recording that does not say which notes were due.
    Played,
}

/// A stroke, as long as its key is held, or a missed note, as long as it is due.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stretch {
    pub note: PlayedNote,
    pub shown: Shown,
}

impl Take {
    /// The strokes, and after them the notes that were missed.
    pub(crate) fn stretches(&self) -> Vec<Stretch> {
        let is_judged = !self.due_notes.is_empty() || self.due.iter().all(Vec::is_empty);
        let unheard = if is_judged { Shown::Wrong } else { Shown::Played };
        let mut found: Vec<Stretch> =
            self.notes.iter().map(|note| Stretch { note: *note, shown: unheard }).collect();
        for (due, heard) in self.due_notes.iter().zip(&self.heard) {
            match heard {
                Some(heard) => found[heard.note].shown = if heard.right { Shown::Right } else { Shown::Off },
                None => found.push(Stretch { note: *due, shown: Shown::Missed }),
            }
        }
        found
    }

    /// The lowest and the highest pitch that is due or played.
    pub(crate) fn compass(&self) -> Option<(u8, u8)> {
        let all = || self.due_notes.iter().chain(&self.notes).map(|note| note.pitch);
        Some((all().min()?, all().max()?))
    }
}

/// A colour as SVG has it.
fn hex([red, green, blue]: [u8; 3]) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

/// As on the replay page: right is filled, too early or late a pale fill in an outline, missed hatched, wrong a narrow bar, so that they differ without
/// colours too.
pub(crate) fn roll_svg(take: &Take) -> String {
    let (low, high) = take.compass().unwrap_or((60, 60));
    let ends = take.due_notes.iter().chain(&take.notes).map(|note| note.end);
    let width = SECOND * ends.fold(take.secs().max(1.0), f64::max);
    let height = KEY * (usize::from(high - low) + 3);
    let bar = |Stretch { note, shown }: Stretch| {
        let colour = hex(colour(shown));
        let [fill, stroke, line] = match shown {
            Shown::Right | Shown::Played | Shown::Wrong => [&colour, "none", "1"],
            Shown::Off => [&colour, &colour, "2"],
            Shown::Missed => ["url(#missed)", &colour, "1.5"],
        };
        let opacity = if shown == Shown::Off { FILL_OF_OFF } else { 1.0 };
        let inset = if shown == Shown::Wrong { 2 } else { 0 };
        let [x, length] = [note.start, note.end - note.start].map(|secs| format!("{:.1}", SECOND * secs));
        let y = KEY * (usize::from(high - note.pitch) + 1) + inset;
        html! {
            rect x=(x) y=(y) width=(length) height=(KEY - 1 - 2 * inset) fill=(fill) fill-opacity=(opacity) stroke=(stroke) stroke-width=(line) vector-effect="non-scaling-stroke" {}
        }
    };
    let bars: Vec<Markup> = take.stretches().into_iter().map(bar).collect();
    let svg = html! {
        svg xmlns="http://www.w3.org/2000/svg" width=(width) height=(height) viewBox={ "0 0 " (width) " " (height) } preserveAspectRatio="none" {
            defs {
                pattern id="missed" width="3" height="3" patternUnits="userSpaceOnUse" patternTransform="rotate(45)" {
                    rect width="1.4" height="3" fill=(hex(colour(Shown::Missed))) {}
                }
            }
            style { "#paper{fill:#fff}@media(prefers-color-scheme:dark){#paper{fill:#1b1d21}}" }
            rect id="paper" width=(width) height=(height) {}
            @for bar in &bars { (bar) }
        }
    };
    svg.into_string()
}
