//! The `etude` command: one file a verb, nothing but parsing, calling and printing.
#![allow(clippy::print_stdout, clippy::print_stderr)] // Printing is what this crate is for.

mod args;
mod files;
mod mistakes;
mod output;
mod progress;
mod status;
mod verbs;
mod watch;

use std::process::ExitCode;
use std::sync::Arc;

use clap::error::ErrorKind;
use clap::{CommandFactory as _, Parser, Subcommand};

use crate::output::{STOPPED, Unread, VerbEnd, error_message, note};

/// Teaches a robot hand to play the piano: from a MIDI file to a policy, and from a policy to
/// music.
#[derive(Parser)]
#[command(name = "etude", version, after_help = EXIT_CODES, max_term_width = 110)]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

const EXIT_CODES: &str = "\
First steps:
  etude songs                 list the built-in songs
  etude play twinkle          play it with a trained policy
  etude train my-song.mid     learn a song of your own
  etude serve                 do the same on a page in the browser
  etude doctor                check what this machine has

Exit codes:
  0  done
  1  it failed; the message on standard error says why
  2  the command line is wrong
  3  stopped on request (Ctrl-C, SIGTERM, a closed terminal); a training has saved its state and `--resume` continues it
  130  ended at once, by Ctrl-C in a short command or by a second Ctrl-C; a training continues with `--resume` from its last checkpoint";

#[derive(Subcommand)]
enum Verb {
    /// List the built-in songs, or show one
    Songs(verbs::songs::Args),
    /// Learn to play a song
    Train(verbs::train::Args),
    /// Work on a page: drop a MIDI file, hear it, train, perform, compare
    Serve(verbs::serve::Args),
    /// Show running trainings
    Watch(verbs::watch::Args),
    /// Play a song with a trained policy; writes MIDI, sound, frames and recording
    Play(verbs::play::Args),
    /// Make a page that shows and plays a recording
    Replay(verbs::replay::Args),
    /// Compare two performances of one piece, note by note
    Compare(verbs::compare::Args),
    /// An index page of recordings, each with its replay
    Gallery(verbs::gallery::Args),
    /// Stills and videos of a recording
    Render(verbs::render::Args),
    /// Export a policy for other programs
    Export(verbs::export::Args),
    /// Play a song in many simulated worlds: how robust a policy is
    Evaluate(verbs::evaluate::Args),
    /// Play a song on a robot or its twin, in one of three modes
    Perform(verbs::perform::Args),
    /// Check, home, calibrate, watch and stop a robot
    Robot(verbs::robot::Args),
    /// Record a robot at rest or in an excitation
    Record(verbs::record::Args),
    /// Fit the simulator to a robot's recordings
    Identify(verbs::identify::Args),
    /// Sim2Real2Sim: record, identify, train and perform, repeatedly
    Rehearse(verbs::rehearse::Args),
    /// The paper's experiments and your own: plan, run here or on a cluster, report
    Experiment(verbs::experiment::Args),
    /// Run an emulated robot (the twin), for --robot
    Twin(verbs::twin::Args),
    /// Export the simulated world, or list its physical parameters
    Model(verbs::model::Args),
    /// Report what this machine has, and what each missing item prevents
    Doctor(verbs::doctor::Args),
    /// Print the completions for a shell
    Completions(verbs::completions::Args),
    /// Write the manual pages
    Man(verbs::man::Args),
}

