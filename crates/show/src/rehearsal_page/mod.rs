//! The page of a rehearsal: notes right and the gap by iteration, the performances to see and to
//! hear, what was learned on the robot itself, and the simulator's parameters.

mod adaptation;
mod parameters;
mod performance;

use std::path::Path;

use anyhow::Context as _;
use etude_lab::{Adapted, Iteration, Prediction, RehearsalConfig, RobotScores, best_iteration};
use etude_perform::write_file;
use maud::{Markup, PreEscaped, html};

use adaptation::Adaptation;
use parameters::parameters;
use performance::{Performance, performance, see_and_hear};

use crate::figure::{Drawing, Mark, Point, Series};
use crate::html::{page, table};

/// Name of the page in the folder of its rehearsal.
pub const REHEARSAL_PAGE: &str = "rehearsal.html";

/// The page of a rehearsal, written again after each iteration, with a replay page beside each
/// recording.
pub struct RehearsalPage<'a> {
    config: &'a RehearsalConfig,
    folder: &'a Path,
    iterations: Vec<IterationResult>,
    adaptation: Option<Adaptation>,
    written: anyhow::Result<()>,
}

/// An iteration and its performances.
struct IterationResult {
    iteration: Iteration,
    performances: Vec<Performance>,
}

impl<'a> RehearsalPage<'a> {
    /// The page of a rehearsal in `folder`, not yet written.
    pub fn new(config: &'a RehearsalConfig, folder: &'a Path) -> Self {
        Self { config, folder, iterations: Vec::new(), adaptation: None, written: Ok(()) }
    }

    /// Adds an iteration, writes its replay pages, and writes the page.
    pub fn add(&mut self, iteration: &Iteration) {
        self.then(|page| {
            let shown = iteration.recordings.iter().map(|path| performance(path, page.folder));
            let performances = shown.collect::<anyhow::Result<Vec<_>>>()?;
            page.iterations.push(IterationResult { iteration: iteration.clone(), performances });
            Ok(())
        });
    }

    /// Adds what was learned on the robot itself after the iterations, writes its replay pages, and
    /// writes the page.
    pub fn add_adapted(&mut self, adapted: &Adapted) {
        self.then(|page| {
            page.adaptation = Some(Adaptation::new(adapted, page.folder, page.config.runs)?);
            Ok(())
        });
    }

    /// Does something and writes the page, unless that has failed before.
    fn then(&mut self, act: impl FnOnce(&mut Self) -> anyhow::Result<()>) {
        if self.written.is_ok() {
            self.written = act(self).and_then(|()| {
                let page = rehearsal_page(self.config, &self.iterations, self.adaptation.as_ref())?;
                Ok(write_file(&self.folder.join(REHEARSAL_PAGE), &page)?)
            });
        }
    }

    /// The page, if it has been written each time.
    ///
    /// # Errors
    /// If it could not be written.
    pub fn checked(mut self) -> anyhow::Result<Self> {
        std::mem::replace(&mut self.written, Ok(())).context("the page of the rehearsal is not complete")?;
        Ok(self)
    }
}

/// The page of the iterations so far.
fn rehearsal_page(
    config: &RehearsalConfig,
    iterations: &[IterationResult],
    adaptation: Option<&Adaptation>,
) -> anyhow::Result<String> {
    let results: Vec<&Iteration> = iterations.iter().map(|shown| &shown.iteration).collect();
    let best = best_iteration(results.iter().copied());
    let drawings = [notes_by_iteration(&results), gap_by_iteration(&results)];
    let drawings = drawings.iter().map(Drawing::inline).collect::<anyhow::Result<Vec<_>>>()?;
    let adaptation = match (adaptation, best) {
        (Some(adaptation), Some(best)) => Some(adaptation.section(best, &config.mode.to_string())?),
        _ => None,
    };
    let body = html! {
        p {
            "Mode " (config.mode) ", robot " (config.rig)
            @if let Some(twin_params) = &config.twin_params { " (twin parameters " (twin_params) ")" }
            ", preset " (config.preset) ", " (config.runs) " runs per iteration, seed " (config.seed) ". Iteration 0 plays the policy of the \
             default simulator."
            @if let Some(best) = best { " Iteration " (best.iteration) " has played best, by the mean of F1 and onset F1"
                @if adaptation.is_none() { ": its policy is the one to use" } "." }
        }
        div.drawings { @for drawing in drawings { figure { (PreEscaped(drawing)) } } }
        (scores(&results))
        section {
            h2 { "See and hear" }
            @for shown in iterations {
                h3 { "Iteration " (shown.iteration.iteration) }
                ul.performances {
                    @for (index, performance) in shown.performances.iter().enumerate() {
                        li { (see_and_hear(&format!("iteration {}, run {}", shown.iteration.iteration, index + 1), performance)) }
                    }
                }
            }
        }
        @if let Some(section) = adaptation { (section) }
        (parameters(&results))
    };
    Ok(page(&format!("Rehearsal of {}", config.song), &body))
}

