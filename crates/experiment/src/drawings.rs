//! Drawings made of a figure's description and the table of results.

use std::collections::{BTreeMap, BTreeSet};

use etude_perform::stats::sorted;

use crate::config::{Experiment, FigureConfig, FigureKind};
use crate::figure::{Drawing, Point, Series};
use crate::outcome::Row;
use crate::record::{by_song, combinations, summary};

/// The name of a measure in figures and tables.
pub(crate) fn measure_name(measure: &str, in_course: bool) -> String {
    match measure {
        "f1" if in_course => "F1, simulation".to_string(),
        "f1" => "F1, twin".to_string(),
        "precision" => "precision, twin".to_string(),
        "recall" => "recall, twin".to_string(),
        "sim_f1" => "F1, simulation".to_string(),
        "sim_precision" => "precision, simulation".to_string(),
        "sim_recall" => "recall, simulation".to_string(),
        "onset_f1" => "F1 of onsets, twin".to_string(),
        "onset_f1_without_lag" => "F1 of onsets without lag, twin".to_string(),
        "sim_onset_f1" => "F1 of onsets, simulation".to_string(),
        "held_out_before" => "held-out error before, rad".to_string(),
        "held_out_after" => "held-out error after, rad".to_string(),
        other => other.replace('_', " "),
    }
}

/// The text below a figure.
pub(crate) fn caption(figure: &FigureConfig, experiment: &Experiment) -> String {
    let what = match figure.kind {
        FigureKind::Curves | FigureKind::Lines => "Mean over songs and seeds; the band is its 95 % interval",
        FigureKind::Bars => "Mean over songs and seeds, with its 95 % interval",
    };
    let of_training = figure.kind == FigureKind::Curves && experiment.identify.is_none();
    let twin = if of_training || figure.y.iter().all(|y| y.starts_with("sim_")) {
        "In simulation."
    } else {
        "On the twin, which stands in for the robot, where not said otherwise."
    };
    format!("{}. {what}. {twin}", figure.title)
}

/// The drawing of a figure.
pub(crate) fn drawing(figure: &FigureConfig, all: &[Row]) -> Drawing {
    let in_course = figure.kind == FigureKind::Curves;
    let chosen: Vec<Row> = all.iter().filter(|record| record.has(&figure.filter)).cloned().collect();
    let keys: Vec<String> = figure.by.iter().cloned().collect();
    let told_apart = combinations(&chosen, &keys);
    let several = told_apart.len() > 1;
    let mut groups = Vec::new();
    if figure.kind == FigureKind::Bars {
        let values = combinations(&chosen, std::slice::from_ref(&figure.x));
        groups = values.into_iter().filter_map(|labels| labels.get(&figure.x).cloned()).collect();
    }
    let mut series = Vec::new();
    for labels in &told_apart {
        for measure in &figure.y {
            let who: Vec<String> = labels.values().cloned().collect();
            let name = match (several, figure.y.len()) {
                (true, 1) => who.join(", "),
                (true, _) => format!("{}, {}", who.join(", "), measure_name(measure, in_course)),
                (false, _) => measure_name(measure, in_course),
            };
            let of_series: Vec<Row> = chosen.iter().filter(|record| record.has(labels)).cloned().collect();
            let points = match figure.kind {
                FigureKind::Curves => curve(&of_series, &figure.x, measure),
                FigureKind::Bars | FigureKind::Lines => by_label(&of_series, &figure.x, measure, &groups),
            };
            series.push(Series { name, points });
        }
    }
    let y_label = match figure.y.as_slice() {
        [only] => measure_name(only, in_course),
        _ => String::new(),
    };
    Drawing {
        title: figure.title.clone(),
        x_label: if groups.is_empty() { figure.x.clone() } else { String::new() },
        y_label,
        groups,
        markers: figure.kind == FigureKind::Lines,
        series,
    }
}

