//! Numbers in few characters.

/// A number in few characters: `0.5`, `200k`, `3M`.
pub(super) fn number(value: f64) -> String {
    match value.abs() {
        size if size >= 1e6 => short(value / 1e6, 3) + "M",
        size if size >= 1e4 => short(value / 1e3, 3) + "k",
        _ => short(value, 3),
    }
}

/// A number with so many decimals at most, without zeros at its end.
pub fn short(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_string() } else { text }
}
