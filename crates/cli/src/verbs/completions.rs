//! `etude completions`: completions of the command line for a shell.

use clap::builder::{PossibleValuesParser, TypedValueParser as _};
use clap::{Arg, Command, ValueHint, value_parser};
use clap_complete::Shell;

use crate::output::{VerbEnd, line};

/// For which shell.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  etude completions bash > ~/.local/share/bash-completion/completions/etude
  etude completions zsh > ~/.zfunc/_etude               # with fpath+=~/.zfunc before compinit in ~/.zshrc
  etude completions fish > ~/.config/fish/completions/etude.fish")]
pub struct Args {
    /// The shell
    #[arg(value_parser = PossibleValuesParser::new(["bash", "zsh", "fish"]).try_map(|shell| shell.parse::<Shell>()))]
    shell: Shell,
}

/// Writes the completions of `command`.
pub fn run(args: Args, command: Command) -> anyhow::Result<VerbEnd> {
    let mut command = prepared(command, args.shell);
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut command, "etude", &mut text);
    line(String::from_utf8(text)?.trim_end())?;
    Ok(VerbEnd::Done)
}

/// `command` with the completions of values that are a name or a file. Bash completes the names,
/// and files where no name fits; the other shells would complete the names alone, so they get the
/// files.
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
