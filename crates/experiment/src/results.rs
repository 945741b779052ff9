//! The results as one table: a row is one performance, iteration or fit, with its labels and
//! measures.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use etude_perform::stats::mean;
use serde::{Deserialize, Serialize};

use etude_show::figure::short;

use crate::outcome::{RESULT, ResultRow, TIMES, TrialResult, TrialTimes};
use crate::stats::Summary;
use crate::trial::Trial;

/// A trial that is done, and its result: one line of `results.jsonl`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DoneTrial {
    /// The trial.
    pub trial: Trial,
    /// Its result.
    pub result: TrialResult,
    /// When, where and how long.
    pub times: TrialTimes,
}

impl DoneTrial {
    /// The entry of `trial` in the folder `runs`; `None` while it is not done.
    pub fn load(trial: &Trial, runs: &Path) -> Option<Self> {
        let folder = runs.join(&trial.id);
        let read = |name: &str| std::fs::read(folder.join(name)).ok();
        let result = serde_json::from_slice(&read(RESULT)?).ok()?;
        let times = read(TIMES).and_then(|bytes| serde_json::from_slice(&bytes).ok()).unwrap_or_default();
        Some(Self { trial: trial.clone(), result, times })
    }
}

/// The rows of all entries.
pub fn records(entries: &[DoneTrial]) -> Vec<ResultRow> {
    let of_entry = |entry: &DoneTrial| {
        let trial = entry.trial.labels.clone();
        let rows = entry.result.rows.clone().into_iter();
        rows.map(move |row| {
            let mut labels = trial.clone();
            labels.extend(row.labels);
            ResultRow { labels, values: row.values }
        })
        .collect::<Vec<_>>()
    };
    entries.iter().flat_map(of_entry).collect()
}

/// The points of all curves, with `secs` where they are known.
pub fn curves(entries: &[DoneTrial]) -> Vec<ResultRow> {
    let of_entry = |entry: &DoneTrial| {
        let points = entry.result.curve.iter().enumerate();
        points
            .map(|(index, point)| {
                let mut values = point.clone();
                values.extend(entry.times.curve_secs.get(index).map(|secs| ("secs".to_string(), *secs)));
                ResultRow { labels: entry.trial.labels.clone(), values }
            })
            .collect::<Vec<_>>()
    };
    entries.iter().flat_map(of_entry).collect()
}

/// Labels of repetitions.
pub const REPETITIONS: [&str; 3] = ["song", "seed", "run"];

/// The labels that are compared, in the order of their names.
pub fn compared(records: &[ResultRow]) -> Vec<String> {
    let keys: BTreeSet<&String> = records.iter().flat_map(|record| record.labels.keys()).collect();
    keys.into_iter().filter(|key| !REPETITIONS.contains(&key.as_str())).cloned().collect()
}

/// The different values of some labels, in the order in which they come.
pub fn combinations(records: &[ResultRow], keys: &[String]) -> Vec<BTreeMap<String, String>> {
    let mut seen = BTreeSet::new();
    let of = |record: &ResultRow| -> BTreeMap<String, String> {
        keys.iter().filter_map(|key| Some((key.clone(), record.labels.get(key)?.clone()))).collect()
    };
    records.iter().map(of).filter(|labels| seen.insert(labels.clone())).collect()
}

/// A measure of each training that has these labels, by song and seed. The runs of one training are
/// not independent: their mean is one score.
fn trainings<'a>(
    records: &'a [ResultRow],
    filter: &BTreeMap<String, String>,
    measure: &str,
) -> BTreeMap<(&'a str, &'a str), f64> {
    let mut runs: BTreeMap<(&str, &str), Vec<f64>> = BTreeMap::new();
    for record in records.iter().filter(|record| record.has(filter)) {
        let label = |key: &str| record.labels.get(key).map_or("", String::as_str);
        if let Some(value) = record.values.get(measure) {
            runs.entry((label("song"), label("seed"))).or_default().push(*value);
        }
    }
    runs.into_iter().map(|(training, runs)| (training, mean(&runs))).collect()
}

/// Scores of trainings in short, a stratum a song.
pub fn by_song<'a>(scores: impl Iterator<Item = (&'a str, f64)>) -> Option<Summary> {
    let mut songs: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for (song, score) in scores {
        songs.entry(song).or_default().push(score);
    }
    Summary::new(&songs.into_values().collect::<Vec<_>>())
}

/// A measure of those records that have these labels.
pub fn summary(records: &[ResultRow], filter: &BTreeMap<String, String>, measure: &str) -> Option<Summary> {
    by_song(trainings(records, filter, measure).into_iter().map(|((song, _), score)| (song, score)))
}

