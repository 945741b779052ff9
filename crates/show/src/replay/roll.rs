//! The piano roll of a take: what was due and what was played, as stretches of time, and as a drawing.

use maud::{Markup, html};

use super::take::Take;

/// Width of a control step and height of a key, in the drawing's units.
const STEP: usize = 4;
const KEY: usize = 8;

/// What is shown of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shown {
    /// Due and struck.
    Right,
    /// Due and silent, or held from a note before it and not struck.
    Missed,
    /// It sounds and is not due.
    Wrong,
}

/// A stretch of control steps in which one key shows the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Stretch {
    pub pitch: u8,
    /// The first step.
    pub from: usize,
    /// The step after the last one.
    pub to: usize,
    pub shown: Shown,
}

impl Take {
    /// Whether a note of `pitch` that is due in a control step is one that was not struck.
    pub(crate) fn is_unstruck(&self, pitch: u8, step: usize) -> bool {
        let middle = (step as f64 + 0.5) / self.control_hz;
        let latest = self.due_notes.iter().rposition(|note| note.pitch == pitch && note.start <= middle);
        latest.is_some_and(|index| self.heard[index].is_none())
    }

    /// The stretches, pitch by pitch.
    pub(crate) fn stretches(&self) -> Vec<Stretch> {
        let steps = self.due.len().max(self.pressed.len());
        let mut found: Vec<Stretch> = Vec::new();
        let Some((low, high)) = self.compass() else { return found };
        for pitch in low..=high {
            let mut open: Option<Stretch> = None;
            for step in 0..=steps {
                let shown = self.shown(pitch, step);
                if open.map(|stretch| stretch.shown) == shown {
                    continue;
                }
                found.extend(open.map(|stretch| Stretch { to: step, ..stretch }));
                open = shown.map(|shown| Stretch { pitch, from: step, to: step, shown });
            }
        }
        found
    }

    fn shown(&self, pitch: u8, step: usize) -> Option<Shown> {
        let has = |rows: &[Vec<u8>]| rows.get(step).is_some_and(|row| row.contains(&pitch));
        match (has(&self.due), has(&self.pressed)) {
            (true, true) if !self.is_unstruck(pitch, step) => Some(Shown::Right),
            (true, _) => Some(Shown::Missed),
            (false, true) => Some(Shown::Wrong),
            (false, false) => None,
        }
    }

    /// The lowest and the highest pitch that is due or played.
    pub(crate) fn compass(&self) -> Option<(u8, u8)> {
        let all = || self.due.iter().chain(&self.pressed).flatten().copied();
        Some((all().min()?, all().max()?))
    }
}

/// Right is filled, missed an outline, wrong hatched, so that the three differ without colours too.
pub(crate) fn roll_svg(take: &Take) -> String {
    let steps = take.due.len().max(take.pressed.len()).max(1);
    let (low, high) = take.compass().unwrap_or((60, 60));
    let (width, height) = (STEP * steps, KEY * (usize::from(high - low) + 3));
    let bar = |Stretch { pitch, from, to, shown }: Stretch| {
        let [fill, stroke, line] = match shown {
            Shown::Right => ["#0072b2", "none", "1"],
            Shown::Missed => ["none", "#0072b2", "1"],
            Shown::Wrong => ["url(#wrong)", "#d55e00", "0.5"],
        };
        let (x, y, length) = (STEP * from, KEY * (usize::from(high - pitch) + 1), STEP * (to - from));
        html! {
            rect x=(x) y=(y) width=(length) height=(KEY - 1) fill=(fill) stroke=(stroke) stroke-width=(line) vector-effect="non-scaling-stroke" {}
        }
    };
    let bars: Vec<Markup> = take.stretches().into_iter().map(bar).collect();
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
