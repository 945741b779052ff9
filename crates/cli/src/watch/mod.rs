//! The full-screen view of running trainings.

mod chart;
mod draw;
mod rows;
mod screen;
#[cfg(test)]
mod tests;
pub mod text;

use std::path::PathBuf;
use std::time::SystemTime;

use etude_show::watch::{RunFigures, WatchedRun, find_runs};
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use ratatui::style::{Color, Style};
use ratatui::widgets::{Block, Borders};

pub use screen::show;

/// Colours that colour-blind people can distinguish, on dark and on light ground, from the 256 of terminals.
const COLOURS: [u8; 8] = [75, 208, 36, 176, 178, 33, 167, 245];
/// The most runs that are shown of a folder that holds several: as many as there are colours.
const MOST: usize = COLOURS.len();

/// The line that parts of the screen begin with.
fn heading() -> Block<'static> {
    Block::new().borders(Borders::TOP).border_style(Style::new().dim())
}

/// What is shown.
pub struct View {
    /// As the user named them.
    folders: Vec<PathBuf>,
    runs: Vec<WatchedRun>,
    /// Of each run, as it was last read.
    figures: Vec<RunFigures>,
    selected: usize,
    /// Time on the x axis, not steps.
    by_time: bool,
    help: bool,
    colours: bool,
}

impl View {
    /// A view of the runs in `folders`, nothing of them read yet.
    ///
    /// # Errors
    /// As [`find_runs`].
    pub fn new(folders: Vec<PathBuf>, colours: bool) -> anyhow::Result<Self> {
        let runs: Vec<_> = find_runs(&folders, MOST, SystemTime::now())?
            .iter()
            .map(|folder| WatchedRun::open(folder))
            .collect();
        let mut view =
            Self { folders, runs, figures: Vec::new(), selected: 0, by_time: false, help: false, colours };
        view.update();
        Ok(view)
    }

    /// Reads some of what the runs have logged since; `true` if there is more. One that cannot be read holds up no other.
    fn read(&mut self) -> anyhow::Result<bool> {
        let read: Vec<_> = self.runs.iter_mut().map(WatchedRun::read).collect();
        self.update();
        read.into_iter().try_fold(false, |more, run| Ok(more | run?))
    }

    fn update(&mut self) {
        let now = SystemTime::now();
        self.figures = self.runs.iter().map(|run| run.figures(now)).collect();
    }

    /// Adds runs that have begun since, in the places of those that are no longer found, so that the others keep place and colour.
    fn search(&mut self) {
        // After an error the runs that are shown already stay.
        let Ok(mut found) = find_runs(&self.folders, MOST, SystemTime::now()) else { return };
        let shown: Vec<_> = self.runs.iter().map(|run| run.folder().to_path_buf()).collect();
        let gone: Vec<_> = (0..shown.len()).filter(|&at| !found.contains(&shown[at])).collect();
        found.retain(|folder| !shown.contains(folder));
        let mut begun = found.iter().map(|folder| WatchedRun::open(folder));
        let mut dropped = Vec::new();
        for at in gone {
            match begun.next() {
                Some(run) => self.runs[at] = run,
                None => dropped.push(at),
            }
        }
        self.runs.extend(begun);
        for at in dropped.into_iter().rev() {
            self.runs.remove(at);
        }
        self.selected = self.selected.min(self.runs.len().saturating_sub(1));
        self.update();
    }

    /// Does what a key asks for; `false` if that is to leave.
    fn key(&mut self, key: KeyEvent) -> bool {
        if key.kind == KeyEventKind::Release {
            return true;
        }
        let count = self.runs.len().max(1);
        match key.code {
            KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => return false,
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
    fn mark(run: usize) -> char {
        (b'a'..=b'z').map(char::from).cycle().nth(run).unwrap_or('a')
    }

    fn colour(&self, run: usize) -> Color {
        if self.colours { Color::Indexed(COLOURS[run % COLOURS.len()]) } else { Color::Reset }
    }

    fn style(&self, run: usize) -> Style {
        Style::new().fg(self.colour(run))
    }
}