/// Bars by iteration: the value of each, and what it is compared with.
fn by_iteration(
    iterations: &[&Iteration],
    [title, name, y_label]: [&str; 3],
    values: impl Fn(&RobotScores) -> (f64, Option<f64>),
) -> Drawing {
    let mut series = Series { name: name.to_string(), ..Series::default() };
    for (x, iteration) in (0..).map(f64::from).zip(iterations) {
        let (y, mark) = values(&iteration.scores);
        series.points.push(Point { x, y, interval: None });
        series.marks.extend(mark.map(|y| Mark { x: Some(x), y }));
    }
    Drawing {
        title: title.to_string(),
        x_label: "iteration".to_string(),
        y_label: y_label.to_string(),
        groups: iterations.iter().map(|iteration| iteration.iteration.to_string()).collect(),
        series: vec![series],
        marks: "notes due".to_string(),
        ..Drawing::default()
    }
}

fn notes_by_iteration(iterations: &[&Iteration]) -> Drawing {
    let texts = ["Notes right on the robot, mean of the runs", "notes right", "notes"];
    by_iteration(iterations, texts, |scores| (scores.notes.notes_right, Some(scores.notes.notes_due as f64)))
}

fn gap_by_iteration(iterations: &[&Iteration]) -> Drawing {
    let texts = ["Gap: the share of the F1 in simulation that is lost on the robot", "gap", "gap (%)"];
    by_iteration(iterations, texts, |scores| (100.0 * scores.gap, None))
}

