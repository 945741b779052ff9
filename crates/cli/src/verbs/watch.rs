//! `etude watch`: running trainings, in the terminal.

use std::io::IsTerminal as _;
use std::path::PathBuf;
use std::time::SystemTime;

use etude_show::watch::{RunFigures, WatchedRun, find_runs};

use crate::output::{VerbEnd, line, print_json};
use crate::watch::{View, show, text};

/// Runs and output.
#[derive(clap::Args)]
#[command(after_help = "\
Reads only the runs' metrics.jsonl and descriptions: it works for trainings of other processes, over ssh \
and on shared file systems, and quitting it (q) ends no training. Of a folder with several runs it shows \
those of the last day (on the full screen the last eight). Set NO_COLOR=1 for a screen without colours.

Examples:
  etude watch                                         # the runs of the last day in runs/
  etude watch runs/twinkle__fast__0 runs/twinkle__fast__1
  ssh -t host 'cd etude && etude watch'
  etude watch --once --json")]
pub struct Args {
    /// Folders of runs or of an experiment's trials, or folders that hold such
    #[arg(default_value = "runs", value_name = "RUN")]
    folders: Vec<PathBuf>,
    /// Print one table and end (the default if standard output is not a terminal)
    #[arg(long)]
    once: bool,
    /// Print JSON and end; of each run: run, name, song, state (waiting, running, silent,
    /// finished), secs_since_written, step, total_steps, secs, steps_per_sec, secs_left,
    /// notes_right, notes_due, notes_wrong, best_f1, best_step, last_f1, reward_per_step, reward
    /// (its terms)
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<VerbEnd> {
    if args.once || args.json || !std::io::stdout().is_terminal() {
        let now = SystemTime::now();
        let figures = find_runs(&args.folders, usize::MAX, now)?
            .iter()
            .map(|folder| {
                let mut run = WatchedRun::open(folder);
                run.read()?;
                Ok(run.figures(now))
            })
            .collect::<anyhow::Result<Vec<_>>>()?;
        if args.json { print_json(&figures)? } else { print(&figures)? }
    } else {
        let colours = std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
        return show(&mut View::new(args.folders, colours)?);
    }
    Ok(VerbEnd::Done)
}

fn print(runs: &[RunFigures]) -> anyhow::Result<()> {
    let name_width = runs.iter().map(|run| run.name.chars().count()).fold(3, usize::max);
    let song = |run: &RunFigures| run.song.clone().unwrap_or_else(|| "-".to_string());
    let song_width = runs.iter().map(|run| song(run).chars().count()).fold(4, usize::max);
    let row = |name: &str, song: &str, figures: [&str; 6], state: &str| {
        let [step, rate, left, notes, best, last] = figures;
        let (name, song) = (format!("{name:name_width$}"), format!("{song:song_width$}"));
        line(format!(
            "{name}  {song}  {step:>12} {rate:>8} {left:>11} {notes:>10} {best:>8} {last:>8}  {state}"
        ))
    };
    row("run", "song", ["step", "steps/s", "left", "notes", "best F1", "last F1"], "state")?;
    for run in runs {
        let [best, last] = [run.best_f1, run.last_f1].map(text::score);
        let [steps, rate, left, notes] =
            [text::steps(run), text::rate(run), text::left(run), text::notes(run)];
        let figures = [&steps, &rate, &left, &notes, &best, &last];
        row(&run.name, &song(run), figures.map(String::as_str), &text::long_state(run))?;
    }
    Ok(())
}
