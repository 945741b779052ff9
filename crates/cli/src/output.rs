//! What a command prints, and how it ends.

use std::io::Write as _;

use etude_show::replay::Take;

/// How a verb ended without failing.
pub enum VerbEnd {
    Done,
    Stopped,
    /// Another process is working on it.
    Busy,
}

/// Exit code of a verb that was stopped on request.
pub const STOPPED: u8 = 3;

/// Nobody reads standard output any more: an error that ends the verb quietly, as `etude songs |
/// head` must not fail.
#[derive(Debug)]
pub struct Unread {
    /// Whether it is a terminal that is closed, and not a pipe.
    pub is_terminal: bool,
}

impl std::fmt::Display for Unread {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.write_str("standard output is closed")
    }
}

impl std::error::Error for Unread {}

/// Prints one line on standard output; the error may be [`Unread`].
pub fn line(text: impl std::fmt::Display) -> anyhow::Result<()> {
    /// "Input/output error", which a terminal gives that is closed.
    const EIO: i32 = 5;
    writeln!(std::io::stdout(), "{text}").map_err(|error| {
        if error.raw_os_error() == Some(EIO) {
            Unread { is_terminal: true }.into()
        } else if error.kind() == std::io::ErrorKind::BrokenPipe {
            Unread { is_terminal: false }.into()
        } else {
            error.into()
        }
    })
}

/// Prints one line on standard error; if it is closed, the work continues.
pub fn note(text: impl std::fmt::Display) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Says of each recording what is missing in it.
pub fn note_incomplete(takes: &[Take]) {
    for take in takes {
        take.incomplete.iter().for_each(|text| note(format!("{}: {text}", take.name)));
    }
}

/// Prints a value as JSON on standard output.
pub fn print_json(value: &impl serde::Serialize) -> anyhow::Result<()> {
    line(serde_json::to_string_pretty(value)?)
}

/// The error and its causes in one line, each once: many messages contain their cause already.
pub fn error_message(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if !text.contains(&cause) {
            let colon = if text.is_empty() { "" } else { ": " };
            text = text + colon + &cause;
        }
    }
    text
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_message_has_each_cause_once() {
        let inner = anyhow::anyhow!("no space");
        let message = |outer: &'static str| super::error_message(&inner.context(outer));
        assert_eq!(message("cannot write x: no space; free some"), "cannot write x: no space; free some");
    }
}
