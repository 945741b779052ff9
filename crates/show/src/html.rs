//! The shell of our HTML pages, and their tables. A page loads no other file.

use maud::{DOCTYPE, Markup, PreEscaped, Render, html};

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
td+td{text-align:right;white-space:nowrap;font-variant-numeric:tabular-nums}
.pictures{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(30rem,100%),1fr));gap:1rem}
figure{margin:0;break-inside:avoid;overflow-x:auto}figcaption{font-size:.8rem;overflow-wrap:anywhere}
svg{width:100%;height:auto;font:11px system-ui,sans-serif}
@media print{body{font-size:10pt;max-width:none;padding:0}.table{overflow:visible}
table{font-size:7.5pt}tr{break-inside:avoid}h2{break-after:avoid}
body{print-color-adjust:exact;-webkit-print-color-adjust:exact}}
";

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
