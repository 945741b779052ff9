//! The page of a rehearsal: notes right and the gap by round, the performances to see and to hear,
//! what was learned on the robot itself, and the simulator's numbers.

mod adaptation;
mod numbers;
mod performance;

use std::path::Path;

use anyhow::Context as _;
use etude_lab::{Adapted, RehearsalConfig, Round, best_round};
use etude_perform::write_file;
use maud::{Markup, PreEscaped, html};

use adaptation::Adaptation;
use numbers::numbers;
use performance::{Performance, performance, see_and_hear};

use crate::figure::{Drawing, Mark, Point, Series};
use crate::html::{page, table};

/// Name of the page in the folder of its rehearsal.
pub const REHEARSAL_PAGE: &str = "rehearsal.html";

/// The page of a rehearsal, written again after each round, with a replay page beside each
/// recording.
pub struct RehearsalPage<'a> {
    config: &'a RehearsalConfig,
    folder: &'a Path,
    rounds: Vec<NoteJudgement>,
    adaptation: Option<Adaptation>,
    written: anyhow::Result<()>,
}

/// A round and its performances.
struct NoteJudgement {
    round: Round,
    performances: Vec<Performance>,
}

impl<'a> RehearsalPage<'a> {
    /// The page of a rehearsal in `folder`, not yet written.
    pub fn new(config: &'a RehearsalConfig, folder: &'a Path) -> Self {
        Self { config, folder, rounds: Vec::new(), adaptation: None, written: Ok(()) }
    }

    /// Adds a round, writes its replay pages, and writes the page.
    pub fn add(&mut self, round: &Round) {
        self.then(|page| {
            let shown = round.recordings.iter().map(|path| performance(path, page.folder));
            let performances = shown.collect::<anyhow::Result<Vec<_>>>()?;
            page.rounds.push(NoteJudgement { round: round.clone(), performances });
            Ok(())
        });
    }

