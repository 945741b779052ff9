//! The figures of a run in words, for the full-screen view and for the plain table.

use etude_show::watch::{RunFigures, RunState};

use crate::status::clock;

/// Shown for a figure that is not known.
const UNKNOWN: &str = "-";

/// A number of steps in few characters: `200k`, `1.82M`.
pub fn count(steps: f64) -> String {
    let (value, unit) = match steps {
        steps if steps < 1e3 => return format!("{steps:.0}"),
        steps if steps < 999_950.0 => (steps / 1e3, "k"),
        steps => (steps / 1e6, "M"),
    };
    let decimals = if value < 10.0 { 2 } else { usize::from(value < 100.0) };
    let digits = format!("{value:.decimals$}");
    let short = if decimals > 0 { digits.trim_end_matches('0').trim_end_matches('.') } else { &digits };
    format!("{short}{unit}")
}

/// Steps made, and how many are to be made.
pub fn steps(run: &RunFigures) -> String {
    let total = run.total_steps.map_or("?".to_string(), |total| count(total as f64));
    format!("{}/{total}", count(run.step as f64))
}

/// Steps per second.
pub fn rate(run: &RunFigures) -> String {
    match run.steps_per_sec {
        None => UNKNOWN.to_string(),
        Some(rate) if rate < 10.0 => format!("{rate:.1}"),
        Some(rate) => format!("{rate:.0}"),
    }
}

/// Time left.
pub fn left(run: &RunFigures) -> String {
    run.secs_left.map_or(UNKNOWN.to_string(), clock)
}

/// A score.
pub fn score(f1: Option<f64>) -> String {
    f1.map_or(UNKNOWN.to_string(), |f1| format!("{f1:.3}"))
}

/// Notes right of notes due, and how many are wrong.
pub fn notes(run: &RunFigures) -> String {
    match (run.notes_right, run.notes_due, run.notes_wrong) {
        (Some(right), Some(due), Some(wrong)) => format!("{right}/{due} +{wrong}"),
        _ => UNKNOWN.to_string(),
    }
}

/// The state of the run, in one or two words.
pub fn state(run: &RunFigures) -> String {
    match run.state {
        RunState::Waiting => "waiting".to_string(),
        RunState::Running => "running".to_string(),
        RunState::Finished => "finished".to_string(),
        RunState::Silent => format!("silent {}", age(run)),
    }
}

/// The same in full.
pub fn long_state(run: &RunFigures) -> String {
    match run.state {
        RunState::Waiting => "waiting for the first log line".to_string(),
        RunState::Silent => format!("not written to for {}", age(run)),
        RunState::Running | RunState::Finished => state(run),
    }
}

fn age(run: &RunFigures) -> String {
    match run.secs_since_written.unwrap_or_default() as u64 / 60 {
        minutes if minutes < 100 => format!("{minutes} min"),
        minutes if minutes < 48 * 60 => format!("{} h", minutes / 60),
        minutes => format!("{} days", minutes / 60 / 24),
    }
}

/// `text` in at most `width` characters: names of trials begin alike and end in a fingerprint, so
/// the middle goes.
pub fn shortened(text: &str, width: usize) -> String {
    let characters: Vec<char> = text.chars().collect();
    if characters.len() <= width {
        return text.to_string();
    }
    let kept = width.saturating_sub(1);
    let end = kept / 3;
    let (begin, rest) = characters.split_at(kept - end);
    begin.iter().chain(['…'].iter().take(width)).chain(&rest[rest.len() - end..]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_short() {
        for (steps, expected) in [
            (0.0, "0"),
            (999.0, "999"),
            (2000.0, "2k"),
            (2500.0, "2.5k"),
            (12_345.0, "12.3k"),
            (200_000.0, "200k"),
            (999_999.0, "1M"),
            (1_824_000.0, "1.82M"),
            (30e6, "30M"),
        ] {
            assert_eq!(count(steps), expected);
        }
    }

    #[test]
    fn the_middle_of_a_long_name_goes() {
        assert_eq!(shortened("twinkle__fast__0", 16), "twinkle__fast__0");
        assert_eq!(shortened("train__twinkle__0__1a3bbb41cb118dfa", 16), "train__twi…18dfa");
        assert_eq!((shortened("abc", 1), shortened("abc", 0)), ("…".to_string(), String::new()));
    }
}
