//! `etude completions`: what a shell needs to complete the command line.

use clap::{Arg, Command, ValueHint, value_parser};
use clap_complete::Shell;

use crate::Ending;

/// For which shell.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  etude completions bash > ~/.local/share/bash-completion/completions/etude
  etude completions zsh > ~/.zfunc/_etude               # with fpath+=~/.zfunc before compinit in ~/.zshrc
  etude completions fish > ~/.config/fish/completions/etude.fish")]
pub struct Args {
    /// The shell
    shell: Shell,
}

/// Writes the completions of `command`.
pub fn run(args: Args, command: Command) -> anyhow::Result<Ending> {
    let mut command = prepared(command, args.shell);
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut command, "etude", &mut text);
    super::line(String::from_utf8(text)?.trim_end())?;
    Ok(Ending::Done)
}

/// `command` as the generator of `shell` needs it, where a value is a name or a file. Bash offers the names, and files by itself where
/// no name fits. The others would offer the names alone: they get the files.
fn prepared(command: Command, shell: Shell) -> Command {
    let either =
        |arg: &Arg| arg.get_value_hint() == ValueHint::FilePath && !arg.get_possible_values().is_empty();
    let changed = move |arg: Arg| match shell {
        _ if !either(&arg) => arg,
        Shell::Bash => arg.value_hint(ValueHint::Unknown),
        _ => arg.value_parser(value_parser!(String)),
    };
    command.mut_args(changed).mut_subcommands(|below| prepared(below, shell))
}
