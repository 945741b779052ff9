//! The report of experiments: one page with figures, the paper's numbers beside ours, and everything that it was made of.
//!
//! ```text
//! OUT/index.html              the page; it needs nothing else
//! OUT/NAME/results.jsonl      what came of each task: the report can be made again of this alone
//! OUT/NAME/results.csv        one row a performance, round or fit
//! OUT/NAME/course.csv         one row an evaluation on the way
//! OUT/NAME/FIGURE.svg, .png   the figures
//! OUT/NAME/notes.md           what we think of it; written by hand, taken into the page
//! ```

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use etude_identify::html::{escape, page};
use etude_perform::{FileError, write_text};

use super::config::{Experiment, FigureConfig, FigureKind};
use super::figure::{Drawing, FigureError, Point, Series};
use super::plan::{PlanConfig, Task};
use super::record::{Entry, Record, combinations, compared, courses, csv, paired, records, summary, time_to};
use super::stats::{Interval, Summary, quantile};

/// Name of the page.
const PAGE: &str = "index.html";
const RESULTS: &str = "results.jsonl";
const NOTES: &str = "notes.md";
/// F1 whose times are reported.
const MARKS: [f64; 3] = [0.80, 0.90, 0.946];

/// What a report lacks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Missing {
    /// The experiment.
    pub experiment: String,
    /// Tasks that are not done.
    pub tasks: usize,
    /// Of how many.
    pub of: usize,
}

/// A report that was written.
#[derive(Clone, Debug)]
pub struct ReportPage {
    /// The page.
    pub file: PathBuf,
    /// What is not done.
    pub missing: Vec<Missing>,
}

