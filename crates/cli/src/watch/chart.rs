//! F1 of all runs over steps or time.

use etude_show::watch::Point;
use ratatui::Frame;
use ratatui::layout::{Margin, Rect};
use ratatui::style::Stylize as _;
use ratatui::symbols::Marker;
use ratatui::text::Line;
use ratatui::widgets::{Axis, Chart, Dataset, GraphType, Paragraph};

use super::text;
use super::view::{View, heading};
use crate::status::clock;

/// Columns of the labels left of the axis.
const LABELS: u16 = 5;
/// Columns between two letters on a curve.
const BETWEEN_MARKS: u16 = 16;

impl View {
    pub(super) fn draw_chart(&self, frame: &mut Frame, area: Rect) {
        let what = if self.by_time { " F1 over training time " } else { " F1 over steps " };
        let block = heading().title(what.not_dim().bold());
        let inner = block.inner(area);
        frame.render_widget(block, area);
        let values = || self.runs.iter().flat_map(|run| &run.history().f1);
        if values().next().is_none() {
            frame.render_widget(
                Paragraph::new(self.nothing_yet()).centered().dim(),
                inner.inner(Margin::new(1, 2)),
            );
            return;
        }
        // Whole tenths, so that the axis moves seldom.
        let lowest = values().map(|point| point.value).fold(1.0, f64::min);
        let highest = values().map(|point| point.value).fold(0.0, f64::max);
        let low = (lowest * 10.0).floor() / 10.0;
        let high = ((highest * 10.0).ceil() / 10.0).max(low + 0.1);
        let reached = self
            .runs
            .iter()
            .map(|run| if self.by_time { run.history().secs() } else { run.history().step() });
        let end = reached.fold(1.0, f64::max);

        // The chosen run comes last, so that no other curve hides it.
        let others = (0..self.runs.len()).filter(|&run| run != self.selected);
        let order: Vec<usize> = others.chain([self.selected]).collect();
        let coords = |&run: &usize| {
            let points = &self.runs[run].history().f1;
            points.iter().map(|point| (self.at(point), point.value)).collect::<Vec<_>>()
        };
        let coords: Vec<_> = order.iter().map(coords).collect();
        let curves = order.iter().zip(&coords).map(|(&run, coords)| {
            Dataset::default()
                .data(coords)
                .marker(Marker::Braille)
                .graph_type(GraphType::Line)
                .style(self.style(run))
        });
        let dim = |label: String| Line::from(label).dim();
        let label = |at: f64| dim(if self.by_time { clock(at) } else { text::count(at) });
        let steps = Axis::default().bounds([0.0, end]).labels([0.0, end / 2.0, end].map(label)).dim();
        let scores = [low, (low + high) / 2.0, high].map(|f1| dim(format!("{f1:.2} ")));
        let scores = Axis::default().bounds([low, high]).labels(scores).dim();
        frame.render_widget(
            Chart::new(curves.collect()).x_axis(steps).y_axis(scores).legend_position(None),
            inner,
        );
        // The chart's inner part: without labels and axes.
        let field = Rect {
            x: inner.x + LABELS + 1,
            width: inner.width.saturating_sub(LABELS + 1),
            height: inner.height.saturating_sub(2),
            ..inner
        };
        order.iter().for_each(|&run| self.draw_marks(frame, field, run, [0.0, end], [low, high]));
    }

    fn at(&self, point: &Point) -> f64 {
        if self.by_time { point.secs } else { point.step }
    }

    /// Letters distinguish the curves where colours do not. Where two curves overlap, the letters
    /// of different runs stand beside each other.
    fn draw_marks(&self, frame: &mut Frame, field: Rect, run: usize, x_bounds: [f64; 2], y_bounds: [f64; 2]) {
        // The cell in which the canvas has its dot.
        let cell =
            |share: f64, cells: u16, dots: u16| (share * f64::from(cells * dots - 1)).round() as u16 / dots;
        let share = |value: f64, [low, high]: [f64; 2]| ((value - low) / (high - low)).clamp(0.0, 1.0);
        let mut last = (field.width + BETWEEN_MARKS).saturating_sub(2 * run as u16 % BETWEEN_MARKS + 1);
        for point in self.runs[run].history().f1.iter().rev() {
            let column = cell(share(self.at(point), x_bounds), field.width, 2);
            if column + BETWEEN_MARKS <= last {
                last = column;
                let row = cell(1.0 - share(point.value, y_bounds), field.height, 4);
                let mark = Line::styled(Self::mark(run).to_string(), self.style(run).bold());
                frame.render_widget(mark, Rect::new(field.x + column, field.y + row, 1, 1));
            }
        }
    }

    fn nothing_yet(&self) -> String {
        let run = self.runs.get(self.selected).filter(|run| !run.history().is_empty());
        match run.map(|run| run.evaluate_every_steps()) {
            None => "waiting for the first log line".to_string(),
            Some(None) => "no evaluation yet".to_string(),
            Some(Some(every)) => format!("no evaluation yet; the first comes at step {}", text::count(every)),
        }
    }
}