/// How much a measure of one thing is above that of another, training by training: those of the
/// same song and seed.
pub fn paired(
    records: &[ResultRow],
    one: &BTreeMap<String, String>,
    other: &BTreeMap<String, String>,
    measure: &str,
) -> Option<Summary> {
    let others = trainings(records, other, measure);
    let ones = trainings(records, one, measure).into_iter();
    by_song(ones.filter_map(|(training, score)| Some((training.0, score - others.get(&training)?))))
}

/// When each training first had a score: step, and seconds where they are known; and how many
/// trainings there are.
pub fn time_to(
    entries: &[DoneTrial],
    filter: &BTreeMap<String, String>,
    measure: &str,
    score: f64,
) -> (Vec<(f64, f64)>, usize) {
    let has =
        |entry: &&DoneTrial| filter.iter().all(|(key, value)| entry.trial.labels.get(key) == Some(value));
    let of_entry = |entry: &DoneTrial| {
        let first =
            entry.result.curve.iter().position(|point| point.get(measure).is_some_and(|at| *at >= score))?;
        let step = entry.result.curve[first].get("step").copied()?;
        Some((step, entry.times.curve_secs.get(first).copied().unwrap_or(f64::NAN)))
    };
    let chosen: Vec<&DoneTrial> = entries.iter().filter(has).collect();
    (chosen.iter().filter_map(|entry| of_entry(entry)).collect(), chosen.len())
}

/// A table as CSV: labels, then measures.
pub fn to_csv(rows: &[ResultRow]) -> anyhow::Result<String> {
    let labels: BTreeSet<&String> = rows.iter().flat_map(|row| row.labels.keys()).collect();
    let values: BTreeSet<&String> = rows.iter().flat_map(|row| row.values.keys()).collect();
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(labels.iter().chain(&values))?;
    for row in rows {
        let of_labels = labels.iter().map(|key| row.labels.get(*key).cloned().unwrap_or_default());
        // Six digits are enough for a score of control steps; the number itself is in
        // `results.jsonl`.
        let of_values =
            values.iter().map(|key| row.values.get(*key).map_or_else(String::new, |value| short(*value, 6)));
        writer.write_record(of_labels.chain(of_values))?;
    }
    Ok(String::from_utf8(writer.into_inner()?)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(labels: &[(&str, &str)], f1: f64) -> ResultRow {
        let labels = labels.iter().map(|(key, value)| (key.to_string(), value.to_string())).collect();
        ResultRow { labels, values: BTreeMap::from([("f1".to_string(), f1)]) }
    }

    fn table() -> Vec<ResultRow> {
        let mut all = Vec::new();
        for (variant, more) in [("a", 0.0), ("b", 0.1)] {
            for (song, level) in [("x", 0.4), ("y", 0.8)] {
                for seed in ["0", "1"] {
                    for run in ["0", "1"] {
                        let drift: f64 = if seed == "1" { 0.02 } else { 0.0 };
                        let f1 = level + more + drift + if run == "1" { 0.01 } else { -0.01 };
                        all.push(record(
                            &[("variant", variant), ("song", song), ("seed", seed), ("run", run)],
                            f1,
                        ));
                    }
                }
            }
        }
        all
    }

    #[test]
    fn runs_of_one_training_are_one_score() {
        let all = table();
        let filter = BTreeMap::from([("variant".to_string(), "a".to_string())]);
        let found = summary(&all, &filter, "f1").unwrap();
        assert_eq!(found.count, 4);
        assert!((found.mean.value - 0.61).abs() < 1e-12);
        assert_eq!(compared(&all), ["variant"]);
        assert_eq!(combinations(&all, &compared(&all)).len(), 2);
    }

    #[test]
    fn differences_are_taken_training_by_training() {
        let all = table();
        let is = |name: &str| BTreeMap::from([("variant".to_string(), name.to_string())]);
        let found = paired(&all, &is("b"), &is("a"), "f1").unwrap();
        // The songs differ by 0.4, the variants by 0.1 in each.
        assert!((found.mean.value - 0.1).abs() < 1e-12);
        let [low, high] = found.mean.interval.unwrap();
        assert!(high - low < 1e-9);
    }

    #[test]
    fn tables_are_csv_whatever_the_labels() {
        let text = to_csv(&[record(&[("variant", "a, \"b\"")], 0.25)]).unwrap();
        assert_eq!(text, "variant,f1\n\"a, \"\"b\"\"\",0.25\n");
    }
}