fn scores(iterations: &[&Iteration]) -> Markup {
    let rows = iterations.iter().map(|iteration| {
        let scores = &iteration.scores;
        let [before, after] = iteration
            .held_out_rad
            .map_or_else(Default::default, |errors| errors.map(|e| format!("{:.2}", 1e3 * e)));
        let predicted = |f1: fn(Prediction) -> f64| {
            iteration.prediction.map_or_else(String::new, |prediction| format!("{:.3}", f1(prediction)))
        };
        vec![
            iteration.iteration.to_string(),
            format!("{:.1}\u{a0}of\u{a0}{}", scores.notes.notes_right, scores.notes.notes_due),
            format!("{:.1}", scores.notes.notes_wrong),
            format!("{:.3}", scores.notes.onset_f1),
            format!("{:.0}", 1e3 * scores.latency_compensation_secs),
            scores.lag_secs.map_or_else(String::new, |lag| format!("{:+.0}", 1e3 * lag)),
            format!("{:.3}", scores.sim_f1),
            format!("{:.3} ± {:.3}", scores.robot_f1, scores.robot_f1_std),
            format!("{:.1} %", 100.0 * scores.gap),
            before,
            after,
            predicted(|prediction| prediction.before_fit_f1),
            predicted(|prediction| prediction.after_fit_f1),
        ]
    });
    let columns = [
        "iteration",
        "notes right on the robot",
        "wrong",
        "onset F1, robot",
        "latency compensation, ms",
        "remaining lag, ms",
        "F1, simulation",
        "F1, robot (mean ± standard deviation)",
        "gap",
        "error of the fingers before the fit, mrad",
        "after the fit, mrad",
        "F1 of the iteration before, as predicted before the fit",
        "after the fit",
    ];
    table("Notes, F1 by control step, and the error of the simulator in held-out motions", &columns, rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use etude_lab::{MeanNotes, RehearsalFit};
    use etude_perform::NoteCounts;

    pub(super) fn iteration(iteration: usize) -> Iteration {
        Iteration {
            iteration,
            scores: RobotScores {
                notes: MeanNotes { notes_right: 13.5, notes_due: 14, notes_wrong: 2.0, ..Default::default() },
                latency_compensation_secs: 0.025,
                lag_secs: Some(0.06),
                sim_f1: 0.96,
                robot_f1: 0.9,
                robot_f1_std: 0.01,
                gap: 0.06,
                ..RobotScores::default()
            },
            held_out_rad: (iteration > 0).then_some([0.013, 0.0017]),
            prediction: (iteration > 0).then_some(Prediction {
                before_fit_f1: 0.957,
                after_fit_f1: 0.912,
                played_f1: 0.9,
            }),
            policy: "p".into(),
            recordings: vec![format!("there/iteration-{iteration}/performance/run-1.mcap").into()],
            physics: match iteration {
                0 => Default::default(),
                _ => [("joint.index_1.delay".to_string(), 0.0123)].into(),
            },
        }
    }

    #[test]
    fn a_page_has_the_gap_the_takes_and_the_numbers_and_escapes_names() {
        let config = RehearsalConfig {
            song: "<b>&.mid".to_string(),
            rig: "twin".to_string(),
            twin_params: Some("worn".to_string()),
            iterations: 1,
            runs: 1,
            mode: etude_perform::Mode::Real,
            preset: "fast".to_string(),
            overrides: Vec::new(),
            policy: None,
            simulator: None,
            fit: RehearsalFit::Lm,
            evaluations: None,
            seed: 0,
            threads: None,
        };
        let shown = |number: usize| IterationResult {
            iteration: iteration(number),
            performances: vec![Performance {
                sound: Some(format!("iteration-{number}/performance/run-1.wav").into()),
                replay: if number == 0 {
                    Err("it is <damaged>".to_string())
                } else {
                    Ok("iteration-1/performance/run-1.html".into())
                },
                notes: Some(NoteCounts { right: 13, due: 14, wrong: 2 }),
            }],
        };
        let page = rehearsal_page(&config, &[shown(0), shown(1)], None).unwrap();
        for part in [
            "&lt;b&gt;&amp;.mid",
            "twin parameters worn",
            "Iteration 0 has played best, by the mean of F1 and onset F1: its policy is the one to use.",
            "13 columns: scroll the table sideways.",
            "<summary>Parameters changed by the fits: 1</summary>",
            "Notes right on the robot",
            "notes due",
            "gap (%)",
            "<td>13.5\u{a0}of\u{a0}14</td><td>2.0</td><td>0.000</td><td>25</td><td>+60</td><td>0.960</td><td>0.900 ± 0.010</td><td>6.0 %</td><td>13.00</td><td>1.70</td>",
            "No replay of iteration 0, run 1: it is &lt;damaged&gt;",
            "<a href=\"iteration-1/performance/run-1.html\">Replay of iteration 1, run 1</a> · 13 of 14 notes right, 2 wrong",
            "src=\"iteration-1/performance/run-1.wav\"",
            "<td>joint.index_1.delay</td><td>s</td><td>0</td><td>0.0123</td>",
        ] {
            assert!(page.contains(part), "{part} is not in {page}");
        }
        assert!(!page.contains("<b>") && !page.contains(".mcap"));
    }

    /// The bar of a gap below zero goes down, and that of a better one is shorter.
    #[test]
    fn the_charts_show_each_round() {
        let (zero, mut one) = (iteration(0), iteration(1));
        one.scores.gap = -0.02;
        let iterations = [&zero, &one];
        let gaps: Vec<f64> =
            gap_by_iteration(&iterations).series[0].points.iter().map(|point| point.y).collect();
        assert_eq!(gaps, [6.0, -2.0]);
        let notes = notes_by_iteration(&iterations);
        assert_eq!(notes.series[0].points[1].y, 13.5);
        assert_eq!(notes.series[0].marks[1], Mark { x: Some(1.0), y: 14.0 });
        assert!(gap_by_iteration(&iterations).svg().is_ok());
    }
}
