//! The vocabulary: one term for one thing, in help texts, messages, comments and documents.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::lexer::{Kind, kinds};
use crate::{Sandbox, root};

/// Phrases that are not used, and what to say instead. Words are compared without case; `*` at the
/// end of one stands for any letters, `#` for a number. A phrase may run over a line's end, and `_`
/// and `-` separate words too.
const WORDS: &[(&str, &str)] = &[
    ("scripted player*", "scripted baseline"),
    ("truth", "twin parameters, parameter set"),
    ("truths", "twin parameters, parameter sets"),
    ("plan leads", "latency compensation; commands are sent # ms early"),
    ("leads by", "latency compensation; commands are sent # ms early"),
    ("lead secs", "latency_compensation_secs"),
    ("lead of the plan", "latency compensation"),
    ("at sight", "zero-shot"),
    ("give up", "omit, stop"),
    ("gives up", "omits, stops"),
    ("given up", "omitted, stopped"),
    ("cut short", "shortened, interrupted"),
    ("cuts short", "shortens, interrupts"),
    ("leaves early", "shortens"),
    ("rule of before", "nothing: a page says what holds now"),
    ("present rule", "nothing: a page says what holds now"),
    ("since removed", "nothing: a page says what holds now"),
    ("earlier build*", "nothing: one schema version, others are refused"),
    ("older étude", "nothing: one schema version, others are refused"),
    ("git show", "nothing: what was is in the history"),
    ("november", "nothing: no date but the month of a measurement"),
    ("in the mean", "on average"),
    ("beside other work", "on a loaded machine"),
    ("round #", "iteration (Sim2Real2Sim) or update (learner)"),
    ("updates per round", "updates_per_vector_step"),
    ("stopped itself", "safety stop"),
    ("what the song asks", "the score"),
    ("barred", "blocked"),
    ("bothered", "blocked"),
    ("bothers", "blocks"),
    ("blames", "names the wrong joint"),
    ("goes on", "continues"),
    ("go on", "continue"),
    ("going on", "continuing"),
    ("is told", "receives, is given"),
    ("are told", "receive, are given"),
];

/// Phrases with one of those words that are the field's.
const ALLOWED: &[&str] =
    &["ground truth", "truth value", "truth values", "truth about latency", "november 2026"];

/// Endings of names in the code that are not used, and what to call them.
const NAMES: &[(&str, &str)] = &[
    ("_telling", "_with_progress"),
    ("_told", "_with_progress"),
    ("MOST_", "MAX_"),
    ("LEAST_", "MIN_"),
    ("LONGEST_", "MAX_"),
    ("LARGEST_", "MAX_"),
];
/// Stands for code in the text of a source.
const CODE: char = '\u{1}';
const MAX_COLUMNS: usize = 100;
const MAX_LINES: usize = 400;

#[test]
fn help_texts_use_the_words() {
    let sandbox = Sandbox::new();
    let mut found = Vec::new();
    let mut commands = vec![String::new()];
    while let Some(command) = commands.pop() {
        let help = sandbox.ok(&format!("{command} --help"));
        found.extend(
            misused(&help).into_iter().map(|(line, text)| format!("etude {command} --help:{line}: {text}")),
        );
        let below = help.lines().skip_while(|line| *line != "Commands:").skip(1);
        let below = below.take_while(|line| !line.is_empty()).filter(|line| !line.starts_with("   "));
        let below = below.filter_map(|line| line.split_whitespace().next()).filter(|name| *name != "help");
        commands.extend(below.map(|name| format!("{command} {name}")));
    }
    none(&found);
}

