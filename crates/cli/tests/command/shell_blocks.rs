//! The commands in the shell blocks of README and book, as a shell would read them.

use std::path::{Path, PathBuf};

/// A command line of `etude` in a document.
#[derive(Clone, Debug)]
pub struct Documented {
    /// The document, from the top of the repository.
    pub page: String,
    /// Its words, without `etude`.
    pub words: Vec<String>,
}

impl Documented {
    /// The words with spaces between them.
    pub fn line(&self) -> String {
        self.words.join(" ")
    }
}

/// The commands of every page, in their order.
pub fn documented() -> Vec<Documented> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut pages = vec![PathBuf::from("README.md")];
    for folder in ["docs", "docs/results"] {
        let entries = std::fs::read_dir(root.join(folder)).unwrap().map(|entry| entry.unwrap().file_name());
        let mut names: Vec<_> = entries.filter(|name| name.to_string_lossy().ends_with(".md")).collect();
        names.sort();
        pages.extend(names.iter().map(|name| Path::new(folder).join(name)));
    }
    pages.iter().flat_map(|page| of_page(page, &std::fs::read_to_string(root.join(page)).unwrap())).collect()
}

/// Those of one page.
pub fn of_page(page: &Path, text: &str) -> Vec<Documented> {
    let mut found = Vec::new();
    // Values of variables, from `export NAME=VALUE`.
    let mut values: Vec<(String, Vec<String>)> = Vec::new();
    let mut is_shell = false;
    let mut whole = String::new();
    for line in text.lines().map(str::trim) {
        if let Some(kind) = line.strip_prefix("```") {
            is_shell = !is_shell && ["sh", "bash", "shell", "console"].contains(&kind);
        } else if is_shell {
            whole.push_str(line);
            if whole.ends_with('\\') {
                whole.pop();
                continue;
            }
            let words = words(&whole.replace("target/release/etude", "etude"));
            whole.clear();
            for command in words.split(|word| [";", "&", "|", "&&"].contains(&word.as_str())) {
                read(page, command, &mut values, &mut found);
            }
        }
    }
    found
}

/// Reads one simple command.
fn read(
    page: &Path,
    command: &[String],
    values: &mut Vec<(String, Vec<String>)>,
    found: &mut Vec<Documented>,
) {
    match command {
        [word, name, is_in, all @ ..] if word == "for" && is_in == "in" => {
            values.push((name.clone(), all.to_vec()));
        }
        [word, assignment] if word == "export" => {
            let (name, value) = assignment.split_once('=').unwrap();
            values.push((name.to_string(), vec![value.to_string()]));
        }
        [word, rest @ ..] if word == "do" => read(page, rest, values, found),
        [word, rest @ ..] if word == "etude" => {
            let end = rest.iter().position(|word| word == ">").unwrap_or(rest.len());
            let mut lines = vec![rest[..end].to_vec()];
            for (name, all) in values.iter().rev() {
                let name = format!("${name}");
                lines = lines
                    .iter()
                    .flat_map(|line| {
                        let times =
                            if line.iter().any(|word| word.contains(&name)) { &all[..] } else { &all[..1] };
                        times.iter().map(|value| line.iter().map(|word| word.replace(&name, value)).collect())
                    })
                    .collect();
            }
            for words in lines {
                assert!(
                    !words.iter().any(|word| word.contains('$')),
                    "{}: {words:?} has no value",
                    page.display()
                );
                found.push(Documented { page: page.display().to_string(), words });
            }
        }
        _ => {}
    }
}

/// The words of a line, without its comment.
fn words(line: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    let mut word = String::new();
    let mut quote = None;
    for c in line.chars() {
        match quote {
            Some(q) if c == q => quote = None,
            Some(_) => word.push(c),
            None if c == '\'' || c == '"' => quote = Some(c),
            None if c == '#' && word.is_empty() => break,
            None if c == ';' => {
                words.extend([std::mem::take(&mut word), ";".to_string()]);
            }
            None if c.is_whitespace() => words.push(std::mem::take(&mut word)),
            None => word.push(c),
        }
    }
    words.push(word);
    words.retain(|word| !word.is_empty());
    words
}
