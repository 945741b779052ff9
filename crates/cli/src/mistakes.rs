//! Suggestions for an unknown subcommand or option, from clap's tree of commands.

use std::ffi::OsStr;
use std::path::Path;

use clap::builder::StyledStr;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Arg, Command};
use etude_music::{repertoire, similar_names};
use etude_perform::shell_line;

const MAX_SUGGESTIONS: usize = 4;

/// `error` of `words` (the program's name first), with suggestions from `root`.
pub fn explained(mut error: clap::Error, mut root: Command, words: &[String]) -> clap::Error {
    root.build();
    let context = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.clone()),
        _ => None,
    };
    let found = match error.kind() {
        ErrorKind::InvalidSubcommand => {
            context(ContextKind::InvalidSubcommand).map(|word| commands(&root, words, &word))
        }
        ErrorKind::UnknownArgument => {
            context(ContextKind::InvalidArg).map(|option| options(&root, &option).into_iter().collect())
        }
        _ => None,
    };
    let tips: Vec<StyledStr> = found.unwrap_or_default().into_iter().map(StyledStr::from).collect();
    if !tips.is_empty() {
        error.remove(ContextKind::SuggestedSubcommand);
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(tips));
    }
    error
}

/// What `word`, no subcommand at its place in `words`, may mean: an argument of a subcommand there,
/// a command elsewhere, or one with a similar name.
fn commands(root: &Command, words: &[String], word: &str) -> Vec<String> {
    let at = words.iter().position(|other| other == word).unwrap_or(words.len());
    let (before, after) = (words.get(1..at).unwrap_or_default(), words.get(at + 1..).unwrap_or_default());
    let all = tree(root);
    // The whole command line, if it is valid.
    let whole = |path: &[&str], from: &[String]| {
        let line = ["etude"].iter().chain(path).map(ToString::to_string).chain(from.iter().cloned());
        let line: Vec<String> = line.collect();
        root.clone().try_get_matches_from(&line).is_ok().then(|| shell_line(line))
    };
    let values = |command: &Command| {
        let of = |arg: &Arg| arg.get_possible_values().into_iter().map(|value| value.get_name().to_string());
        command.get_positionals().flat_map(of).collect::<Vec<String>>()
    };
    let names = || all.iter().filter_map(|(path, _)| path.last().copied());
    let is_name = names().any(|name| name == word);
    let here = || all.iter().filter(|(path, _)| path[..path.len() - 1] == *before);
    let has_similar_name =
        !similar_names(word, here().filter_map(|(path, _)| path.last().copied())).is_empty();
    // The word as an argument of a subcommand here, or a value with a similar name.
    let as_argument = |(path, command): &(Vec<&str>, &Command)| {
        let values = values(command);
        let is_song = is_midi(word) && repertoire::ids().all(|id| values.iter().any(|value| value == id));
        let similar =
            || similar_names(word, values.iter().map(String::as_str)).first().map(ToString::to_string);
        let value = match is_song || values.iter().any(|value| value == word) {
            true => word.to_string(),
            false => similar().filter(|_| !is_name && !has_similar_name && !word.contains(['/', '.']))?,
        };
        let line: Vec<String> = std::iter::once(value).chain(after.iter().cloned()).collect();
        whole(path, &line)
    };
    let with_the_word: Vec<String> = here().filter_map(as_argument).collect();
    let meant = if is_name { vec![word] } else { similar_names(word, names()) };
    let named = meant.iter().flat_map(|name| all.iter().filter(|(path, _)| path.last() == Some(name)));
    let elsewhere =
        named.map(|(path, _)| whole(path, after).unwrap_or_else(|| format!("etude {}", path.join(" "))));
    let lines = if with_the_word.is_empty() { elsewhere.collect() } else { with_the_word };
    lines.into_iter().take(MAX_SUGGESTIONS).map(|line| format!("did you mean `{line}`?")).collect()
}

fn is_midi(word: &str) -> bool {
    let extension = Path::new(word).extension().map(OsStr::to_ascii_lowercase);
    extension.is_some_and(|extension| extension == "mid" || extension == "midi")
}

/// The commands with `option`, if there are some.
fn options(root: &Command, option: &str) -> Option<String> {
    let is_it = |arg: &Arg| arg.get_long().is_some_and(|long| option == format!("--{long}"));
    let all = tree(root);
    let having = all.iter().filter(|(_, command)| command.get_arguments().any(is_it));
    let paths: Vec<String> =
        having.map(|(path, _)| format!("`etude {}`", path.join(" "))).take(MAX_SUGGESTIONS).collect();
    (!paths.is_empty()).then(|| format!("`{option}` is an option of {}", paths.join(", ")))
}

/// Every visible command with its path, parents first.
fn tree(root: &Command) -> Vec<(Vec<&str>, &Command)> {
    let visible =
        root.get_subcommands().filter(|command| !command.is_hide_set() && command.get_name() != "help");
    visible
        .flat_map(|command| {
            let below = tree(command).into_iter().map(|(mut path, below)| {
                path.insert(0, command.get_name());
                (path, below)
            });
            std::iter::once((vec![command.get_name()], command)).chain(below).collect::<Vec<_>>()
        })
        .collect()
}