#[test]
fn sources_use_the_words() {
    none(&in_sources(|text, kinds| {
        // Code separates phrases; the end of a line does not.
        let character = |(c, kind): (char, &Kind)| match kind {
            Kind::Code if !c.is_whitespace() => CODE,
            _ => c,
        };
        let prose: String = text.chars().zip(kinds).map(character).collect();
        let names = text.lines().zip(1..).flat_map(|(line, number)| {
            let names = line.split(|c: char| !(c.is_alphanumeric() || c == '_'));
            let bad = |name: &str| {
                let found = NAMES.iter().find(|(part, _)| match part.starts_with('_') {
                    true => name.ends_with(part),
                    false => name.starts_with(part) || name == part.trim_end_matches('_'),
                });
                found.map(|(_, instead)| (number, format!("`{name}`: call it …{instead}…")))
            };
            names.filter_map(bad).collect::<Vec<_>>()
        });
        misused(&prose).into_iter().chain(names).collect()
    }));
}

#[test]
fn documents_use_the_words() {
    none(&in_documents(misused));
}

#[test]
fn comments_and_prose_end_at_column_100() {
    let mut found = in_sources(|text, kinds| {
        let mut kinds = kinds.iter();
        let mut is_code = false;
        let wide = text.split('\n').zip(1..).filter_map(|(line, number)| {
            let length = line.chars().count();
            let is_comment =
                kinds.by_ref().take(length + 1).filter(|kind| **kind == Kind::Comment).count() > 0;
            let prose = line.trim_start().trim_start_matches(['/', '!', '#', '*']).trim_start();
            is_code ^= is_comment && prose.starts_with("```");
            // Tables, drawings, lists in columns and addresses keep their lines.
            let is_drawn =
                prose.starts_with('|') || ["──", "  ", "://"].iter().any(|part| prose.contains(part));
            let is_wide = length > MAX_COLUMNS && is_comment && !line.trim_start().starts_with("#[");
            (is_wide && !is_drawn && !is_code && !line.starts_with("#!["))
                .then(|| (number, "a comment beyond column 100".to_string()))
        });
        wide.collect()
    });
    found.extend(in_documents(|text| {
        let mut is_code = false;
        let wide = text.lines().zip(1..).filter_map(|(line, number)| {
            is_code ^= line.trim_start().starts_with("```");
            let is_exempt = is_code
                || ["|", "!", "[!", "<!--"].iter().any(|mark| line.starts_with(mark))
                || line.contains("://");
            // Without the targets of links.
            let mut parts = line.split("](");
            let first = parts.next().unwrap_or_default().chars().count();
            let others = parts.map(|part| part.split_once(')').map_or("", |(_, rest)| rest).chars().count());
            let is_wide = first + others.sum::<usize>() > MAX_COLUMNS && !is_exempt;
            is_wide.then(|| (number, "prose beyond column 100".to_string()))
        });
        wide.collect()
    }));
    none(&found);
}

#[test]
fn files_have_at_most_400_lines() {
    let long = |path: &PathBuf| {
        let lines = std::fs::read_to_string(path).unwrap().lines().count();
        (lines > MAX_LINES).then(|| format!("{}: {lines} lines", shown(path)))
    };
    let tests = ["crates", "python/tests", "viewer/test"].map(|folder| files(&root().join(folder), "tests"));
    let found: BTreeSet<String> = sources().iter().chain(tests.iter().flatten()).filter_map(long).collect();
    none(&found.into_iter().collect::<Vec<_>>());
}

#[test]
fn phrases_are_found_over_line_ends_and_in_names() {
    let found = |text: &str| misused(text).into_iter().map(|(line, _)| line).collect::<Vec<_>>();
    assert_eq!(found("It plays\n// at sight and goes\n// on."), [2, 2]);
    assert_eq!(found("reads_at_sight, round-12, round trip, ground truth, the truth"), [1, 1, 1]);
    let rust = "let a = 'x'; // one \"\nlet b: &'static str = \"two \\\" // no\"; /* three */ r#\"four\"#";
    let kinds = kinds(rust, "rs");
    let of = |wanted: Kind| -> String {
        rust.chars().zip(&kinds).filter(|(_, kind)| **kind == wanted).map(|(c, _)| c).collect()
    };
    assert_eq!(of(Kind::Comment), "// one \"/* three */");
    assert_eq!(of(Kind::Text), "two \\\" // nofour");
}