    /// Adds what was learned on the robot itself after the rounds, writes its replay pages, and
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
                let page = rehearsal_page(self.config, &self.rounds, self.adaptation.as_ref())?;
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

/// The page of the rounds so far.
fn rehearsal_page(
    config: &RehearsalConfig,
    rounds: &[NoteJudgement],
    adaptation: Option<&Adaptation>,
) -> anyhow::Result<String> {
    let results: Vec<&Round> = rounds.iter().map(|shown| &shown.round).collect();
    let best = best_round(results.iter().copied());
    let drawings = [notes_by_round(&results), gap_by_round(&results)];
    let drawings = drawings.iter().map(Drawing::inline).collect::<anyhow::Result<Vec<_>>>()?;
    let adaptation = match (adaptation, best) {
        (Some(adaptation), Some(best)) => Some(adaptation.section(best, &config.mode.to_string())?),
        _ => None,
    };
    let body = html! {
        p {
            "Mode " (config.mode) ", robot " (config.rig)
            @if let Some(twin_params) = &config.twin_params { " (twin parameters " (twin_params) ")" }
            ", preset " (config.preset) ", " (config.runs) " runs a round, seed " (config.seed) ". Round 0 plays what was learned in the \
             default simulator."
            @if let Some(best) = best { " Round " (best.round) " has played best, by the mean of F1 and onset F1"
                @if adaptation.is_none() { ": its policy is the one to use" } "." }
        }
        div.drawings { @for drawing in drawings { figure { (PreEscaped(drawing)) } } }
        (scores(&results))
        section {
            h2 { "See and hear" }
            @for shown in rounds {
                h3 { "Round " (shown.round.round) }
                ul.performances {
                    @for (index, performance) in shown.performances.iter().enumerate() {
                        li { (see_and_hear(&format!("round {}, run {}", shown.round.round, index + 1), performance)) }
                    }
                }
            }
        }
        @if let Some(section) = adaptation { (section) }
        (numbers(&results))
    };
    Ok(page(&format!("Rehearsal of {}", config.song), &body))
}

/// Bars by round.
fn by_round(rounds: &[&Round], title: &str, y_label: &str, series: Series) -> Drawing {
    Drawing {
        title: title.to_string(),
        x_label: "round".to_string(),
        y_label: y_label.to_string(),
        groups: rounds.iter().map(|round| round.round.to_string()).collect(),
        series: vec![series],
        marks: "notes due".to_string(),
        ..Drawing::default()
    }
}

fn notes_by_round(rounds: &[&Round]) -> Drawing {
    let point =
        |(x, round): (usize, &&Round)| Point { x: x as f64, y: round.notes.notes_right, interval: None };
    let due = |(x, round): (usize, &&Round)| Mark { x: Some(x as f64), y: round.notes.notes_due as f64 };
    let series = Series {
        name: "notes right".to_string(),
        points: rounds.iter().enumerate().map(point).collect(),
        marks: rounds.iter().enumerate().map(due).collect(),
    };
    by_round(rounds, "Notes right on the robot, mean of the runs", "notes", series)
}

fn gap_by_round(rounds: &[&Round]) -> Drawing {
    let point = |(x, round): (usize, &&Round)| Point { x: x as f64, y: 100.0 * round.gap, interval: None };
    let points = rounds.iter().enumerate().map(point).collect();
    let series = Series { name: "gap".to_string(), points, marks: Vec::new() };
    by_round(rounds, "Gap: the share of the F1 in simulation that is lost on the robot", "gap (%)", series)
}

fn scores(rounds: &[&Round]) -> Markup {
    let rows = rounds.iter().map(|round| {
        let [before, after] = round
            .held_out_rad
            .map_or_else(Default::default, |errors| errors.map(|e| format!("{:.2}", 1e3 * e)));
        vec![
            round.round.to_string(),
            format!("{:.1}\u{a0}of\u{a0}{}", round.notes.notes_right, round.notes.notes_due),
            format!("{:.1}", round.notes.notes_wrong),
            format!("{:.3}", round.notes.onset_f1),
            format!("{:.0}", 1e3 * round.latency_compensation_secs),
            round.lag_secs.map_or_else(String::new, |lag| format!("{:+.0}", 1e3 * lag)),
            format!("{:.3}", round.sim_f1),
            format!("{:.3} ± {:.3}", round.robot_f1, round.robot_f1_std),
            format!("{:.1} %", 100.0 * round.gap),
            before,
            after,
        ]
    });
    let columns = [
        "round",
        "notes right on the robot",
        "wrong",
        "onset F1, robot",
        "lead of the plan, ms",
        "remaining lag, ms",
        "F1, simulation",
        "F1, robot (mean ± standard deviation)",
        "gap",
        "error of the fingers before the fit, mrad",
        "after the fit, mrad",
    ];
    table("Notes, F1 by control step, and the error of the simulator in held-out motions", &columns, rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use etude_lab::{IdentifyMethod, MeanNotes};
    use etude_perform::NoteCounts;

    pub(super) fn round(round: usize) -> Round {
        Round {
            round,
            notes: MeanNotes { notes_right: 13.5, notes_due: 14, notes_wrong: 2.0, ..Default::default() },
            latency_compensation_secs: 0.025,
            lag_secs: Some(0.06),
            sim_f1: 0.96,
            robot_f1: 0.9,
            robot_f1_std: 0.01,
            gap: 0.06,
            held_out_rad: (round > 0).then_some([0.013, 0.0017]),
            policy: "p".into(),
            recordings: vec![format!("there/round-{round}/performance/run-1.mcap").into()],
            physics: match round {
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
            rounds: 1,
            runs: 1,
            mode: etude_perform::Mode::Real,
            preset: "fast".to_string(),
            overrides: Vec::new(),
            policy: None,
            simulator: None,
            method: IdentifyMethod::Lm,
            evaluations: None,
            seed: 0,
            threads: None,
            keep_replay: false,
        };
        let shown = |number: usize| NoteJudgement {
            round: round(number),
            performances: vec![Performance {
                sound: Some(format!("round-{number}/performance/run-1.wav").into()),
                replay: if number == 0 {
                    Err("it is <damaged>".to_string())
                } else {
                    Ok("round-1/performance/run-1.html".into())
                },
                notes: Some(NoteCounts { right: 13, due: 14, wrong: 2 }),
            }],
        };
        let page = rehearsal_page(&config, &[shown(0), shown(1)], None).unwrap();
        for part in [
            "&lt;b&gt;&amp;.mid",
            "twin parameters worn",
            "Round 0 has played best, by the mean of F1 and onset F1: its policy is the one to use.",
            "11 columns: scroll the table sideways.",
            "<summary>Every number that a round has changed: 1</summary>",
            "Notes right on the robot",
            "notes due",
            "gap (%)",
            "<td>13.5\u{a0}of\u{a0}14</td><td>2.0</td><td>0.000</td><td>25</td><td>+60</td><td>0.960</td><td>0.900 ± 0.010</td><td>6.0 %</td><td>13.00</td><td>1.70</td>",
            "No replay of round 0, run 1: it is &lt;damaged&gt;",
            "<a href=\"round-1/performance/run-1.html\">Replay of round 1, run 1</a> · 13 of 14 notes right, 2 wrong",
            "src=\"round-1/performance/run-1.wav\"",
            "<td>joint.index_1.delay</td><td>s</td><td>0</td><td>0.01230</td>",
        ] {
            assert!(page.contains(part), "{part} is not in {page}");
        }
        assert!(!page.contains("<b>") && !page.contains(".mcap"));
    }

    /// The bar of a gap below zero goes down, and that of a better one is shorter.
    #[test]
    fn the_charts_show_each_round() {
        let (zero, mut one) = (round(0), round(1));
        one.gap = -0.02;
        let rounds = [&zero, &one];
        let gaps: Vec<f64> = gap_by_round(&rounds).series[0].points.iter().map(|point| point.y).collect();
        assert_eq!(gaps, [6.0, -2.0]);
        let notes = notes_by_round(&rounds);
        assert_eq!(notes.series[0].points[1].y, 13.5);
        assert_eq!(notes.series[0].marks[1], Mark { x: Some(1.0), y: 14.0 });
        assert!(gap_by_round(&rounds).svg().is_ok());
    }
}
