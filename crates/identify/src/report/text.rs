//! The report as plain text: 110 columns, no pictures.

use super::document::{Document, Element, Table};

/// Columns of the page.
const WIDTH: usize = 110;
/// Between two columns of a table.
const GAP: &str = "  ";
/// A column of a table is not made narrower than its longest word, unless that is longer than this, ...
const LONG_WORD: usize = 32;
/// ... nor narrower than this.
const NARROWEST: usize = 4;

/// The document as text.
pub(super) fn text(document: &Document) -> String {
    let mut out = Vec::new();
    out.extend(wrap(&document.title, WIDTH));
    out.push("=".repeat(WIDTH));
    for section in &document.sections {
        out.push(String::new());
        out.push(section.title.to_string());
        out.push("-".repeat(section.title.chars().count()));
        for element in &section.elements {
            out.push(String::new());
            match element {
                Element::Paragraph(words) => out.extend(wrap(words, WIDTH)),
                Element::List(items) => {
                    for item in items {
                        let lines = wrap(item, WIDTH - 2).into_iter().enumerate();
                        out.extend(
                            lines
                                .map(|(line, text)| format!("{}{text}", if line == 0 { "- " } else { "  " })),
                        );
                    }
                }
                Element::Table(table) => lay_out(table, &mut out),
                Element::Pictures(_) => {
                    out.pop();
                }
            }
        }
    }
    out.iter().flat_map(|line| [line.trim_end(), "\n"]).collect()
}

fn lay_out(table: &Table, out: &mut Vec<String>) {
    if !table.caption.is_empty() {
        out.extend(wrap(&table.caption, WIDTH));
    }
    let heads: Vec<String> = table.columns.iter().map(|column| column.name.to_string()).collect();
    let cells =
        |column: usize| [&heads].into_iter().chain(&table.rows).filter_map(move |row| row.get(column));
    let mut widths: Vec<usize> = (0..heads.len())
        .map(|column| cells(column).map(|cell| cell.chars().count()).max().unwrap_or(0).max(1))
        .collect();
    let room = WIDTH.saturating_sub(GAP.len() * heads.len().saturating_sub(1));
    let longest = |column: usize| {
        let words = cells(column).flat_map(|cell| cell.split_whitespace());
        words.map(|word| word.chars().count()).max().unwrap_or(0).clamp(NARROWEST, LONG_WORD)
    };
    let whole: Vec<usize> = (0..heads.len()).map(longest).collect();
    for least in [whole, vec![NARROWEST; heads.len()]] {
        while widths.iter().sum::<usize>() > room {
            // The widest gives way: that is where words are.
            let mut wide: Vec<(&mut usize, usize)> = widths.iter_mut().zip(least.iter().copied()).collect();
            wide.retain(|(width, least)| **width > *least);
            match wide.into_iter().map(|(width, _)| width).max() {
                Some(widest) => *widest -= 1,
                None => break,
            }
        }
    }
    let rule: Vec<String> = widths.iter().map(|width| "-".repeat(*width)).collect();
    for row in [&heads, &rule].into_iter().chain(&table.rows) {
        let wrapped: Vec<Vec<String>> =
            row.iter().zip(&widths).map(|(cell, width)| wrap(cell, *width)).collect();
        for line in 0..wrapped.iter().map(Vec::len).max().unwrap_or(0) {
            let cells = wrapped.iter().zip(&widths).zip(&table.columns).map(|((lines, &width), column)| {
                let cell = lines.get(line).map_or("", String::as_str);
                if column.is_number { format!("{cell:>width$}") } else { format!("{cell:<width$}") }
            });
            out.push(cells.collect::<Vec<_>>().join(GAP));
        }
    }
}

/// Lines of at most `width` characters, broken between words where that is possible; at least one line.
fn wrap(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    let mut used = 0;
    for word in text.split_whitespace() {
        // A terminal obeys control characters, and a file's name may hold them.
        let word: Vec<char> = word.chars().map(|c| if c.is_control() { '\u{fffd}' } else { c }).collect();
        for (index, piece) in word.chunks(width.max(1)).enumerate() {
            let space = usize::from(used > 0 && index == 0);
            if used > 0 && (index > 0 || used + space + piece.len() > width) {
                lines.push(String::new());
                used = 0;
            }
            if let Some(line) = lines.last_mut() {
                if used > 0 {
                    line.push(' ');
                    used += 1;
                }
                line.extend(piece);
                used += piece.len();
            }
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::super::document::{Section, numbers, words};
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn words_stay_whole_where_they_can() {
        assert_eq!(wrap("one two  three", 7), ["one two", "three"]);
        assert_eq!(wrap("a abcdefghij b", 4), ["a", "abcd", "efgh", "ij b"]);
        assert_eq!(wrap("", 5), [""]);
        assert_eq!(wrap("a\u{1b}[2Jb", 20), ["a\u{fffd}[2Jb"]);
    }

    proptest! {
        #[test]
        fn no_line_is_too_long(
            cells in proptest::collection::vec(".{0,200}", 12),
            paragraph in ".{0,400}",
        ) {
            let rows = cells.chunks(4).map(<[String]>::to_vec).collect();
            let columns = vec![words("joint"), numbers("rms"), words("what it is"), numbers("share")];
            let table = Table { caption: paragraph.clone(), columns, rows };
            let elements = vec![
                Element::Paragraph(paragraph.clone()),
                Element::List(vec![paragraph.clone()]),
                Element::Table(table),
            ];
            let document = Document { title: paragraph, sections: vec![Section { title: "Part", elements }] };
            for line in text(&document).lines() {
                prop_assert!(line.chars().count() <= WIDTH, "{line}");
            }
        }
    }
}
