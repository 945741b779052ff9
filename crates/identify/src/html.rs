//! An HTML page without scripts and external files, for the pages of other crates.

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
@media print{body{font-size:10pt;max-width:none;padding:0}.table{overflow:visible}
table{font-size:7.5pt}tr{break-inside:avoid}h2{break-after:avoid}
body{print-color-adjust:exact;-webkit-print-color-adjust:exact}}
";

/// A page: `title` is plain text, `body` is HTML.
pub fn page(title: &str, body: &str) -> String {
    let title = escape(title);
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
         <title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n\
         {body}</body>\n</html>\n"
    )
}

/// Escapes plain text for an element or a quoted attribute of HTML and XML.
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
            // XML and HTML cannot express these.
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}