/// Lines of `text` with a phrase of [`WORDS`], and what to say instead.
fn misused(text: &str) -> Vec<(usize, String)> {
    let words = words(text);
    let is_at = |at: usize, phrase: &str| {
        let mut there = words[at..].iter();
        phrase.split(' ').all(|part| {
            there.next().is_some_and(|(_, word)| match part.strip_suffix('*') {
                Some(begin) => word.starts_with(begin),
                None if part == "#" => word.chars().all(|c| c.is_ascii_digit()),
                None => word == part,
            })
        })
    };
    let is_allowed = |at: usize| {
        let is_within = |phrase: &str| {
            (0..phrase.split(' ').count()).any(|before| at >= before && is_at(at - before, phrase))
        };
        ALLOWED.iter().any(|phrase| is_within(phrase))
    };
    let mut found = Vec::new();
    for (at, (line, _)) in words.iter().enumerate() {
        let used = WORDS.iter().filter(|(phrase, _)| is_at(at, phrase) && !is_allowed(at));
        found.extend(used.map(|(phrase, instead)| (*line, format!("`{phrase}`: say {instead}"))));
    }
    found
}

/// The words of a text in lower case, each with its line.
fn words(text: &str) -> Vec<(usize, String)> {
    let mut words: Vec<(usize, String)> = Vec::new();
    for (line, number) in text.split('\n').zip(1..) {
        for part in line.split_inclusive(|c: char| !c.is_alphanumeric()) {
            let word = part.trim_end_matches(|c: char| !c.is_alphanumeric());
            if !word.is_empty() {
                words.push((number, word.to_lowercase()));
            }
            // Code stands as a word of its own, so that no phrase runs over it.
            if part.ends_with(CODE) && words.last().is_none_or(|(_, last)| !last.starts_with(CODE)) {
                words.push((number, CODE.to_string()));
            }
        }
    }
    words
}

/// What `check` finds in the Rust, Python and JavaScript files that ship.
fn in_sources(check: impl Fn(&str, &[Kind]) -> Vec<(usize, String)>) -> Vec<String> {
    let check = |path: &PathBuf| {
        let text = std::fs::read_to_string(path).unwrap();
        let extension = path.extension().unwrap().to_str().unwrap();
        let kinds = kinds(&text, extension);
        let found = check(&text, &kinds);
        found.into_iter().map(|(line, text)| format!("{}:{line}: {text}", shown(path))).collect::<Vec<_>>()
    };
    sources().iter().flat_map(check).collect()
}

/// What `check` finds in README, ARCHITECTURE, CHANGELOG and the book.
fn in_documents(check: impl Fn(&str) -> Vec<(usize, String)>) -> Vec<String> {
    let mut paths = files(&root().join("docs"), "docs");
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "md"));
    paths.extend(["README.md", "ARCHITECTURE.md", "CHANGELOG.md"].map(|name| root().join(name)));
    let check = |path: &PathBuf| {
        let found = check(&std::fs::read_to_string(path).unwrap());
        found.into_iter().map(|(line, text)| format!("{}:{line}: {text}", shown(path))).collect::<Vec<_>>()
    };
    paths.iter().flat_map(check).collect()
}

fn sources() -> Vec<PathBuf> {
    let folders =
        [("crates", "src"), ("python/src", "src"), ("python/etude", "etude"), ("viewer/src", "src")];
    folders.iter().flat_map(|(folder, part)| files(&root().join(folder), part)).collect()
}

/// Source files and documents below `folder` whose path has this `part`.
fn files(folder: &Path, part: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(folder) = folders.pop() {
        let entries = std::fs::read_dir(&folder).into_iter().flatten().flatten();
        for path in entries.map(|entry| entry.path()) {
            let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
            if path.is_dir() {
                folders.push(path);
            } else if path.iter().any(|name| name == part)
                && ["rs", "py", "js", "mjs", "md"].contains(&extension)
            {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

fn shown(path: &Path) -> String {
    path.strip_prefix(root()).unwrap_or(path).display().to_string()
}

fn none(found: &[String]) {
    assert!(found.is_empty(), "{} places:\n{}", found.len(), found.join("\n"));
}
