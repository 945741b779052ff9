//! `etude man`: the manual pages.

use std::path::PathBuf;

use clap::{Command, ValueHint};

use crate::output::{VerbEnd, line};

/// Output folder.
#[derive(clap::Args)]
#[command(after_help = "\
One page a command, with the text of --help.

Example:
  etude man -o ~/.local/share/man/man1
  man etude-play")]
pub struct Args {
    /// The folder of the pages; `man` finds pages in folders called man1
    #[arg(short = 'o', long = "out", value_name = "DIR", value_hint = ValueHint::DirPath)]
    out: PathBuf,
}

/// Writes the pages of `command`.
pub fn run(args: Args, command: Command) -> anyhow::Result<VerbEnd> {
    etude_lab::make_folder(&args.out)?;
    clap_mangen::generate_to(command, &args.out)?;
    line(format!("The pages are in {}; `man etude` shows the first", args.out.display()))?;
    Ok(VerbEnd::Done)
}
