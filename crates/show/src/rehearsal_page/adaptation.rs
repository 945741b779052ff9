//! What was learned on the robot itself, on the page of a rehearsal: the runs, and how the song is
//! played before and after.

use std::path::Path;

use etude_lab::{AdaptRun, Adapted, Iteration, RobotScores, latest_result, run_file};
use maud::{Markup, PreEscaped, html};

use super::performance::{Performance, performance, see_and_hear};
use crate::figure::{Drawing, Mark, Point, Series};
use crate::html::table;

/// The run that plays with the measured lead and without a correction, from 0; the first one only
/// measures the lead.
const BEFORE: usize = 1;

/// An adaptation, and its performances to see and to hear.
pub(super) struct Adaptation {
    adapted: Adapted,
    before: Performance,
    performances: Vec<Performance>,
}

impl Adaptation {
    /// Writes the replay pages of the adaptation below the `folder` of the rehearsal, of so many
    /// `runs` with the correction.
    pub fn new(adapted: &Adapted, folder: &Path, runs: usize) -> anyhow::Result<Self> {
        let there = folder.join("adaptation");
        let of_run = |part: &str, index: usize| {
            let recording = latest_result(&there.join(part)).join(run_file(index, "mcap"));
            performance(&recording, folder)
        };
        Ok(Self {
            adapted: adapted.clone(),
            before: of_run(&format!("run-{:02}", BEFORE + 1), 0)?,
            performances: (0..runs)
                .map(|index| of_run("performance", index))
                .collect::<anyhow::Result<_>>()?,
        })
    }

    /// The section of the page, with the best iteration to compare with.
    pub fn section(&self, best: &Iteration, mode: &str) -> anyhow::Result<Markup> {
        let Self { adapted, .. } = self;
        let drawings = drawings(adapted);
        let drawings = drawings.iter().map(Drawing::inline).collect::<anyhow::Result<Vec<_>>>()?;
        let kept = adapted.best + 1;
        Ok(html! {
            section {
                h2 { "Learned on the robot itself" }
                p {
                    "The policy of iteration 0 was played " (adapted.adapting.len()) " times in " (adapted.mode) ". After each run, the joint \
                     errors corrected the set-points of the next one, and keys that sounded too short, not at all, or next to the right one \
                     shifted the finger targets. The correction of run " (kept) " was selected: it is the best \
                     with its neighbours. "
                    @if adapted.scores.overall() > best.scores.overall() {
                        "With it the robot plays better than in iteration " (best.iteration) ", by the mean of F1 and onset F1. Play it with "
                        code { "--correction " (adapted.correction.display()) } "."
                    } @else {
                        "It does not play better than iteration " (best.iteration) ", by the mean of F1 and onset F1: the policy of that iteration is the one to use."
                    }
                }
                div.drawings.three { @for drawing in drawings { figure { (PreEscaped(drawing)) } } }
                (comparison(adapted, best, mode))
                ul.performances {
                    li { (see_and_hear(&format!("run {}, before any correction", BEFORE + 1), &self.before)) }
                    @for (index, performance) in self.performances.iter().enumerate() {
                        li { (see_and_hear(&format!("the adapted performance, run {}", index + 1), performance)) }
                    }
                }
            }
        })
    }
}

/// Curves over the runs, with a mark at the one that was kept: notes, and how far the joints were
/// off their path.
fn drawings(adapted: &Adapted) -> [Drawing; 3] {
    let series = |name: &str, value: &dyn Fn(&AdaptRun) -> f64| {
        let point =
            |(index, run): (usize, &AdaptRun)| Point { x: (index + 1) as f64, y: value(run), interval: None };
        let points: Vec<Point> = adapted.adapting.iter().enumerate().map(point).collect();
        Series { name: name.to_string(), points, marks: Vec::new() }
    };
    let drawing = |title: &str, unit: &str, mut series: Vec<Series>| {
        let kept = series[0].points.get(adapted.best).map(|point| Mark { x: Some(point.x), y: point.y });
        series[0].marks.extend(kept);
        Drawing {
            title: title.to_string(),
            x_label: "run".to_string(),
            y_label: unit.to_string(),
            markers: true,
            series,
            marks: "the selected run".to_string(),
            ..Drawing::default()
        }
    };
    let due = adapted.scores.notes.notes_due as f64;
    let notes =
        vec![series("notes right", &|run| run.scores.notes.notes_right), series("notes due", &|_| due)];
    let fingers = vec![series("fingers", &|run| 1e3 * run.fingers_missed_rad)];
    let rail = vec![series("rail", &|run| 1e3 * run.rail_missed_m)];
    [
        drawing("Notes right while learning", "notes", notes),
        drawing("Joint error of the fingers, root mean square", "mrad", fingers),
        drawing("Joint error of the rail, root mean square", "mm", rail),
    ]
}

