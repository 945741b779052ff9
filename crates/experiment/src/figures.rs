//! Drawings made of a figure's description and the table of results.

use std::collections::{BTreeMap, BTreeSet};

use etude_perform::stats::sorted;
use etude_show::figure::{Drawing, Mark, Point, Series};
use etude_stage::PhysicalParams;

use crate::config::{Experiment, FigureConfig, FigureKind, Published};
use crate::outcome::ResultRow;
use crate::results::{by_song, combinations, summary};

/// Names of measures: in files, in figures and tables, along an axis; and the unit there.
const MEASURES: [(&str, &str, &str, &str); 16] = [
    ("f1", "F1, twin", "F1", "0 to 1"),
    ("precision", "precision, twin", "precision", "0 to 1"),
    ("recall", "recall, twin", "recall", "0 to 1"),
    ("onset_f1", "F1 of onsets, twin", "F1 of onsets", "0 to 1"),
    ("onset_f1_without_lag", "F1 of onsets without lag, twin", "F1 of onsets", "0 to 1"),
    ("sim_f1", "F1, simulation", "F1", "0 to 1"),
    ("sim_precision", "precision, simulation", "precision", "0 to 1"),
    ("sim_recall", "recall, simulation", "recall", "0 to 1"),
    ("sim_onset_f1", "F1 of onsets, simulation", "F1 of onsets", "0 to 1"),
    ("gap", "gap", "gap", "0 to 1"),
    ("complete", "complete", "share of complete runs", "0 to 1"),
    ("lag_secs", "lag, twin", "lag", "s"),
    ("latency_compensation_secs", "latency compensation, twin", "latency compensation", "s"),
    ("held_out_before", "held-out error before, rad", "held-out error", "rad"),
    ("held_out_after", "held-out error after, rad", "held-out error", "rad"),
    ("rms", "rms", "residuals", "standard deviations of the noise"),
];

/// The name of a measure in figures and tables.
pub(crate) fn measure_name(measure: &str) -> String {
    let known = MEASURES.iter().find(|known| known.0 == measure);
    known.map_or_else(|| measure.replace('_', " "), |known| known.1.to_string())
}

/// What measures are along an axis, with their unit.
fn measure_label(measures: &[String]) -> String {
    let (mut names, mut units): (Vec<String>, Vec<&str>) = Default::default();
    for measure in measures {
        let known = MEASURES.iter().find(|known| known.0 == measure);
        let (name, unit) =
            known.map_or_else(|| (measure.replace('_', " "), ""), |known| (known.2.to_string(), known.3));
        if !names.contains(&name) {
            names.push(name);
        }
        if !units.contains(&unit) {
            units.push(unit);
        }
    }
    match units.as_slice() {
        [unit] if !unit.is_empty() => format!("{} ({unit})", names.join(", ")),
        _ => names.join(", "),
    }
}

/// The measure that a figure shows as `measure`: in the curve of a training F1 is that in
/// simulation.
fn shown<'a>(figure: &FigureConfig, measure: &'a str) -> &'a str {
    if figure.kind == FigureKind::Curves && measure == "f1" { "sim_f1" } else { measure }
}

/// What the horizontal axis is, with its unit.
fn axis_label(x: &str, experiment: &Experiment) -> String {
    let grid = || experiment.grid.keys().find(|path| path.rsplit('.').next() == Some(x));
    let physical = || {
        let path = grid()?.strip_prefix("task.physics.")?;
        Some(PhysicalParams::rows().find(|(row, _, _)| row == path)?.1.unit)
    };
    match (x, physical()) {
        ("step", _) => "control steps of the training".to_string(),
        ("secs", _) => "time of the training (s)".to_string(),
        ("replays", _) => "replays of the recordings".to_string(),
        (_, Some(unit)) if !unit.is_empty() => format!("{} ({unit})", x.replace('_', " ")),
        _ => x.replace('_', " "),
    }
}