/// A measure against a number of the course: at each value at which every training was evaluated. If they were evaluated at different
/// values: at fifty equal distances, each training with its last evaluation before.
fn curve(all: &[Row], x: &str, measure: &str) -> Vec<Point> {
    let key =
        |record: &Row| ["song", "seed"].map(|label| record.labels.get(label).cloned().unwrap_or_default());
    let mut trainings: BTreeMap<[String; 2], Vec<(f64, f64)>> = BTreeMap::new();
    for record in all {
        if let (Some(at), Some(value)) = (record.values.get(x), record.values.get(measure)) {
            trainings.entry(key(record)).or_default().push((*at, *value));
        }
    }
    let looks: BTreeSet<u64> = trainings.values().flatten().map(|(at, _)| at.to_bits()).collect();
    let most = trainings.values().map(Vec::len).max().unwrap_or(0);
    let end = trainings.values().flatten().fold(0.0f64, |end, (at, _)| end.max(*at));
    let places: Vec<f64> = if looks.len() <= most {
        sorted(looks.into_iter().map(f64::from_bits))
    } else {
        (1..=50).map(|part| end * f64::from(part) / 50.0).collect()
    };
    let at_place = |place: f64| {
        // After its end a training keeps its last value.
        let last = |points: &[(f64, f64)]| Some(points.iter().rev().find(|(at, _)| *at <= place)?.1);
        let scores = trainings.iter().filter_map(|([song, _], points)| Some((song.as_str(), last(points)?)));
        let found = by_song(scores).filter(|found| found.count == trainings.len())?;
        Some(Point { x: place, y: found.mean.value, interval: found.mean.interval })
    };
    places.into_iter().filter_map(at_place).collect()
}

/// A measure for each value of a label: its place among `groups`, or the number that it is.
fn by_label(all: &[Row], x: &str, measure: &str, groups: &[String]) -> Vec<Point> {
    let values = combinations(all, &[x.to_string()]);
    let mut points: Vec<Point> = values
        .iter()
        .filter_map(|labels| {
            let value = labels.get(x)?;
            let place = match groups.iter().position(|group| group == value) {
                Some(place) => place as f64,
                None => value.parse().ok()?,
            };
            let found = summary(all, labels, measure)?;
            Some(Point { x: place, y: found.mean.value, interval: found.mean.interval })
        })
        .collect();
    points.sort_by(|a, b| a.x.total_cmp(&b.x));
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(labels: &[(&str, &str)], values: &[(&str, f64)]) -> Row {
        Row {
            labels: labels.iter().map(|(key, value)| (key.to_string(), value.to_string())).collect(),
            values: values.iter().map(|(key, value)| (key.to_string(), *value)).collect(),
        }
    }

    #[test]
    fn a_curve_is_a_mean_where_every_training_has_been_and_one_that_is_over_stays() {
        let point = |seed: &str, step: f64, f1: f64| {
            record(&[("song", "x"), ("seed", seed)], &[("step", step), ("f1", f1)])
        };
        let same =
            [point("0", 10.0, 0.2), point("0", 20.0, 0.4), point("1", 10.0, 0.4), point("1", 20.0, 0.6)];
        let found: Vec<(f64, f64)> =
            curve(&same, "step", "f1").iter().map(|point| (point.x, point.y)).collect();
        assert_eq!(found.iter().map(|(x, _)| *x).collect::<Vec<_>>(), [10.0, 20.0]);
        assert!((found[0].1 - 0.3).abs() < 1e-12 && (found[1].1 - 0.5).abs() < 1e-12);
        // One is evaluated at other steps and ends earlier.
        let other = [point("0", 10.0, 0.2), point("1", 3.0, 0.4), point("1", 100.0, 0.8)];
        let found = curve(&other, "step", "f1");
        assert!(found.first().unwrap().x >= 10.0);
        assert!((found.last().unwrap().y - 0.5).abs() < 1e-12);
    }

    #[test]
    fn lines_stand_at_their_numbers_and_bars_at_their_groups() {
        let all = [
            record(&[("intensity", "0.5"), ("seed", "0")], &[("f1", 0.5)]),
            record(&[("intensity", "0"), ("seed", "0")], &[("f1", 0.9)]),
        ];
        let xs = |points: Vec<Point>| points.iter().map(|point| point.x).collect::<Vec<_>>();
        assert_eq!(xs(by_label(&all, "intensity", "f1", &[])), [0.0, 0.5]);
        assert_eq!(xs(by_label(&all, "intensity", "f1", &["0.5", "0"].map(String::from))), [0.0, 1.0]);
    }
}
