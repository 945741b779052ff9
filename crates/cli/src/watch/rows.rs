//! The chosen run's reward, its terms and its speed: a small curve each, with the value now and the
//! scale.

use etude_show::watch::{Point, WatchedRun};
use ratatui::Frame;
use ratatui::layout::Constraint::{Fill, Length};
use ratatui::layout::{Alignment, Layout, Rect};
use ratatui::style::Stylize as _;
use ratatui::text::Line;
use ratatui::widgets::{Paragraph, Sparkline};

use super::view::{View, heading};

/// Rows while a run has logged nothing, so that the screen does not jump at its first line.
const EXPECTED: u16 = 7;
/// Heights that a character of a small curve can have.
const LEVELS: u64 = 8;

/// How many small curves there are.
pub(super) fn count(run: Option<&WatchedRun>) -> u16 {
    run.filter(|run| !run.history().is_empty()).map_or(EXPECTED, |run| curves(run).len() as u16)
}

fn curves(run: &WatchedRun) -> Vec<(&str, &[Point])> {
    let history = run.history();
    let terms = history.terms.iter().map(|(name, points)| (name.as_str(), points.as_slice()));
    let mut curves = vec![("reward per step", history.reward.as_slice())];
    curves.extend(terms);
    curves.push(("steps/s", history.speed.as_slice()));
    curves
}

impl View {
    pub(super) fn draw_rows(&self, frame: &mut Frame, area: Rect) {
        let scale = Line::from(" now      lowest … highest ").alignment(Alignment::Right);
        let block = heading().title(self.chosen().unwrap_or_default()).title(scale.dim());
        let inner = block.inner(area);
        frame.render_widget(block, area);
        let Some(run) = self.runs.get(self.selected).filter(|run| !run.history().is_empty()) else { return };
        let curves = curves(run);
        let height = (inner.height / curves.len().max(1) as u16).max(1);
        for ((name, points), top) in curves.into_iter().zip((inner.y..).step_by(usize::from(height))) {
            let row = Rect { y: top, height, ..inner }.intersection(inner);
            if row.is_empty() {
                break;
            }
            let widths = [Length(20), Fill(1), Length(10), Length(19)];
            let [label, field, now, scale] = Layout::horizontal(widths).areas(row);
            frame.render_widget(Paragraph::new(format!(" {}", name.replace('_', " "))), label);
            let Some(last) = points.last() else { continue };
            let lowest = points.iter().map(|point| point.value).fold(f64::INFINITY, f64::min);
            let highest = points.iter().map(|point| point.value).fold(f64::NEG_INFINITY, f64::max);
            let max = LEVELS * u64::from(field.height);
            let bars = bars(points, usize::from(field.width), [lowest, highest], max);
            frame.render_widget(
                Sparkline::default().data(bars).max(max).style(self.style(self.selected)),
                field,
            );
            frame.render_widget(Line::from(value(last.value)).alignment(Alignment::Right).bold(), now);
            let range = format!("{} … {:>7}", value(lowest), value(highest));
            frame.render_widget(Line::from(range).alignment(Alignment::Right).dim(), scale);
        }
    }
}

/// `width` bars from 1 to `max`: means over equal parts of `points`, or the same point several
/// times while there are few.
fn bars(points: &[Point], width: usize, [lowest, highest]: [f64; 2], max: u64) -> Vec<u64> {
    let bar = |at: usize| {
        let first = at * points.len() / width;
        let part = &points[first..((at + 1) * points.len() / width).max(first + 1)];
        let mean = part.iter().map(|point| point.value).sum::<f64>() / part.len() as f64;
        let share = if highest > lowest { (mean - lowest) / (highest - lowest) } else { 0.5 };
        1 + (share * (max - 1) as f64).round() as u64
    };
    (0..if points.is_empty() { 0 } else { width }).map(bar).collect()
}

fn value(value: f64) -> String {
    match value.abs() {
        size if size >= 100.0 => format!("{value:.0}"),
        size if size >= 0.01 || size == 0.0 => format!("{value:.3}"),
        _ => format!("{value:.4}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_reach_from_the_lowest_to_the_highest() {
        let points: Vec<_> = [0.0, 2.0, 4.0, 8.0].map(|value| Point { step: 0.0, secs: 0.0, value }).to_vec();
        assert_eq!(bars(&points, 4, [0.0, 8.0], 8), [1, 3, 5, 8]);
        assert_eq!(bars(&points, 6, [0.0, 8.0], 8), [1, 1, 3, 5, 5, 8]);
        assert_eq!(bars(&points, 2, [0.0, 8.0], 9), [2, 7]);
        assert_eq!(bars(&points[..1], 2, [0.0, 0.0], 9), [5, 5]);
        assert!(bars(&[], 9, [0.0, 1.0], 8).is_empty() && bars(&points, 0, [0.0, 8.0], 8).is_empty());
    }
}
