//! The terminal: when it is read, when it is drawn, and how it is restored.

use std::fs::File;
use std::io::Write as _;
use std::os::fd::AsFd as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyModifiers};

use super::view::View;
use crate::output::{STOPPED, VerbEnd};
use crate::progress::patient_stop_flag;

/// Shortest time between two redraws, so that they do not queue up on a slow line.
const REDRAW_INTERVAL: Duration = Duration::from_millis(250);
/// Time between two reads of the runs' files.
const POLL_INTERVAL: Duration = Duration::from_secs(1);
/// Time between two searches for new runs.
const SEARCH_INTERVAL: Duration = Duration::from_secs(10);

/// Time in which the screen ends by itself after a request to stop.
const STOP_TIMEOUT: Duration = Duration::from_secs(1);

/// Shows `view` until the user quits it, or Ctrl-C, SIGTERM or the end of the terminal stops it.
pub fn show(view: &mut View) -> anyhow::Result<VerbEnd> {
    // Read once before the screen changes, so that errors stay visible in the terminal.
    view.read()?;
    let stop = patient_stop_flag()?;
    signal_hook::flag::register(signal_hook::consts::SIGHUP, stop.clone())?;
    end_with_the_terminal(&stop)?;
    // Also restores the terminal after a panic.
    let shown = ratatui::try_init().and_then(|mut terminal| watch(&mut terminal, view, &stop));
    // One that is gone cannot be restored.
    let _ = ratatui::try_restore();
    match shown {
        // The terminal is gone: nothing can be drawn and no message can be read.
        shown if stop.load(Ordering::Relaxed) || shown.is_err() && is_gone(&mut stdout()?) => {
            Ok(VerbEnd::Stopped)
        }
        shown => {
            shown.context("cannot use this terminal; `etude watch --once` needs none")?;
            Ok(VerbEnd::Done)
        }
    }
}

/// Requests a stop when the terminal is gone, and ends the process if a stop takes too long: the
/// wait for a key never returns from a terminal that is gone, in crossterm 0.29.
fn end_with_the_terminal(stop: &Arc<AtomicBool>) -> std::io::Result<()> {
    let mut terminal = stdout()?;
    let stop = stop.clone();
    std::thread::spawn(move || {
        while !stop.load(Ordering::Relaxed) && !is_gone(&mut terminal) {
            std::thread::sleep(REDRAW_INTERVAL);
        }
        stop.store(true, Ordering::Relaxed);
        std::thread::sleep(STOP_TIMEOUT);
        let _ = ratatui::try_restore();
        std::process::exit(STOPPED.into());
    });
    Ok(())
}

fn stdout() -> std::io::Result<File> {
    Ok(File::from(std::io::stdout().as_fd().try_clone_to_owned()?))
}

/// Whether this terminal is gone: to write nothing fails only then.
fn is_gone(terminal: &mut File) -> bool {
    terminal.write(&[]).is_err()
}

fn is_ctrl_c(key: &KeyEvent) -> bool {
    key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL)
}

fn watch(terminal: &mut DefaultTerminal, view: &mut View, stop: &AtomicBool) -> std::io::Result<()> {
    let started = Instant::now();
    let (mut read_at, mut search_at, mut draw_at) = (started, started + SEARCH_INTERVAL, started);
    let mut changed = true;
    while !stop.load(Ordering::Relaxed) {
        let now = Instant::now();
        if now >= search_at {
            view.search();
            search_at = now + SEARCH_INTERVAL;
        }
        if now >= read_at {
            // A file that cannot be read now is tried again: reads on network file systems
            // sometimes fail.
            let _ = view.read();
            (changed, read_at) = (true, now + POLL_INTERVAL);
        }
        if changed && now >= draw_at {
            terminal.draw(|frame| view.draw(frame))?;
            (changed, draw_at) = (false, Instant::now() + REDRAW_INTERVAL);
        }
        let next = if changed { read_at.min(draw_at) } else { read_at };
        // Not longer than a redraw, as signals do not end the wait.
        if event::poll(next.saturating_duration_since(Instant::now()).min(REDRAW_INTERVAL))? {
            match event::read()? {
                // The terminal sends no signal while it is read key by key.
                Event::Key(key) if is_ctrl_c(&key) => stop.store(true, Ordering::Relaxed),
                Event::Key(key) if !view.key(key) => return Ok(()),
                _ => changed = true,
            }
        }
    }
    Ok(())
}
