//! The page of `etude serve`: its program and styles, from `viewer/`. What it shows it asks of the
//! server.

use maud::{PreEscaped, html};

use crate::html::document;

/// The program of the page, built by `npm run build` in `viewer/`.
const SCRIPT: &str = include_str!("../../../viewer/dist/work.js");
const STYLE: &str = include_str!("../../../viewer/dist/work.css");
/// The content security policy: only this script and these styles, and only what this server
/// serves.
const POLICY: &str = include_str!("../../../viewer/dist/work-csp.txt");

/// The page, and its Content-Security-Policy.
pub fn work_page() -> (String, &'static str) {
    let body = html! {
        noscript { "This page needs JavaScript, which is part of it; it loads nothing from elsewhere." }
        div id="work" {}
        script { (PreEscaped(SCRIPT)) }
    };
    (document("Étude", Some(POLICY.trim()), STYLE, &body), POLICY.trim())
}