/// The paper's values of what a figure shows as `measure` with these labels: at positions along the
/// axis, or across a figure of curves.
fn marks(
    experiment: &Experiment,
    figure: &FigureConfig,
    labels: &BTreeMap<String, String>,
    measure: &str,
    groups: &[String],
) -> Vec<Mark> {
    let is_curve = figure.kind == FigureKind::Curves;
    let measure = shown(figure, measure);
    let mut fixed: BTreeMap<String, String> =
        figure.filter.iter().chain(labels).map(|(key, value)| (key.clone(), value.clone())).collect();
    // A number in simulation holds for every twin.
    if measure.starts_with("sim_") {
        fixed.remove("twin_params");
    }
    let of_measure = experiment.paper.iter().filter(|published| published.measure == measure);
    let mark = |published: &Published| {
        let mut rest = published.filter.clone();
        let label = rest.remove(&figure.x);
        let x = match (is_curve, label) {
            (true, None) => None,
            (false, Some(label)) => Some(position_of(&label, groups)?),
            _ => return None,
        };
        (rest == fixed).then_some(Mark { x, y: published.value })
    };
    of_measure.filter_map(mark).collect()
}

/// The position of a label along the axis: its index among `groups`, or the number that it is.
fn position_of(label: &str, groups: &[String]) -> Option<f64> {
    match groups.iter().position(|group| group == label) {
        Some(index) => Some(index as f64),
        None if groups.is_empty() => label.parse().ok(),
        None => None,
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
    format!("{what}. {twin}")
}

/// The drawing of a figure.
pub(crate) fn drawing(experiment: &Experiment, figure: &FigureConfig, all: &[ResultRow]) -> Drawing {
    let chosen: Vec<ResultRow> = all.iter().filter(|row| row.has(&figure.filter)).cloned().collect();
    let keys: Vec<String> = figure.by.iter().cloned().collect();
    let compared = combinations(&chosen, &keys);
    let several = compared.len() > 1;
    let mut groups = Vec::new();
    if figure.kind == FigureKind::Bars {
        let values = combinations(&chosen, std::slice::from_ref(&figure.x));
        groups = values.into_iter().filter_map(|labels| labels.get(&figure.x).cloned()).collect();
    }
    let mut series = Vec::new();
    for labels in &compared {
        for measure in &figure.y {
            let who: Vec<String> = labels.values().cloned().collect();
            let name = match (several, figure.y.len()) {
                (true, 1) => who.join(", "),
                (true, _) => format!("{}, {}", who.join(", "), measure_name(shown(figure, measure))),
                (false, _) => measure_name(shown(figure, measure)),
            };
            let of_series: Vec<ResultRow> =
                chosen.iter().filter(|record| record.has(labels)).cloned().collect();
            let points = match figure.kind {
                FigureKind::Curves => curve(&of_series, &figure.x, measure),
                FigureKind::Bars | FigureKind::Lines => by_label(&of_series, &figure.x, measure, &groups),
            };
            let marks = marks(experiment, figure, labels, measure, &groups);
            series.push(Series { name, points, marks });
        }
    }
    Drawing {
        title: figure.title.clone(),
        x_label: axis_label(&figure.x, experiment),
        y_label: measure_label(&figure.y),
        groups,
        markers: figure.kind == FigureKind::Lines,
        series,
        marks: "the paper".to_string(),
    }
}

/// A measure against a number that grows during a trial: at each value at which every training was
/// evaluated. If these differ: at fifty equal distances, each training with its last evaluation
/// before.
fn curve(all: &[ResultRow], x: &str, measure: &str) -> Vec<Point> {
    let key = |record: &ResultRow| {
        ["song", "seed"].map(|label| record.labels.get(label).cloned().unwrap_or_default())
    };
    let mut trainings: BTreeMap<[String; 2], Vec<(f64, f64)>> = BTreeMap::new();
    for record in all {
        if let (Some(at), Some(value)) = (record.values.get(x), record.values.get(measure)) {
            trainings.entry(key(record)).or_default().push((*at, *value));
        }
    }
    let evaluated: BTreeSet<u64> = trainings.values().flatten().map(|(at, _)| at.to_bits()).collect();
    let most = trainings.values().map(Vec::len).max().unwrap_or(0);
    let end = trainings.values().flatten().fold(0.0f64, |end, (at, _)| end.max(*at));
    let positions: Vec<f64> = if evaluated.len() <= most {
        sorted(evaluated.into_iter().map(f64::from_bits))
    } else {
        (1..=50).map(|part| end * f64::from(part) / 50.0).collect()
    };
    let at_position = |position: f64| {
        // After its end a training keeps its last value.
        let last = |points: &[(f64, f64)]| Some(points.iter().rev().find(|(at, _)| *at <= position)?.1);
        let scores = trainings.iter().filter_map(|([song, _], points)| Some((song.as_str(), last(points)?)));
        let found = by_song(scores).filter(|found| found.count == trainings.len())?;
        Some(Point { x: position, y: found.mean.value, interval: found.mean.interval })
    };
    positions.into_iter().filter_map(at_position).collect()
}

/// A measure for each value of a label, at its position.
fn by_label(all: &[ResultRow], x: &str, measure: &str, groups: &[String]) -> Vec<Point> {
    let values = combinations(all, &[x.to_string()]);
    let mut points: Vec<Point> = values
        .iter()
        .filter_map(|labels| {
            let value = labels.get(x)?;
            let position = position_of(value, groups)?;
            let found = summary(all, labels, measure)?;
            Some(Point { x: position, y: found.mean.value, interval: found.mean.interval })
        })
        .collect();
    points.sort_by(|a, b| a.x.total_cmp(&b.x));
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(labels: &[(&str, &str)], values: &[(&str, f64)]) -> ResultRow {
        ResultRow {
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

    /// The rows of an experiment that has this figure.
    fn drawn(name: &str, figure: &str, all: &[ResultRow]) -> Drawing {
        let experiment = Experiment::load(name).unwrap();
        let figure = experiment.figures.iter().find(|known| known.name == figure).unwrap();
        drawing(&experiment, figure, all)
    }

    #[test]
    fn the_papers_values_stand_beside_ours() {
        let of = |variant: &str| {
            let labels = [("variant", variant), ("twin_params", "standard"), ("seed", "0")];
            record(&labels, &[("sim_f1", 0.97), ("gap", 0.05)])
        };
        let bars = drawn("fences", "gap", &[of("fences"), of("no fences")]);
        let marks = |name: &str| {
            let series = bars.series.iter().find(|series| series.name == name).unwrap();
            series.marks.iter().map(|mark| (mark.x.unwrap(), mark.y)).collect::<Vec<_>>()
        };
        assert_eq!(marks("F1, simulation"), [(0.0, 0.946), (1.0, 0.946)]);
        assert_eq!(marks("gap"), [(0.0, 0.068), (1.0, 0.112)]);

        let points = [record(&[("variant", "fences"), ("seed", "0")], &[("step", 5e3), ("f1", 0.2)])];
        let curves = drawn("fences", "training", &points);
        assert_eq!(curves.series[0].marks, [Mark { x: None, y: 0.946 }]);

        let played = |twin_params: &str, f1: f64| {
            record(&[("intensity", "0.6"), ("twin_params", twin_params), ("seed", "0")], &[("f1", f1)])
        };
        let lines = drawn("randomisation", "twin", &[played("standard", 0.8), played("worn", 0.6)]);
        let of_f1 = lines.series.iter().find(|series| series.name == "F1, twin").unwrap();
        assert_eq!(of_f1.marks, [Mark { x: Some(0.6), y: 0.52 }]);
        // The paper has no number of this mode alone.
        let modes = drawn(
            "iterations",
            "f1",
            &[record(&[("mode", "hybrid"), ("iteration", "2"), ("seed", "0")], &[("f1", 0.8)])],
        );
        assert_eq!(modes.series[0].marks, []);
    }

    #[test]
    fn every_axis_is_named_and_has_its_unit() {
        for name in crate::config::names() {
            let experiment = Experiment::load(name).unwrap();
            for figure in &experiment.figures {
                let drawing = drawing(&experiment, figure, &[]);
                assert!(
                    !drawing.x_label.is_empty() && !drawing.y_label.is_empty(),
                    "{name}, {}",
                    figure.name
                );
            }
        }
        let mut experiment = Experiment::load("randomisation").unwrap();
        experiment.grid = [("task.physics.joint.rail.acceleration_limit".to_string(), Vec::new())].into();
        assert_eq!(axis_label("acceleration_limit", &experiment), "acceleration limit (m/s²)");
        assert_eq!(axis_label("secs", &experiment), "time of the training (s)");
        let label =
            |measures: &[&str]| measure_label(&measures.iter().map(ToString::to_string).collect::<Vec<_>>());
        assert_eq!(label(&["sim_f1", "f1", "gap"]), "F1, gap (0 to 1)");
        assert_eq!(label(&["held_out_before", "held_out_after"]), "held-out error (rad)");
    }
}
