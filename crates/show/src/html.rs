//! The shell of our HTML pages, and their tables. A page loads no other file.

use maud::{DOCTYPE, Markup, PreEscaped, Render, html};

const STYLE: &str = include_str!("page.css");

/// A page without scripts, with its title as heading.
pub fn page(title: &str, body: &Markup) -> String {
    document(title, None, STYLE, &html! { h1 { (title) } (body) })
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

/// A table; nothing without rows.
pub fn table(caption: &str, columns: &[impl Render], rows: impl IntoIterator<Item = Vec<String>>) -> Markup {
    let mut rows = rows.into_iter().peekable();
    html! {
        @if rows.peek().is_some() {
            div.table {
                table {
                    caption { (caption) }
                    thead { tr { @for name in columns { th { (name) } } } }
                    tbody { @for row in rows { tr { @for cell in row { td { (cell) } } } } }
                }
            }
        }
    }
}
