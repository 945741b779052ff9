//! What the full-screen view shows, and its keys.

use std::path::PathBuf;
use std::time::SystemTime;

use etude_show::watch::{RunFigures, WatchedRun, find_runs};
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyEventKind};
use ratatui::style::{Color, Style};
use ratatui::widgets::{Block, Borders};

/// Colours that colour-blind people can distinguish, on dark and on light ground, from the 256 of
/// terminals.
const COLOURS: [u8; 8] = [75, 208, 36, 176, 178, 33, 167, 245];
/// Runs that are shown of a folder with several: as many as there are colours.
const MAX_RUNS: usize = COLOURS.len();

/// The heading line of a part of the screen.
pub(super) fn heading() -> Block<'static> {
    Block::new().borders(Borders::TOP).border_style(Style::new().dim())
}

/// The state of the view.
pub struct View {
    /// As the user named them.
    pub(super) folders: Vec<PathBuf>,
    pub(super) runs: Vec<WatchedRun>,
    /// Of each run, as it was last read.
    pub(super) figures: Vec<RunFigures>,
    pub(super) selected: usize,
    /// Time on the x axis, not steps.
    pub(super) by_time: bool,
    pub(super) help: bool,
    pub(super) colours: bool,
}

impl View {
    /// A view of the runs in `folders`, nothing of them read yet.
    ///
    /// # Errors
    /// As [`find_runs`].
    pub fn new(folders: Vec<PathBuf>, colours: bool) -> anyhow::Result<Self> {
        let runs: Vec<_> = find_runs(&folders, MAX_RUNS, SystemTime::now())?
            .iter()
            .map(|folder| WatchedRun::open(folder))
            .collect();
        let mut view =
            Self { folders, runs, figures: Vec::new(), selected: 0, by_time: false, help: false, colours };
        view.update();
        Ok(view)
    }

    /// Reads the new log lines. A run that cannot be read does not stop the others.
    pub(super) fn read(&mut self) -> anyhow::Result<()> {
        let read: Vec<_> = self.runs.iter_mut().map(WatchedRun::read).collect();
        self.update();
        read.into_iter().collect()
    }

    fn update(&mut self) {
        let now = SystemTime::now();
        self.figures = self.runs.iter().map(|run| run.figures(now)).collect();
    }

    /// Adds new runs, and drops those that are no longer found.
    pub(super) fn search(&mut self) {
        // After an error the shown runs stay.
        let Ok(found) = find_runs(&self.folders, MAX_RUNS, SystemTime::now()) else { return };
        self.runs.retain(|run| found.iter().any(|folder| folder == run.folder()));
        for folder in &found {
            if self.runs.iter().all(|run| run.folder() != folder) {
                self.runs.push(WatchedRun::open(folder));
            }
        }
        self.selected = self.selected.min(self.runs.len().saturating_sub(1));
        self.update();
    }

    /// Handles a key; `false` if it quits.
    pub(super) fn key(&mut self, key: KeyEvent) -> bool {
        if key.kind == KeyEventKind::Release {
            return true;
        }
        let count = self.runs.len().max(1);
        match key.code {
            KeyCode::Char('q') => return false,
            KeyCode::Esc if !self.help => return false,
            KeyCode::Esc => self.help = false,
            KeyCode::Char('?') => self.help = !self.help,
            KeyCode::Char('s') => self.by_time = !self.by_time,
            KeyCode::Down | KeyCode::Tab => self.selected = (self.selected + 1) % count,
            KeyCode::Up | KeyCode::BackTab => self.selected = (self.selected + count - 1) % count,
            _ => {}
        }
        true
    }

    /// The letter that marks the curve of a run.
    pub(super) fn mark(run: usize) -> char {
        (b'a'..=b'z').map(char::from).cycle().nth(run).unwrap_or('a')
    }

    pub(super) fn style(&self, run: usize) -> Style {
        let colour = if self.colours { Color::Indexed(COLOURS[run % COLOURS.len()]) } else { Color::Reset };
        Style::new().fg(colour)
    }
}
