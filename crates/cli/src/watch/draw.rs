//! The layout of the screen.

use ratatui::Frame;
use ratatui::layout::{Alignment, Constraint, Layout, Rect};
use ratatui::style::{Modifier, Style, Stylize as _};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Cell, Clear, Padding, Paragraph, Row, Table, TableState, Wrap};

use super::view::View;
use super::{rows, text};

/// The smallest terminal with room for all parts, columns and rows.
const MIN_SIZE: (u16, u16) = (72, 16);
/// Rows of the chart, its heading and axis among them: at least, and before the rows below it grow.
const CHART: u16 = 8;
const COMFORTABLE_CHART: u16 = 16;
/// Smallest number of rows of the list of runs, which scrolls.
const MIN_RUNS: u16 = 3;
/// From this width on song and speed have a column.
const WIDE: u16 = 110;

const HELP: &[(&str, &str)] = &[
    ("q, Esc, Ctrl-C", "quit; the trainings continue"),
    ("↑ ↓, Tab", "choose a run"),
    ("s", "steps or training time on the x axis"),
    ("?", "this help"),
    ("", ""),
    ("a, b, …", "mark the same run in the list and on its curve"),
    ("notes 13/14 +2", "last evaluation: right, due, wrong"),
    ("F1 best", "best evaluation; the chart has all"),
    ("steps/s, left", "from the last ten log lines"),
    ("silent 12 min", "time since the last log line: stopped, or slow"),
    ("lowest … highest", "the range of the small curve"),
];

impl View {
    /// Draws everything.
    pub(super) fn draw(&self, frame: &mut Frame) {
        let area = frame.area();
        if area.width < MIN_SIZE.0 || area.height < MIN_SIZE.1 {
            let text = format!(
                "The view needs {} × {} characters, this terminal has {} × {}. Make it larger, or quit with q and \
                 use `etude watch --once`.",
                MIN_SIZE.0, MIN_SIZE.1, area.width, area.height
            );
            frame.render_widget(Paragraph::new(text).wrap(Wrap { trim: true }), area);
            return;
        }
        let [list, chart, small, foot] = self.areas(area);
        self.draw_list(frame, list);
        self.draw_chart(frame, chart);
        self.draw_rows(frame, small);
        let keys = " q quit   ↑↓ choose a run   s steps/time   ? help";
        frame.render_widget(Paragraph::new(keys).dim(), foot);
        if self.help {
            draw_help(frame, area);
        }
    }

    fn areas(&self, area: Rect) -> [Rect; 4] {
        let curves = rows::count(self.runs.get(self.selected));
        let room = area.height - 1 - CHART;
        let runs = self.runs.len() as u16;
        let list = 1 + runs.min(room.saturating_sub(2 + curves).max(MIN_RUNS));
        let room = room - list;
        // They grow when the chart has enough.
        let spare = (room + CHART).saturating_sub(COMFORTABLE_CHART + 1);
        let each = (spare / curves.max(1)).clamp(1, 3);
        let small = (1 + each * curves).min(room);
        let heights =
            [Constraint::Length(list), Constraint::Fill(1), Constraint::Length(small), Constraint::Length(1)];
        Layout::vertical(heights).areas(area)
    }

    fn draw_list(&self, frame: &mut Frame, area: Rect) {
        let wide = area.width >= WIDE;
        // The other columns take 64 characters; those of song and speed 39 more, if there is room.
        let name_width = area.width.saturating_sub(if wide { 103 } else { 64 });
        let mut widths = vec![Constraint::Length(2), Constraint::Length(name_width)];
        let mut head = vec![Line::default(), Line::from("run")];
        if wide {
            widths.extend([30, 7].map(Constraint::Length));
            head.extend([Line::from("song"), right("steps/s")]);
        }
        widths.extend([11, 11, 12, 7, 13].map(Constraint::Length));
        head.extend(["step", "left", "notes", "F1 best"].map(right));
        head.push(Line::from("state"));
        let rows = self.figures.iter().enumerate().map(|(at, run)| {
            let mut cells = vec![
                Line::styled(format!(" {}", Self::mark(at)), self.style(at).bold()),
                Line::from(text::shortened(&run.name, usize::from(name_width))),
            ];
            if wide {
                cells.push(Line::from(text::shortened(run.song.as_deref().unwrap_or("-"), 30)));
                cells.push(right(text::rate(run)));
            }
            let figures = [text::steps(run), text::left(run), text::notes(run), text::score(run.best_f1)];
            cells.extend(figures.map(right));
            cells.push(Line::from(text::state(run)));
            Row::new(cells.into_iter().map(Cell::from))
        });
        let table = Table::new(rows, widths)
            .header(Row::new(head.into_iter().map(Cell::from)).dim())
            .column_spacing(1)
            .row_highlight_style(Style::new().add_modifier(Modifier::REVERSED));
        let mut state = TableState::new().with_selected(Some(self.selected));
        frame.render_stateful_widget(table, area, &mut state);
    }

    /// Heading of what is shown of the chosen run alone.
    pub(super) fn chosen(&self) -> Option<Line<'_>> {
        let run = self.figures.get(self.selected)?;
        let mark = Span::styled(Self::mark(self.selected).to_string(), self.style(self.selected).bold());
        let song = run.song.as_deref().unwrap_or(&run.name);
        let state = text::long_state(run);
        Some(Line::from(vec![" ".into(), mark, format!(" {song} · {state} ").into()]).not_dim())
    }
}

fn right(text: impl Into<String>) -> Line<'static> {
    Line::from(text.into()).alignment(Alignment::Right)
}

fn draw_help(frame: &mut Frame, area: Rect) {
    let lines: Vec<Line> = HELP
        .iter()
        .map(|(key, meaning)| Line::from(vec![format!("{key:18}").bold(), (*meaning).into()]))
        .collect();
    let width = lines.iter().map(Line::width).max().unwrap_or(0) as u16 + 4;
    let block = Block::bordered().title(" etude watch ").padding(Padding::horizontal(1));
    let height = Constraint::Length(lines.len() as u16 + 2);
    let box_area = area.centered(Constraint::Length(width.min(area.width)), height);
    frame.render_widget(Clear, box_area);
    frame.render_widget(Paragraph::new(lines).block(block), box_area);
}
