//! Commands in messages: what is printed can be typed.

/// `text`, a path or a name, as one word of a shell. Words that need no quotes stay as they are,
/// `path=value` too.
pub fn shell_word(text: impl std::fmt::Display) -> String {
    let text = text.to_string();
    // Only a NUL cannot be quoted, and no argument or path has one.
    let quoted = |part| shlex::try_quote(part).map_or_else(|_| part.to_string(), Into::into);
    text.split('=').map(quoted).collect::<Vec<String>>().join("=")
}

/// A command line, each word quoted where a shell needs it.
pub fn shell_line(words: impl IntoIterator<Item = String>) -> String {
    words.into_iter().map(shell_word).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shell_reads_what_was_written() {
        let words = [
            "etude",
            "songs/Au Clair.mid",
            "it's",
            "Für Elise.mid",
            "a{b,c}",
            "$(x)",
            "",
            "trainer.seed=3",
            "x=a b",
            "=cat",
            "~",
        ];
        let line = shell_line(words.map(String::from));
        assert_eq!(shlex::split(&line).unwrap(), words);
        let mut shell = std::process::Command::new("sh");
        let output = shell.args(["-c", &format!("printf '%s\\n' {line}")]).output().unwrap();
        assert_eq!(String::from_utf8(output.stdout).unwrap().lines().collect::<Vec<_>>(), words);
        assert_eq!(shell_word("runs/twinkle__fast__0"), "runs/twinkle__fast__0");
        assert_eq!(
            shell_word("task.plan.latency_compensation_secs=0.03"),
            "task.plan.latency_compensation_secs=0.03"
        );
    }
}
