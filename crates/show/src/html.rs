//! The shell of our HTML pages, and their tables. A page loads no other file, except the pictures
//! and sounds of its folder.

use maud::{DOCTYPE, Markup, PreEscaped, Render, html};

/// Colours and type, as the replay page has them, and the parts of the other pages.
const STYLE: &str = concat!(include_str!("../../../viewer/src/look.css"), include_str!("page.css"));

/// A page without scripts, with its title as heading.
pub fn page(title: &str, body: &Markup) -> String {
    let body = html! {
        div.sheet {
            header { h1 { (title) } span.brand { "Étude" } }
            main { (body) }
        }
    };
    document(title, None, STYLE, &body)
}

/// A whole document. `policy` is its Content-Security-Policy.
pub(crate) fn document(title: &str, policy: Option<&str>, style: &str, body: &Markup) -> String {
    let markup = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                @if let Some(policy) = policy { meta http-equiv="Content-Security-Policy" content=(policy); }
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(style)) }
            }
            body { (body) }
        }
    };
    markup.into_string()
}

/// From how many columns on a table is wider than a phone.
const WIDE: usize = 5;

/// A table with the heading `caption`; nothing without rows. A wide one scrolls by itself, also by
/// keys.
pub fn table(caption: &str, columns: &[impl Render], rows: impl IntoIterator<Item = Vec<String>>) -> Markup {
    let mut rows = rows.into_iter().peekable();
    html! {
        @if rows.peek().is_some() {
            figure.table {
                figcaption {
                    (caption)
                    @if columns.len() >= WIDE { span.sideways { (columns.len()) " columns: scroll the table sideways." } }
                }
                div.scroll role="group" aria-label=(caption) tabindex="0" {
                    table {
                        thead { tr { @for name in columns { th scope="col" { (name) } } } }
                        tbody { @for row in rows { tr { @for cell in row { td { (cell) } } } } }
                    }
                }
            }
        }
    }
}
