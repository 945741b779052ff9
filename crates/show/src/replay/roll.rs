//! The piano roll of a take as a drawing: what was due and what was played.

use maud::{Markup, html};

use super::take::Take;

/// Width of a control step and height of a key, in the drawing's units.
const STEP: usize = 4;
const KEY: usize = 8;

/// Right is filled, missed an outline, wrong hatched, so that the three differ without colours too.
pub(crate) fn roll_svg(take: &Take) -> String {
    let steps = take.due.len().max(take.pressed.len()).max(1);
    let sounding = || take.due.iter().chain(&take.pressed).flatten().copied();
    let (low, high) = (sounding().min().unwrap_or(60), sounding().max().unwrap_or(60));
    let (width, height) = (STEP * steps, KEY * (usize::from(high - low) + 3));
    let mut bars: Vec<Markup> = Vec::new();
    let none = Vec::new();
    for pitch in low..=high {
        let y = KEY * (usize::from(high - pitch) + 1);
        let mut from = 0;
        let state = |step: usize| {
            let has = |rows: &[Vec<u8>]| rows.get(step).unwrap_or(&none).contains(&pitch);
            (has(&take.due), has(&take.pressed))
        };
        while from < steps {
            let now = state(from);
            let to = (from..steps).find(|step| state(*step) != now).unwrap_or(steps);
            let style = match now {
                (true, true) => Some(["#0072b2", "none", "1"]),
                (true, false) => Some(["none", "#0072b2", "1"]),
                (false, true) => Some(["url(#wrong)", "#d55e00", "0.5"]),
                (false, false) => None,
            };
            if let Some([fill, stroke, width]) = style {
                let (x, length) = (STEP * from, STEP * (to - from));
                bars.push(html! {
                    rect x=(x) y=(y) width=(length) height=(KEY - 1) fill=(fill) stroke=(stroke) stroke-width=(width) vector-effect="non-scaling-stroke" {}
                });
            }
            from = to;
        }
    }
    let svg = html! {
        svg xmlns="http://www.w3.org/2000/svg" width=(width) height=(height) viewBox={ "0 0 " (width) " " (height) } preserveAspectRatio="none" {
            defs {
                pattern id="wrong" width="3" height="3" patternUnits="userSpaceOnUse" patternTransform="rotate(45)" {
                    rect width="1.4" height="3" fill="#d55e00" {}
                }
            }
            rect width=(width) height=(height) fill="#fff" {}
            @for bar in &bars { (bar) }
        }
    };
    svg.into_string()
}
