//! The piano roll of a take as SVG.

use maud::{Markup, html};

use super::judged::{FILL_OF_OUT_OF_TIME, JudgedNote, NoteJudgement};
use super::take::Take;

/// Width of a second and height of a key, user units.
const SECOND: f64 = 80.0;
const KEY: usize = 8;

/// A colour in SVG.
fn hex([red, green, blue]: [u8; 3]) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

/// As on the replay page, a right note is filled, one out of time pale with an outline, a missed
/// one hatched, and a wrong stroke a narrow bar: they differ without colours too.
pub(crate) fn roll_svg(take: &Take) -> String {
    let (low, high) = take.pitch_range().unwrap_or((60, 60));
    let ends = take.due_notes.iter().chain(&take.notes).map(|note| note.end);
    let width = SECOND * ends.fold(take.secs().max(1.0), f64::max);
    let height = KEY * (usize::from(high - low) + 3);
    let bar = |JudgedNote { note, judgement }: JudgedNote| {
        let colour = hex(judgement.colour());
        let [fill, stroke, line] = match judgement {
            NoteJudgement::Right | NoteJudgement::Unjudged | NoteJudgement::Wrong => [&colour, "none", "1"],
            NoteJudgement::OutOfTime => [&colour, &colour, "2"],
            NoteJudgement::Missed => ["url(#missed)", &colour, "1.5"],
        };
        let opacity = if judgement == NoteJudgement::OutOfTime { FILL_OF_OUT_OF_TIME } else { 1.0 };
        let inset = if judgement == NoteJudgement::Wrong { 2 } else { 0 };
        let [x, length] = [note.start, note.end - note.start].map(|secs| format!("{:.1}", SECOND * secs));
        let y = KEY * (usize::from(high - note.pitch) + 1) + inset;
        html! {
            rect x=(x) y=(y) width=(length) height=(KEY - 1 - 2 * inset) fill=(fill) fill-opacity=(opacity) stroke=(stroke) stroke-width=(line) vector-effect="non-scaling-stroke" {}
        }
    };
    let bars: Vec<Markup> = take.judged_notes().into_iter().map(bar).collect();
    let svg = html! {
        svg xmlns="http://www.w3.org/2000/svg" width=(width) height=(height) viewBox={ "0 0 " (width) " " (height) } preserveAspectRatio="none" {
            defs {
                pattern id="missed" width="3" height="3" patternUnits="userSpaceOnUse" patternTransform="rotate(45)" {
                    rect width="1.4" height="3" fill=(hex(NoteJudgement::Missed.colour())) {}
                }
            }
            style { "#paper{fill:#fff}@media(prefers-color-scheme:dark){#paper{fill:#1b1d21}}" }
            rect id="paper" width=(width) height=(height) {}
            @for bar in &bars { (bar) }
        }
    };
    svg.into_string()
}