/// A report could not be written.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A file.
    #[error(transparent)]
    Write(#[from] FileError),
    /// A figure.
    #[error(transparent)]
    Figure(#[from] FigureError),
    /// A folder.
    #[error("cannot use {path}: {why}; choose another folder with -o")]
    Folder {
        /// The folder or file.
        path: PathBuf,
        /// Why.
        why: String,
    },
    /// Nothing to tell.
    #[error("none of the tasks is done; `etude experiment run {0}` does them")]
    Nothing(String),
}

/// Writes the report of experiments, planned by `config`, into `out`, from what is done among `runs`, and from what an earlier report in
/// `out` has kept.
///
/// # Errors
/// If nothing is done, or a file cannot be read or written.
pub fn write_report(
    plans: &[(Experiment, Vec<Task>)],
    config: &PlanConfig,
    runs: &Path,
    out: &Path,
) -> Result<ReportPage, ReportError> {
    let mut body = String::new();
    let mut missing = Vec::new();
    let mut told = 0;
    for (experiment, tasks) in plans {
        let folder = out.join(&experiment.name);
        let (entries, others) = gather(tasks, runs, &folder.join(RESULTS))?;
        if entries.len() < tasks.len() {
            let (tasks, of) = (tasks.len() - entries.len(), tasks.len());
            missing.push(Missing { experiment: experiment.name.clone(), tasks, of });
        }
        if entries.is_empty() {
            continue;
        }
        told += 1;
        let fail =
            |error: std::io::Error| ReportError::Folder { path: folder.clone(), why: error.to_string() };
        std::fs::create_dir_all(&folder).map_err(fail)?;
        // Plain numbers and strings: writing them as JSON cannot fail.
        let lines = entries
            .iter()
            .chain(&others)
            .map(|entry| serde_json::to_string(entry).unwrap_or_default() + "\n");
        write_text(&folder.join(RESULTS), &lines.collect::<String>())?;
        section(&mut body, experiment, (config, tasks.len()), &entries, &folder)?;
    }
    if told == 0 {
        let names: Vec<&str> = plans.iter().map(|(experiment, _)| experiment.name.as_str()).collect();
        return Err(ReportError::Nothing(names.join(" ")));
    }
    let file = out.join(PAGE);
    let opening = "<p>The paper’s experiments, made again by <code>etude experiment run NAME</code>. <strong>There is no robot here: \
        wherever the paper plays on its robot, the twin plays</strong>, emulated devices moved by a separate world with its own \
        truth. Intervals are 95 % bootstrap intervals over trainings, drawn anew within each song; IQM is the interquartile mean. \
        The gap is the paper’s: what of the F1 in simulation is lost, 1 − F1 on the twin / F1 in simulation.</p>\n";
    write_text(&file, &page("Étude’s experiments", &(opening.to_string() + &body)))?;
    Ok(ReportPage { file, missing })
}

/// What is done of a plan, in its order; and what an earlier report has kept of other plans.
fn gather(tasks: &[Task], runs: &Path, kept: &Path) -> Result<(Vec<Entry>, Vec<Entry>), ReportError> {
    let mut before: BTreeMap<String, Entry> = BTreeMap::new();
    if let Ok(text) = std::fs::read_to_string(kept) {
        for (index, line) in text.lines().enumerate() {
            let entry: Entry = serde_json::from_str(line).map_err(|error| ReportError::Folder {
                path: kept.to_path_buf(),
                why: format!("line {} is damaged: {error}", index + 1),
            })?;
            before.insert(entry.task.id.clone(), entry);
        }
    }
    let of_task = |task: &Task| {
        let kept = || before.get(&task.id).map(|entry| Entry { task: task.clone(), ..entry.clone() });
        Entry::load(task, runs).or_else(kept)
    };
    let found = tasks.iter().filter_map(of_task).collect();
    tasks.iter().for_each(|task| drop(before.remove(&task.id)));
    Ok((found, before.into_values().collect()))
}

fn section(
    body: &mut String,
    experiment: &Experiment,
    (config, planned): (&PlanConfig, usize),
    entries: &[Entry],
    folder: &Path,
) -> Result<(), ReportError> {
    let (all, course) = (records(entries), courses(entries));
    write_text(&folder.join("results.csv"), &csv(&all))?;
    if !course.is_empty() {
        write_text(&folder.join("course.csv"), &csv(&course))?;
    }
    // Writing to a string cannot fail, here and below.
    let _ = writeln!(
        body,
        "<section id=\"{}\">\n<h2>{}</h2>\n<p>{}.</p>",
        escape(&experiment.name),
        escape(&experiment.title),
        escape(&experiment.source)
    );
    if !experiment.finding.is_empty() {
        let _ = writeln!(body, "<p><strong>The paper:</strong> {}</p>", escape(&experiment.finding));
    }
    if let Ok(notes) = std::fs::read_to_string(folder.join(NOTES)) {
        for (index, paragraph) in notes.split("\n\n").filter(|text| !text.trim().is_empty()).enumerate() {
            let lead = if index == 0 { "<strong>Here:</strong> " } else { "" };
            let _ = writeln!(
                body,
                "<p>{lead}{}</p>",
                escape(&paragraph.split_whitespace().collect::<Vec<_>>().join(" "))
            );
        }
    }
    body.push_str("<div class=\"pictures\">\n");
    for figure in &experiment.figures {
        let drawing = drawing(figure, if figure.kind == FigureKind::Curves { &course } else { &all });
        if drawing.series.iter().all(|series| series.points.is_empty()) {
            let _ = writeln!(
                body,
                "<p>{}: nothing done has these labels and measures.</p>",
                escape(&figure.title)
            );
            continue;
        }
        let svg = drawing.svg()?;
        write_text(&folder.join(format!("{}.svg", figure.name)), &svg)?;
        drawing.write_png(&folder.join(format!("{}.png", figure.name)))?;
        let _ = writeln!(
            body,
            "<figure>{svg}<figcaption>{}</figcaption></figure>",
            escape(&caption(figure, experiment))
        );
    }
    body.push_str("</div>\n");
    against_the_paper(body, experiment, &all);
    scores(body, experiment, &all);
    differences(body, experiment, &all);
    times(body, experiment, entries);
    cut_short(body, &all);
    provenance(body, experiment, (config, planned), entries);
    body.push_str("</section>\n");
    Ok(())
}

/// What a measure is called.
fn measure_name(measure: &str, in_course: bool) -> String {
    match measure {
        "f1" if in_course => "F1, simulation".to_string(),
        "f1" => "F1, twin".to_string(),
        "precision" => "precision, twin".to_string(),
        "recall" => "recall, twin".to_string(),
        "sim_f1" => "F1, simulation".to_string(),
        "sim_precision" => "precision, simulation".to_string(),
        "sim_recall" => "recall, simulation".to_string(),
        "held_out_before" => "held-out error before, rad".to_string(),
        "held_out_after" => "held-out error after, rad".to_string(),
        other => other.replace('_', " "),
    }
}

fn caption(figure: &FigureConfig, experiment: &Experiment) -> String {
    let what = match figure.kind {
        FigureKind::Curves => "Mean over songs and seeds; the band is its 95 % interval",
        FigureKind::Bars => "Mean over songs and seeds, with its 95 % interval",
        FigureKind::Lines => "Mean over songs and seeds; the band is its 95 % interval",
    };
    let of_training = figure.kind == FigureKind::Curves && experiment.identify.is_none();
    let twin = if of_training || figure.y.iter().all(|y| y.starts_with("sim_")) {
        "In simulation."
    } else {
        "On the twin, which stands in for the robot, where not said otherwise."
    };
    format!("{}. {what}. {twin}", figure.title)
}

fn drawing(figure: &FigureConfig, all: &[Record]) -> Drawing {
    let in_course = figure.kind == FigureKind::Curves;
    let chosen: Vec<Record> = all.iter().filter(|record| record.has(&figure.filter)).cloned().collect();
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
            let of_series: Vec<Record> = chosen.iter().filter(|record| record.has(labels)).cloned().collect();
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

/// A measure against a number of the course: at each value that every training has reached, or, where they look at different
/// times, in fifty parts of the whole, each training by its last look.
fn curve(all: &[Record], x: &str, measure: &str) -> Vec<Point> {
    let key =
        |record: &Record| ["song", "seed"].map(|label| record.labels.get(label).cloned().unwrap_or_default());
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
        let mut places: Vec<f64> = looks.into_iter().map(f64::from_bits).collect();
        places.sort_by(f64::total_cmp);
        places
    } else {
        (1..=50).map(|part| end * f64::from(part) / 50.0).collect()
    };
    let at_place = |place: f64| {
        let mut songs: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
        for ([song, _], points) in &trainings {
            // A training that is over stays where it ended.
            if let Some((_, value)) = points.iter().rev().find(|(at, _)| *at <= place) {
                songs.entry(song).or_default().push(*value);
            }
        }
        let strata: Vec<Vec<f64>> = songs.into_values().collect();
        let whole = strata.iter().map(Vec::len).sum::<usize>() == trainings.len();
        let found = Summary::new(&strata).filter(|_| whole)?;
        Some(Point { x: place, y: found.mean.value, interval: found.mean.interval })
    };
    places.into_iter().filter_map(at_place).collect()
}

/// A measure for each value of a label: its place among `groups`, or the number that it is.
fn by_label(all: &[Record], x: &str, measure: &str, groups: &[String]) -> Vec<Point> {
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

fn told(interval: &Interval) -> String {
    // Errors of joints are thousandths of a radian.
    let digits = if interval.value != 0.0 && interval.value.abs() < 0.02 { 5 } else { 3 };
    match interval.interval {
        Some([low, high]) => format!("{:.digits$} [{low:.digits$}, {high:.digits$}]", interval.value),
        None => format!("{:.digits$}", interval.value),
    }
}

fn words(labels: &BTreeMap<String, String>) -> String {
    let words: Vec<String> = labels.iter().map(|(key, value)| format!("{key} {value}")).collect();
    if words.is_empty() { "all".to_string() } else { words.join(", ") }
}

fn table(body: &mut String, caption: &str, columns: &[String], rows: impl Iterator<Item = Vec<String>>) {
    let _ = write!(body, "<div class=\"table\"><table><caption>{}</caption>\n<tr>", escape(caption));
    for column in columns {
        let _ = write!(body, "<th>{}</th>", escape(column));
    }
    body.push_str("</tr>\n");
    for row in rows {
        body.push_str("<tr>");
        for (index, cell) in row.iter().enumerate() {
            let class = if index == 0 { "" } else { " class=\"n\"" };
            let _ = write!(body, "<td{class}>{}</td>", escape(cell));
        }
        body.push_str("</tr>\n");
    }
    body.push_str("</table></div>\n");
}

fn strings(texts: &[&str]) -> Vec<String> {
    texts.iter().map(ToString::to_string).collect()
}

fn against_the_paper(body: &mut String, experiment: &Experiment, all: &[Record]) {
    let rows = experiment.paper.iter().map(|published| {
        let found = summary(all, &published.filter, &published.measure);
        let [ours, difference] = match found {
            Some(found) => [told(&found.mean), format!("{:+.3}", found.mean.value - published.value)],
            None => ["–", "–"].map(str::to_string),
        };
        let measure = measure_name(&published.measure, false);
        vec![words(&published.filter), measure, format!("{:.3}", published.value), ours, difference]
    });
    let rows: Vec<Vec<String>> = rows.collect();
    if !rows.is_empty() {
        let columns = strings(&["what", "measure", "paper", "Étude", "difference"]);
        table(body, "The paper’s numbers and ours", &columns, rows.into_iter());
    }
}

/// Measures that the figures show, each once.
fn measures(experiment: &Experiment) -> Vec<String> {
    let shown = experiment.figures.iter().filter(|figure| figure.kind != FigureKind::Curves);
    let mut seen = BTreeSet::new();
    shown.flat_map(|figure| figure.y.clone()).filter(|measure| seen.insert(measure.clone())).collect()
}

fn scores(body: &mut String, experiment: &Experiment, all: &[Record]) {
    let measures = measures(experiment);
    let mut columns = strings(&["what", "trainings"]);
    for measure in &measures {
        let name = measure_name(measure, false);
        columns.extend([format!("{name}: mean"), format!("{name}: IQM")]);
    }
    let line = |labels: &BTreeMap<String, String>| {
        let found: Vec<Option<Summary>> =
            measures.iter().map(|measure| summary(all, labels, measure)).collect();
        let count = found.iter().flatten().map(|found| found.count).max().unwrap_or(0);
        let mut row = vec![words(labels), count.to_string()];
        for found in found {
            row.extend(match found {
                Some(found) => [told(&found.mean), told(&found.interquartile_mean)],
                None => ["–".to_string(), "–".to_string()],
            });
        }
        row
    };
    let keys = compared(all);
    let pooled = combinations(all, &keys);
    table(body, "Over all songs", &columns, pooled.iter().map(&line));
    let with_songs = combinations(all, &[keys, vec!["song".to_string()]].concat());
    if with_songs.len() > pooled.len() {
        table(body, "By song", &columns, with_songs.iter().map(&line));
    }
}

/// What is compared, against the same with the first value of one of its labels, training by training.
fn differences(body: &mut String, experiment: &Experiment, all: &[Record]) {
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
            let found = measures.iter().map(|measure| paired(all, labels, &base, measure));
            let cells = found.map(|found| found.map_or_else(|| "–".to_string(), |found| told(&found.mean)));
            rows.push([words(labels), words(&base)].into_iter().chain(cells).collect::<Vec<_>>());
        }
    }
    if rows.is_empty() {
        return;
    }
    let mut columns = strings(&["what", "against"]);
    columns.extend(measures.iter().map(|measure| measure_name(measure, false)));
    table(
        body,
        "How much more: mean of paired differences (same song, same seed)",
        &columns,
        rows.into_iter(),
    );
}

