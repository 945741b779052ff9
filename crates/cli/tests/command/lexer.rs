//! Comments and string literals of a source file.

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    Code,
    Comment,
    /// Between the quotes of a string literal.
    Text,
}

/// The kind of each character of a file with this extension.
pub fn kinds(text: &str, extension: &str) -> Vec<Kind> {
    let chars: Vec<char> = text.chars().collect();
    let begins = |at: usize, with: &str| with.chars().enumerate().all(|(i, c)| chars.get(at + i) == Some(&c));
    let find =
        |from: usize, end: &str| (from..chars.len()).find(|at| begins(*at, end)).unwrap_or(chars.len());
    let (line_comment, quotes): (&str, &[&str]) = match extension {
        "py" => ("#", &["\"\"\"", "'''", "\"", "'"]),
        "rs" => ("//", &["\""]),
        _ => ("//", &["\"", "'", "`"]),
    };
    let mut kinds = vec![Kind::Code; chars.len()];
    let mut at = 0;
    while at < chars.len() {
        if begins(at, line_comment) || (extension != "py" && begins(at, "/*")) {
            let end = if begins(at, "/*") { find(at + 2, "*/") + 2 } else { find(at, "\n") };
            let end = end.min(chars.len());
            kinds[at..end].fill(Kind::Comment);
            at = end;
        } else if extension == "rs" && chars[at] == '\'' {
            // A character; a lifetime has no second quote.
            at += match (chars.get(at + 1), chars.get(at + 2)) {
                (Some('\\'), _) => find(at + 3, "'") + 1 - at,
                (_, Some('\'')) => 3,
                _ => 1,
            };
        } else if extension == "rs" && chars[at] == 'r' && (begins(at, "r\"") || begins(at, "r#\"")) {
            let hashes = usize::from(begins(at, "r#"));
            let end = find(at + 2 + hashes, if hashes == 1 { "\"#" } else { "\"" });
            kinds[at + 2 + hashes..end].fill(Kind::Text);
            at = end + 1 + hashes;
        } else if let Some(quote) = quotes.iter().find(|quote| begins(at, quote)) {
            let begin = at + quote.len();
            let mut end = begin;
            while end < chars.len() && !begins(end, quote) {
                end += if chars[end] == '\\' { 2 } else { 1 };
            }
            let end = end.min(chars.len());
            kinds[begin..end].fill(Kind::Text);
            at = end + quote.len();
        } else {
            at += 1;
        }
    }
    kinds
}
