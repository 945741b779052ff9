//! Names that are spelled like a mistyped one.

const MAX_SUGGESTIONS: usize = 3;

/// Those of `names` that are spelled like `word`, best first.
pub fn similar_names<'a>(word: &str, names: impl IntoIterator<Item = &'a str>) -> Vec<&'a str> {
    let plain: String = word.to_lowercase().replace([' ', '_'], "-").chars().take(64).collect();
    let mut close: Vec<(usize, &str)> = names
        .into_iter()
        .filter_map(|name| {
            let compared = name.replace('_', "-");
            let part = plain.len() > 2 && (compared.contains(&plain) || plain.contains(&compared));
            let edits = if part { 0 } else { strsim::osa_distance(&plain, &compared) };
            // A third of the letters wrong is a typing error, more is another word.
            (edits * 3 <= name.len()).then_some((edits, name))
        })
        .collect();
    close.sort();
    close.dedup();
    close.into_iter().take(MAX_SUGGESTIONS).map(|(_, name)| name).collect()
}

/// ` (did you mean x, y?)` with the names like `word`; empty without any.
pub fn did_you_mean<'a>(word: &str, names: impl IntoIterator<Item = &'a str>) -> String {
    match similar_names(word, names).join(", ") {
        close if close.is_empty() => close,
        close => format!(" (did you mean {close}?)"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_that_are_swapped_missing_or_too_many_are_typing_errors() {
        let names = ["train", "play", "key.threshold", "num_envs"];
        for (word, meant) in
            [("trian", "train"), ("paly", "play"), ("key.treshold", "key.threshold"), ("numenvs", "num_envs")]
        {
            assert_eq!(similar_names(word, names), [meant]);
        }
        assert_eq!(did_you_mean("sing", names), "");
        assert_eq!(did_you_mean("Trains", names), " (did you mean train?)");
    }
}
