//! The report as one page that needs nothing else: no scripts, no network, readable on a phone and in print.

use super::document::{Document, Element, Picture, Table};

/// Looks of a page and of the drawings in it. The colours of curves are those of Okabe and Ito, which
/// colour-blind readers tell apart; in print the strokes differ too.
const STYLE: &str = "
body{font:16px/1.5 system-ui,sans-serif;color:#111;background:#fff;
max-width:70rem;margin:0 auto;padding:0 1rem 3rem}
h1{font-size:1.6rem;line-height:1.2}h2{margin-top:2.5rem;border-bottom:1px solid #999;font-size:1.25rem}
p,li{max-width:48rem;overflow-wrap:anywhere}
.table{overflow-x:auto;margin:1rem 0}
table{border-collapse:collapse;font-size:.85rem}
caption{text-align:left;padding:.3rem 0;font-weight:600}
th,td{padding:.15rem .6rem .15rem 0;text-align:left;vertical-align:top;border-bottom:1px solid #ddd}
th{border-bottom:1px solid #555}
.n{text-align:right;white-space:nowrap;font-variant-numeric:tabular-nums}
.pictures{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(30rem,100%),1fr));gap:1rem}
figure{margin:0;break-inside:avoid;overflow-x:auto}figcaption{font-size:.8rem;overflow-wrap:anywhere}
svg{width:100%;height:auto;font:11px system-ui,sans-serif}
.axis{stroke:#999;stroke-width:1;fill:none}.grid{stroke:#e4e4e4;stroke-width:1;fill:none}
.measured{stroke:#bbb;stroke-width:5;fill:none;stroke-linejoin:round}
.before{stroke:#d55e00;stroke-width:1.4;fill:none;stroke-dasharray:6 4}
.after{stroke:#0072b2;stroke-width:1.4;fill:none}
.band{fill:#e4e4e4}.plus{fill:#0072b2}.minus{fill:#fff;stroke:#d55e00;stroke-width:1.2}
@media print{body{font-size:10pt;max-width:none;padding:0}.table{overflow:visible}
table{font-size:7.5pt}tr{break-inside:avoid}h2{break-after:avoid}
body{print-color-adjust:exact;-webkit-print-color-adjust:exact}}
";

/// The document as a page.
pub(super) fn html(document: &Document) -> String {
    let sections: String = document
        .sections
        .iter()
        .map(|section| {
            let elements: String = section.elements.iter().map(element).collect();
            format!("<section>\n<h2>{}</h2>\n{elements}</section>\n", escape(section.title))
        })
        .collect();
    page(&document.title, &sections)
}

/// A page that needs nothing else: `title` is plain text, `body` is HTML.
pub fn page(title: &str, body: &str) -> String {
    let title = escape(title);
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
         <title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n\
         {body}</body>\n</html>\n"
    )
}

fn element(element: &Element) -> String {
    match element {
        Element::Paragraph(words) => format!("<p>{}</p>\n", escape(words)),
        Element::List(items) => {
            let items: String = items.iter().map(|item| format!("<li>{}</li>\n", escape(item))).collect();
            format!("<ul>\n{items}</ul>\n")
        }
        Element::Table(table) => self::table(table),
        Element::Pictures(pictures) => {
            let figure = |picture: &Picture| {
                format!(
                    "<figure>{}<figcaption>{}</figcaption></figure>\n",
                    picture.svg,
                    escape(&picture.caption)
                )
            };
            format!("<div class=\"pictures\">\n{}</div>\n", pictures.iter().map(figure).collect::<String>())
        }
    }
}

fn table(table: &Table) -> String {
    let cell = |tag: &str, is_number: bool, words: &str| {
        let class = if is_number { " class=\"n\"" } else { "" };
        format!("<{tag}{class}>{}</{tag}>", escape(words))
    };
    let heads: String =
        table.columns.iter().map(|column| cell("th", column.is_number, column.name)).collect();
    let rows: String = table
        .rows
        .iter()
        .map(|row| {
            let cells =
                row.iter().zip(&table.columns).map(|(words, column)| cell("td", column.is_number, words));
            format!("<tr>{}</tr>\n", cells.collect::<String>())
        })
        .collect();
    format!(
        "<div class=\"table\"><table>\n<caption>{}</caption>\n<thead><tr>{heads}</tr></thead>\n\
         <tbody>\n{rows}</tbody>\n</table></div>\n",
        escape(&table.caption)
    )
}

/// Plain text as it may stand in an element or a quoted attribute of HTML and XML.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\n' | '\t' => out.push(c),
            // Neither XML nor HTML has a way to write these.
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}