/// The best iteration, the mode of the adaptation before any correction, and the adapted
/// performance.
fn comparison(adapted: &Adapted, best: &Iteration, mode: &str) -> Markup {
    let row = |how: String, scores: &RobotScores| {
        let RobotScores { notes, robot_f1, robot_f1_std, .. } = scores;
        vec![
            how,
            format!("{:.1}\u{a0}of\u{a0}{}", notes.notes_right, notes.notes_due),
            format!("{:.1}", notes.notes_wrong),
            format!("{:.3}", notes.onset_f1),
            format!("{robot_f1:.3} ± {robot_f1_std:.3}"),
        ]
    };
    let before = adapted.adapting.get(BEFORE).map(|run| {
        row(format!("{} before any correction, run {} alone", adapted.mode, BEFORE + 1), &run.scores)
    });
    let first = row(format!("{mode}, iteration {}", best.iteration), &best.scores);
    let last = row(format!("{} with the correction", adapted.mode), &adapted.scores);
    let columns = ["how it was played", "notes right", "wrong", "onset F1", "F1 by control step"];
    table(
        "On the robot: means of the runs",
        &columns,
        [Some(first), before, Some(last)].into_iter().flatten(),
    )
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use etude_lab::MeanNotes;
    use etude_perform::Mode;

    use super::super::tests::iteration;
    use super::*;

    fn adapted() -> Adapted {
        let run = |right: f64, f1: f64| AdaptRun {
            scores: RobotScores {
                notes: MeanNotes {
                    notes_right: right,
                    notes_due: 14,
                    notes_wrong: 14.0 - right,
                    ..Default::default()
                },
                robot_f1: f1,
                ..Default::default()
            },
            fingers_missed_rad: 0.05,
            rail_missed_m: 0.004,
            clamped: 0,
        };
        Adapted {
            adapting: vec![run(1.0, 0.82), run(13.0, 0.9), run(14.0, 0.95)],
            best: 2,
            scores: RobotScores {
                notes: MeanNotes { notes_right: 13.8, notes_due: 14, onset_f1: 0.99, ..Default::default() },
                robot_f1: 0.957,
                robot_f1_std: 0.003,
                ..Default::default()
            },
            mode: Mode::JointMirroring,
            correction: "there/adaptation/correction.json".into(),
        }
    }

    fn shown(sound: Option<&str>) -> Performance {
        Performance { sound: sound.map(PathBuf::from), replay: Ok("p.html".into()), notes: None }
    }

    #[test]
    fn the_section_has_the_runs_the_kept_one_and_the_comparison() {
        let adaptation = Adaptation {
            adapted: adapted(),
            before: shown(None),
            performances: vec![shown(Some("run-1.wav"))],
        };
        let page = adaptation.section(&iteration(0), "real").unwrap().into_string();
        for part in [
            "was played 3 times in joint-mirroring. After",
            "The correction of run 3 was selected",
            "plays better than in iteration 0",
            "--correction there/adaptation/correction.json",
            "Notes right while learning",
            "Joint error of the fingers",
            "Joint error of the rail",
            "<td>real, iteration 0</td><td>13.5\u{a0}of\u{a0}14</td><td>2.0</td><td>0.000</td><td>0.900 ± 0.010</td>",
            "joint-mirroring before any correction, run 2 alone</td><td>13.0\u{a0}of\u{a0}14</td><td>1.0</td><td>0.000</td><td>0.900 ± 0.000</td>",
            "joint-mirroring with the correction</td><td>13.8\u{a0}of\u{a0}14</td><td>0.0</td><td>0.990</td><td>0.957 ± 0.003</td>",
            "Replay of run 2, before any correction",
            "Replay of the adapted performance, run 1",
        ] {
            assert!(page.contains(part), "{part} is not in {page}");
        }
        // The sound of a run while learning is not kept.
        assert_eq!(page.matches("<audio").count(), 1);
        let better = Iteration {
            scores: RobotScores {
                robot_f1: 1.0,
                notes: MeanNotes { onset_f1: 1.0, ..Default::default() },
                ..iteration(0).scores
            },
            ..iteration(0)
        };
        assert!(
            adaptation
                .section(&better, "real")
                .unwrap()
                .into_string()
                .contains("It does not play better than iteration 0")
        );
    }

    /// Recordings are large, and may have been removed: the page still says how it went, and the
    /// run that is asked for is the one shown.
    #[test]
    fn recordings_that_are_missing_do_not_hinder_the_page() {
        let folder = tempfile::tempdir().unwrap();
        let adaptation = Adaptation::new(&adapted(), folder.path(), 12).unwrap();
        assert_eq!(adaptation.performances.len(), 12);
        assert!(adaptation.performances.iter().all(|performance| performance.replay.is_err()));
        assert!(adaptation.performances[1].replay.as_ref().unwrap_err().contains("run-2.mcap"));
        assert!(adaptation.section(&iteration(0), "real").unwrap().into_string().contains("13.8"));
    }

    #[test]
    fn the_charts_show_each_run_and_the_kept_one() {
        let [notes, fingers, rail] = drawings(&adapted());
        let right: Vec<f64> = notes.series[0].points.iter().map(|point| point.y).collect();
        let due: Vec<f64> = notes.series[1].points.iter().map(|point| point.y).collect();
        assert_eq!((right, due), (vec![1.0, 13.0, 14.0], vec![14.0; 3]));
        let kept = [&notes, &fingers, &rail].map(|drawing| drawing.series[0].marks.clone());
        assert_eq!(kept, [14.0, 50.0, 4.0].map(|y| vec![Mark { x: Some(3.0), y }]));
        assert!(fingers.svg().unwrap().contains("the selected run"));
    }
}