fn main() -> ExitCode {
    // A stop that is requested from now on counts, also while files are loaded.
    etude_perform::session::process_begins();
    // A limit on the size of files is an error of the write, not the end of a robot's controller.
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::default());
    let cli = Cli::try_parse().unwrap_or_else(|error| {
        let odd = std::env::args_os().find(|word| word.to_str().is_none());
        if let Some(word) = odd.filter(|_| error.kind() == ErrorKind::InvalidUtf8) {
            note(format!(
                "etude: the name `{}` is not valid UTF-8: give the file another name (`mv OLD NEW`), and use that",
                word.display()
            ));
            std::process::exit(2);
        }
        let words: Vec<String> =
            std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect();
        mistakes::explained(error, Cli::command(), &words).exit()
    });
    let ended = match cli.verb {
        Verb::Songs(args) => verbs::songs::run(args),
        Verb::Train(args) => verbs::train::run(args),
        Verb::Serve(args) => verbs::serve::run(args),
        Verb::Watch(args) => verbs::watch::run(args),
        Verb::Play(args) => verbs::play::run(args),
        Verb::Replay(args) => verbs::replay::run(args),
        Verb::Compare(args) => verbs::compare::run(args),
        Verb::Gallery(args) => verbs::gallery::run(args),
        Verb::Render(args) => verbs::render::run(args),
        Verb::Export(args) => verbs::export::run(args),
        Verb::Evaluate(args) => verbs::evaluate::run(args),
        Verb::Perform(args) => verbs::perform::run(args),
        Verb::Robot(args) => verbs::robot::run(args),
        Verb::Record(args) => verbs::record::run(args),
        Verb::Identify(args) => verbs::identify::run(args),
        Verb::Rehearse(args) => verbs::rehearse::run(args),
        Verb::Experiment(args) => verbs::experiment::run(args),
        Verb::Twin(args) => verbs::twin::run(args),
        Verb::Model(args) => verbs::model::run(args),
        Verb::Doctor(args) => verbs::doctor::run(args),
        Verb::Completions(args) => verbs::completions::run(args, Cli::command()),
        Verb::Man(args) => verbs::man::run(args, Cli::command()),
    };
    match ended {
        Ok(VerbEnd::Done) => ExitCode::SUCCESS,
        Ok(VerbEnd::Stopped) => ExitCode::from(STOPPED),
        Ok(VerbEnd::Busy) => ExitCode::from(etude_experiment::BUSY),
        Err(error) if etude_lab::Interrupted::is_cause_of(&error) => {
            note(error);
            ExitCode::from(STOPPED)
        }
        Err(error) => match error.downcast_ref::<Unread>() {
            // `etude perform … | head` may be stopped too.
            Some(unread) if unread.is_terminal || progress::is_stop_requested() => ExitCode::from(STOPPED),
            Some(_) => ExitCode::SUCCESS,
            None => {
                note(format!("etude: {}", error_message(&error)));
                ExitCode::FAILURE
            }
        },
    }
}

#[cfg(test)]
#[path = "../tests/command/shell_blocks.rs"]
mod shell_blocks;

#[cfg(test)]
mod tests {
    use clap::{CommandFactory as _, Parser as _};

    use super::shell_blocks::documented;

    /// Verbs, options, values and paths of `--set` exist.
    #[test]
    fn every_command_in_a_shell_block_of_readme_and_book_is_one() {
        let commands = documented();
        assert!(commands.len() > 80, "{}", commands.len());
        for page in ["README.md", "docs/learn.md", "docs/twin.md", "docs/midi-to-robot.md", "docs/reading.md"]
        {
            assert!(commands.iter().any(|command| command.page == page), "{page} has none");
        }
        for command in &commands {
            let (page, line) = (&command.page, command.line());
            let words = std::iter::once("etude").chain(command.words.iter().map(String::as_str));
            if let Err(error) = super::Cli::try_parse_from(words) {
                panic!("{page}: `etude {line}`: {error}");
            }
            let after = |option: &str| {
                let pairs = command.words.windows(2).filter(move |pair| pair[0] == option);
                pairs.map(|pair| pair[1].clone()).collect::<Vec<_>>()
            };
            let preset = after("--preset").pop().unwrap_or_else(|| etude_lab::DEFAULT_PRESET.to_string());
            if let Err(error) = etude_lab::resolve(&preset, None, &after("--set")) {
                panic!("{page}: `etude {line}`: {error:#}");
            }
        }
    }

    #[test]
    fn the_command_line_is_consistent() {
        super::Cli::command().debug_assert();
    }
}
