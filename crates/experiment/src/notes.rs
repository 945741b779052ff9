//! Notes in Markdown as part of a page.

use maud::{Markup, PreEscaped};
use pulldown_cmark::{Event, HeadingLevel, Options, Parser, Tag, TagEnd, html};

/// What a link may begin with, if it names a scheme at all.
const SCHEMES: [&str; 3] = ["https:", "http:", "mailto:"];

/// The notes as HTML. What is HTML in them is shown as text; their headings stand below those of
/// the page.
pub(crate) fn rendered(notes: &str) -> Markup {
    let options = Options::ENABLE_TABLES | Options::ENABLE_STRIKETHROUGH;
    let events = Parser::new_ext(notes, options).map(|event| match event {
        Event::Html(text) | Event::InlineHtml(text) => Event::Text(text),
        Event::Start(Tag::HtmlBlock) => Event::Start(Tag::Paragraph),
        Event::End(TagEnd::HtmlBlock) => Event::End(TagEnd::Paragraph),
        Event::Start(Tag::Heading { id, classes, attrs, .. }) => {
            Event::Start(Tag::Heading { level: HeadingLevel::H4, id, classes, attrs })
        }
        Event::End(TagEnd::Heading(_)) => Event::End(TagEnd::Heading(HeadingLevel::H4)),
        Event::Start(Tag::Link { link_type, dest_url, title, id }) => {
            let dest_url = if is_harmless(&dest_url) { dest_url } else { "".into() };
            Event::Start(Tag::Link { link_type, dest_url, title, id })
        }
        other => other,
    });
    let mut text = String::new();
    html::push_html(&mut text, events);
    PreEscaped(text)
}

fn is_harmless(address: &str) -> bool {
    let lower = address.to_ascii_lowercase();
    !address.contains(':') || SCHEMES.iter().any(|scheme| lower.starts_with(scheme))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markdown_becomes_html_and_html_becomes_text() {
        let notes = "# Setup\n\nPreset `fast`, **two** seeds: [notes](https://example.invalid/a).\n\n- one\n- two\n\n| a | b |\n|---|---|\n| 1 | 2 |\n";
        let page = rendered(notes).into_string();
        for part in [
            "<h4>Setup</h4>",
            "<code>fast</code>, <strong>two</strong>",
            "<a href=\"https://example.invalid/a\">notes</a>",
            "<li>one</li>",
            "<td>1</td>",
        ] {
            assert!(page.contains(part), "{part} is not in {page}");
        }
        let hostile = "a <img src=x onerror=alert(1)> b\n\n<script>alert(1)</script>\n\n[x](javascript:alert(1)) [y](JavaScript:alert(1)) ![z](javascript:alert(1))\n";
        let page = rendered(hostile).into_string();
        assert!(page.contains("&lt;img") && page.contains("&lt;script&gt;"), "{page}");
        assert!(!page.contains("<script") && !page.contains("<img src=x"), "{page}");
        assert!(!page.to_lowercase().contains("href=\"javascript"), "{page}");
    }
}