fn times(body: &mut String, experiment: &Experiment, entries: &[Entry]) {
    if entries.iter().all(|entry| entry.result.course.iter().all(|point| !point.contains_key("f1"))) {
        return;
    }
    let tasks: Vec<Record> = entries
        .iter()
        .map(|entry| Record { labels: entry.task.labels.clone(), values: BTreeMap::new() })
        .collect();
    let median = |mut values: Vec<f64>| {
        values.retain(|value| value.is_finite());
        values.sort_by(f64::total_cmp);
        (!values.is_empty()).then(|| quantile(&values, 0.5))
    };
    let rows = combinations(&tasks, &compared(&tasks)).into_iter().map(|labels| {
        let mut row = vec![words(&labels)];
        for mark in MARKS {
            let (reached, of) = time_to(entries, &labels, "f1", mark);
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
    let rows: Vec<Vec<String>> = rows.collect();
    let mut columns = strings(&["what"]);
    columns.extend(MARKS.map(|mark| format!("F1 {mark}")));
    let caption = format!(
        "Trainings that reached an F1 in simulation, and the median step and second at which they did (preset {})",
        experiment.preset
    );
    table(body, &caption, &columns, rows.into_iter());
}

/// Says how many performances a fault has ended, if any: their scores are low for another reason.
fn cut_short(body: &mut String, all: &[Record]) {
    let ends: Vec<f64> = all.iter().filter_map(|record| record.values.get("complete")).copied().collect();
    let short = ends.iter().filter(|complete| **complete < 1.0).count();
    if short > 0 {
        let _ = writeln!(
            body,
            "<p>{short} of {} performances were ended by a fault of the twin; what was not played counts as silence.</p>",
            ends.len()
        );
    }
}

fn provenance(
    body: &mut String,
    experiment: &Experiment,
    (config, planned): (&PlanConfig, usize),
    entries: &[Entry],
) {
    let distinct = |of: &dyn Fn(&Entry) -> String| {
        let all: BTreeSet<String> = entries.iter().map(of).collect();
        all.into_iter().collect::<Vec<_>>().join(", ")
    };
    let hours = entries.iter().map(|entry| entry.times.secs).sum::<f64>() / 3600.0;
    let _ = writeln!(
        body,
        "<p>{} of {planned} tasks, {hours:.1} hours of learning or fitting; Étude {}, MuJoCo {}; {} cores of {}. \
         <code>etude experiment run {}{}</code></p>",
        entries.len(),
        escape(&distinct(&|entry| entry.times.etude.clone())),
        escape(&distinct(&|entry| entry.times.mujoco.clone())),
        escape(&distinct(&|entry| entry.times.cores.to_string())),
        escape(&distinct(&|entry| entry.times.machine.clone())),
        escape(&experiment.name),
        escape(&config.flags())
    );
    let mut columns = strings(&["task"]);
    columns.extend(strings(&["what", "seconds"]));
    body.push_str("<details><summary>The tasks</summary>\n");
    let rows = entries.iter().map(|entry| {
        vec![entry.task.id.clone(), words(&entry.task.labels), format!("{:.0}", entry.times.secs)]
    });
    table(body, "Tasks", &columns, rows);
    body.push_str("</details>\n");
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(labels: &[(&str, &str)], values: &[(&str, f64)]) -> Record {
        Record {
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
        // One looks at other times and ends earlier.
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
        assert_eq!(xs(by_label(&all, "intensity", "f1", &strings(&["0.5", "0"]))), [0.0, 1.0]);
    }

    #[test]
    fn small_numbers_keep_their_digits() {
        assert_eq!(told(&Interval { value: 0.001_674, interval: None }), "0.00167");
        assert_eq!(told(&Interval { value: 0.95, interval: Some([0.9, 1.0]) }), "0.950 [0.900, 1.000]");
    }
}
