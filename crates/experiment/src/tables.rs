//! The tables of a report, as HTML.

use std::collections::{BTreeMap, BTreeSet};

use etude_perform::shell_word;
use etude_perform::stats::{quantile, sorted};
use etude_show::html::table;
use maud::{Markup, html};

use crate::config::{Experiment, FigureKind};
use crate::figures::measure_name;
use crate::outcome::ResultRow;
use crate::results::{DoneTrial, combinations, compared, paired, summary, time_to};
use crate::stats::{Interval, Summary};
use crate::trial_plan::ExperimentConfig;

/// F1 whose times are reported.
const F1_LEVELS: [f64; 3] = [0.80, 0.90, 0.946];

fn formatted(interval: &Interval) -> String {
    // Errors of joints are thousandths of a radian.
    let digits = if interval.value != 0.0 && interval.value.abs() < 0.02 { 5 } else { 3 };
    match interval.interval {
        Some([low, high]) => format!("{:.digits$} [{low:.digits$},\u{a0}{high:.digits$}]", interval.value),
        None => format!("{:.digits$}", interval.value),
    }
}

fn label_text(labels: &BTreeMap<String, String>) -> String {
    // In a narrow table a line ends between two labels.
    let word = |(key, value): (&String, &String)| format!("{key} {value}").replace(' ', "\u{a0}");
    let words: Vec<String> = labels.iter().map(word).collect();
    if words.is_empty() { "all".to_string() } else { words.join(", ") }
}

fn strings(texts: &[&str]) -> Vec<String> {
    texts.iter().map(ToString::to_string).collect()
}

/// The paper's numbers and ours.
pub(crate) fn against_the_paper(experiment: &Experiment, all: &[ResultRow]) -> Markup {
    let rows = experiment.paper.iter().map(|published| {
        let found = summary(all, &published.filter, &published.measure);
        let [ours, difference] = match found {
            Some(found) => [formatted(&found.mean), format!("{:+.3}", found.mean.value - published.value)],
            None => ["–", "–"].map(str::to_string),
        };
        let measure = measure_name(&published.measure);
        vec![label_text(&published.filter), measure, format!("{:.3}", published.value), ours, difference]
    });
    table("The paper’s numbers and ours", &["what", "measure", "paper", "Étude", "difference"], rows)
}

/// Measures that the figures show, without duplicates.
fn measures(experiment: &Experiment) -> Vec<String> {
    let shown = experiment.figures.iter().filter(|figure| figure.kind != FigureKind::Curves);
    let mut seen = BTreeSet::new();
    let measures: Vec<String> =
        shown.flat_map(|figure| figure.y.clone()).filter(|measure| seen.insert(measure.clone())).collect();
    // Where curves alone are shown, what they come to is compared.
    if measures.is_empty() { strings(&["sim_f1"]) } else { measures }
}

/// Means and interquartile means of what is compared, pooled and by song.
pub(crate) fn scores(experiment: &Experiment, all: &[ResultRow]) -> Markup {
    let measures = measures(experiment);
    let counted = if experiment.play.is_some() { "pieces × seeds" } else { "trainings" };
    let mut columns = strings(&["what", counted]);
    for measure in &measures {
        let name = measure_name(measure);
        columns.extend([format!("{name}: mean"), format!("{name}: IQM")]);
    }
    let line = |labels: &BTreeMap<String, String>| {
        let found: Vec<Option<Summary>> =
            measures.iter().map(|measure| summary(all, labels, measure)).collect();
        let count = found.iter().flatten().map(|found| found.count).max().unwrap_or(0);
        let mut row = vec![label_text(labels), count.to_string()];
        for found in found {
            row.extend(match found {
                Some(found) => [formatted(&found.mean), formatted(&found.interquartile_mean)],
                None => ["–".to_string(), "–".to_string()],
            });
        }
        row
    };
    let keys = compared(all);
    let pooled = combinations(all, &keys);
    let with_songs = combinations(all, &[keys, vec!["song".to_string()]].concat());
    html! {
        (table("Over all songs", &columns, pooled.iter().map(&line)))
        @if with_songs.len() > pooled.len() { (table("By song", &columns, with_songs.iter().map(&line))) }
    }
}

/// What is compared, against the same with the first value of one of its labels, training by
/// training.
pub(crate) fn differences(experiment: &Experiment, all: &[ResultRow]) -> Markup {
    let keys = compared(all);
    let pooled = combinations(all, &keys);
    let measures = measures(experiment);
    let mut rows = Vec::new();
    for labels in &pooled {
        for key in &keys {
            let first = pooled.first().and_then(|labels| labels.get(key));
            let (Some(mine), Some(first)) = (labels.get(key), first) else { continue };
            let mut base = labels.clone();
            base.insert(key.clone(), first.clone());
            if mine == first || !pooled.contains(&base) {
                continue;
            }
            let found: Vec<Option<Summary>> =
                measures.iter().map(|measure| paired(all, labels, &base, measure)).collect();
            // Other songs are no pairs.
            if found.iter().all(Option::is_none) {
                continue;
            }
            let cells = found
                .iter()
                .map(|found| found.as_ref().map_or_else(|| "–".to_string(), |found| formatted(&found.mean)));
            rows.push([label_text(labels), label_text(&base)].into_iter().chain(cells).collect::<Vec<_>>());
        }
    }
    let mut columns = strings(&["what", "against"]);
    columns.extend(measures.iter().map(|measure| measure_name(measure)));
    table("How much more: mean of paired differences (same song, same seed)", &columns, rows)
}

