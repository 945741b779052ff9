//! `etude man`: the manual pages.

use std::path::PathBuf;

use clap::{Command, ValueHint};

use super::line;
use crate::Ending;

/// Where they go.
#[derive(clap::Args)]
#[command(after_help = "\
One page a command, made from what --help prints.

Example:
  etude man -o ~/.local/share/man/man1
  man etude-play")]
pub struct Args {
    /// The folder of the pages; its name is man1 where `man` looks for them
    #[arg(short = 'o', long = "out", value_name = "DIR", value_hint = ValueHint::DirPath)]
    out: PathBuf,
}

/// Writes the pages of `command`.
pub fn run(args: Args, command: Command) -> anyhow::Result<Ending> {
    etude_lab::make_folder(&args.out)?;
    clap_mangen::generate_to(command, &args.out)?;
    line(format!("The pages are in {}; `man etude` shows the first", args.out.display()))?;
    Ok(Ending::Done)
}
