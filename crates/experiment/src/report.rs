//! The report of experiments: one page with figures, the paper's numbers beside ours, and
//! everything that it was made of.
//!
//! ```text
//! OUT/index.html              the page; it needs nothing else
//! OUT/NAME/results.jsonl      the result of each trial, from which the report can be made again
//! OUT/NAME/results.csv        one row a performance, iteration or fit
//! OUT/NAME/curves.csv         one row an evaluation
//! OUT/NAME/FIGURE.svg         the figures
//! OUT/NAME/notes.md           our notes, written by hand; the page shows them as they are
//! ```

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use etude_lab::make_folder;
use etude_perform::{shell_word, write_file};
use etude_show::html::page;
use maud::{Markup, PreEscaped, html};

use crate::config::{Experiment, FigureConfig, FigureKind};
use crate::figures::{caption, drawing};
use crate::results::{DoneTrial, curves, records, to_csv};
use crate::tables::{against_the_paper, differences, interrupted, provenance, scores, times};
use crate::trial::Trial;
use crate::trial_plan::ExperimentConfig;

/// Name of the page.
const PAGE: &str = "index.html";
const RESULTS: &str = "results.jsonl";
const NOTES: &str = "notes.md";

/// A report that was written.
#[derive(Clone, Debug)]
pub struct ReportPage {
    /// The page.
    pub file: PathBuf,
    /// What is not done: a line an experiment.
    pub missing: Vec<String>,
}

/// Writes the report of experiments, planned by `config`, into `out`, from what is done among
/// `runs` and from what a report in `out` has already.
///
/// # Errors
/// If nothing is done, or a file cannot be read or written.
pub fn write_report(
    plans: &[(Experiment, Vec<Trial>)],
    config: &ExperimentConfig,
    runs: &Path,
    out: &Path,
) -> anyhow::Result<ReportPage> {
    let mut sections = Vec::new();
    let mut missing = Vec::new();
    for (experiment, trials) in plans {
        let folder = out.join(&experiment.name);
        let (entries, others) = gather(trials, runs, &folder.join(RESULTS))?;
        if entries.len() < trials.len() {
            let left = trials.len() - entries.len();
            missing.push(format!("{}: {left} of {} trials are not done", experiment.name, trials.len()));
        }
        if entries.is_empty() {
            continue;
        }
        make_folder(&folder)?;
        let lines = entries.iter().chain(&others).map(|entry| Ok(serde_json::to_string(entry)? + "\n"));
        write_file(&folder.join(RESULTS), &lines.collect::<serde_json::Result<String>>()?)?;
        sections.push(section(experiment, (config, trials.len()), &entries, &folder)?);
    }
    if sections.is_empty() {
        let names: Vec<String> = plans.iter().map(|(experiment, _)| shell_word(&experiment.asked)).collect();
        bail!(
            "none of the trials is done; `etude experiment run {}{}` does them. If they were run with --seeds, --budget or --set, give \
             the same here",
            names.join(" "),
            config.flags()
        );
    }
    let file = out.join(PAGE);
    let body = html! {
        p {
            "The paper’s experiments, made again by " code { "etude experiment run NAME" } ". "
            strong { "There is no robot here: wherever the paper plays on its robot, the twin plays" }
            ", emulated devices moved by a separate world whose parameters are hidden from the simulator. Intervals are 95 % bootstrap \
             intervals over trainings, resampled within each song; IQM is the interquartile mean. The gap is the paper’s: the share \
             of the F1 in simulation that is lost, 1 − F1 on the twin / F1 in simulation."
        }
        @for section in &sections { (section) }
    };
    write_file(&file, &page("Étude’s experiments", &body))?;
    Ok(ReportPage { file, missing })
}

/// What is done of a plan, in its order; and what the report has of other plans.
fn gather(trials: &[Trial], runs: &Path, stored: &Path) -> anyhow::Result<(Vec<DoneTrial>, Vec<DoneTrial>)> {
    let mut before: BTreeMap<String, DoneTrial> = BTreeMap::new();
    let text = match std::fs::read_to_string(stored) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
        text => {
            text.with_context(|| format!("cannot read {}; choose another folder with -o", stored.display()))?
        }
    };
    for (index, line) in text.lines().enumerate() {
        let entry: DoneTrial = serde_json::from_str(line).with_context(|| {
            let line = index + 1;
            format!("line {line} of {} is damaged; choose another folder with -o", stored.display())
        })?;
        before.insert(entry.trial.id.clone(), entry);
    }
    let of_trial = |trial: &Trial| {
        let reported =
            || before.get(&trial.id).map(|entry| DoneTrial { trial: trial.clone(), ..entry.clone() });
        DoneTrial::load(trial, runs).or_else(reported)
    };
    let found = trials.iter().filter_map(of_trial).collect();
    trials.iter().for_each(|trial| drop(before.remove(&trial.id)));
    Ok((found, before.into_values().collect()))
}

/// The section of an experiment. Writes its files beside the page.
fn section(
    experiment: &Experiment,
    (config, planned): (&ExperimentConfig, usize),
    entries: &[DoneTrial],
    folder: &Path,
) -> anyhow::Result<Markup> {
    let (all, points) = (records(entries), curves(entries));
    write_file(&folder.join("results.csv"), &to_csv(&all)?)?;
    if !points.is_empty() {
        write_file(&folder.join("curves.csv"), &to_csv(&points)?)?;
    }
    let notes = std::fs::read_to_string(folder.join(NOTES)).unwrap_or_default();
    let figure = |figure: &FigureConfig| {
        let drawing =
            drawing(experiment, figure, if figure.kind == FigureKind::Curves { &points } else { &all });
        if drawing.series.iter().all(|series| series.points.is_empty()) {
            return Ok(html! { p { (figure.title) ": nothing done has these labels and measures." } });
        }
        write_file(&folder.join(format!("{}.svg", figure.name)), &drawing.svg()?)?;
        Ok(html! { figure { (PreEscaped(drawing.inline()?)) figcaption { (caption(figure, experiment)) } } })
    };
    let figures = experiment.figures.iter().map(figure).collect::<anyhow::Result<Vec<Markup>>>()?;
    Ok(html! {
        section id=(experiment.name) {
            h2 { (experiment.title) }
            p { (experiment.source) "." }
            @if !experiment.finding.is_empty() { h3 { "The paper" } p { (experiment.finding) } }
            @if !notes.trim().is_empty() { h3 { "Here" } pre { (notes.trim()) } }
            div.drawings { @for figure in &figures { (figure) } }
            (against_the_paper(experiment, &all))
            (scores(experiment, &all))
            (differences(experiment, &all))
            (times(experiment, entries))
            (interrupted(&all))
            (provenance(experiment, (config, planned), entries))
        }
    })
}