/// When the trainings reached an F1.
pub(crate) fn times(experiment: &Experiment, entries: &[DoneTrial]) -> Markup {
    // Players that are ready have no curve.
    let learned = |entry: &&DoneTrial| entry.result.curve.iter().any(|point| point.contains_key("f1"));
    let trials: Vec<ResultRow> = entries
        .iter()
        .filter(learned)
        .map(|entry| ResultRow { labels: entry.trial.labels.clone(), values: BTreeMap::new() })
        .collect();
    if trials.is_empty() {
        return html! {};
    }
    let median = |values: Vec<f64>| {
        let values = sorted(values.into_iter().filter(|value| value.is_finite()));
        (!values.is_empty()).then(|| quantile(&values, 0.5))
    };
    let rows = combinations(&trials, &compared(&trials)).into_iter().map(|labels| {
        let mut row = vec![label_text(&labels)];
        for level in F1_LEVELS {
            let (reached, of) = time_to(entries, &labels, "f1", level);
            let steps = median(reached.iter().map(|(step, _)| *step).collect());
            let secs = median(reached.iter().map(|(_, secs)| *secs).collect());
            row.push(match (steps, secs) {
                (Some(steps), Some(secs)) => {
                    format!("{} of {of}, {steps:.0} steps, {secs:.0} s", reached.len())
                }
                (Some(steps), None) => format!("{} of {of}, {steps:.0} steps", reached.len()),
                _ => format!("0 of {of}"),
            });
        }
        row
    });
    let mut columns = strings(&["what"]);
    columns.extend(F1_LEVELS.map(|level| format!("F1 {level}")));
    let caption =
        "Trainings that reached an F1 in simulation, and the median step and second at which they did";
    // Learners have presets of their own.
    let preset =
        if experiment.play.is_some() { String::new() } else { format!(" (preset {})", experiment.preset) };
    table(&format!("{caption}{preset}"), &columns, rows)
}

/// Says how many performances a fault has ended, if any: their scores are low for another reason.
pub(crate) fn interrupted(all: &[ResultRow]) -> Markup {
    let ends: Vec<f64> = all.iter().filter_map(|record| record.values.get("complete")).copied().collect();
    let short = ends.iter().filter(|complete| **complete < 1.0).count();
    html! {
        @if short > 0 {
            p {
                (short) " of " (ends.len())
                " performances were ended by a fault of the twin; what was not played counts as silence."
            }
        }
    }
}

/// What it was made of.
pub(crate) fn provenance(
    experiment: &Experiment,
    (config, planned): (&ExperimentConfig, usize),
    entries: &[DoneTrial],
) -> Markup {
    let distinct = |of: &dyn Fn(&DoneTrial) -> String| {
        let all: BTreeSet<String> = entries.iter().map(of).collect();
        all.into_iter().collect::<Vec<_>>().join(", ")
    };
    // A trial may stand in several lines.
    let secs: BTreeMap<&str, f64> =
        entries.iter().map(|entry| (entry.trial.id.as_str(), entry.times.secs)).collect();
    let hours = secs.values().sum::<f64>() / 3600.0;
    let rows = entries.iter().map(|entry| {
        vec![entry.trial.id.clone(), label_text(&entry.trial.labels), format!("{:.0}", entry.times.secs)]
    });
    html! {
        p {
            (entries.len()) " of " (planned) " trials, " (format!("{hours:.1}")) " hours of learning or fitting; Étude "
            (distinct(&|entry| entry.times.etude.clone())) ", MuJoCo " (distinct(&|entry| entry.times.mujoco.clone())) "; "
            (distinct(&|entry| entry.times.cores.to_string())) " cores of "
            (distinct(&|entry| entry.times.machine.clone())) ". "
            code { "etude experiment run " (shell_word(&experiment.asked)) (config.flags()) }
        }
        details {
            summary { "The trials" }
            (table("Trials", &["trial", "what", "seconds"], rows))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_numbers_keep_their_digits() {
        assert_eq!(formatted(&Interval { value: 0.001_674, interval: None }), "0.00167");
        assert_eq!(
            formatted(&Interval { value: 0.95, interval: Some([0.9, 1.0]) }),
            "0.950 [0.900,\u{a0}1.000]"
        );
    }
}
