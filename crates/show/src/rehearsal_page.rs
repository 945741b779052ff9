//! The page of a rehearsal: the gap by round, the performances to listen to, and the simulator's numbers.

use std::path::Path;

use etude_lab::{RehearsalConfig, Round};
use etude_perform::{FileError, write_file};
use etude_stage::PhysicalParams;
use maud::{Markup, html};

use crate::html::{page, table};

/// Name of the page in the folder of its rehearsal.
pub const REHEARSAL_PAGE: &str = "rehearsal.html";

/// The page of a rehearsal, written again after each round.
pub struct RehearsalPage<'a> {
    config: &'a RehearsalConfig,
    folder: &'a Path,
    rounds: Vec<Round>,
    written: Result<(), FileError>,
}

impl<'a> RehearsalPage<'a> {
    /// The page of a rehearsal in `folder`, not yet written.
    pub fn new(config: &'a RehearsalConfig, folder: &'a Path) -> Self {
        Self { config, folder, rounds: Vec::new(), written: Ok(()) }
    }

    /// Adds a round and writes the page.
    pub fn add(&mut self, round: &Round) {
        self.rounds.push(round.clone());
        if self.written.is_ok() {
            let page = rehearsal_page(self.config, &self.rounds, self.folder);
            self.written = write_file(&self.folder.join(REHEARSAL_PAGE), &page);
        }
    }

    /// Whether the page has been written after every round.
    ///
    /// # Errors
    /// If a page could not be written.
    pub fn finish(self) -> Result<(), FileError> {
        self.written
    }
}

/// The page of the rounds so far, in `folder`: recordings are linked from there.
fn rehearsal_page(config: &RehearsalConfig, rounds: &[Round], folder: &Path) -> String {
    let body = html! {
        p {
            "Mode " (config.mode) ", robot " (config.rig)
            @if let Some(truth) = &config.truth { " (truth " (truth) ")" }
            ", preset " (config.preset) ", " (config.runs) " runs a round, seed " (config.seed) "."
        }
        (scores(rounds))
        section {
            h2 { "Listen" }
            @for round in rounds {
                p { "Round " (round.round) }
                // The page is moved with its folder, so links begin there.
                @for recording in round.recordings.iter().map(|path| path.strip_prefix(folder).unwrap_or(path)) {
                    p {
                        audio controls preload="none" src=(recording.with_extension("wav").display()) {}
                        " "
                        a href=(recording.display()) { (recording.display()) }
                    }
                }
            }
        }
        (numbers(rounds))
    };
    page(&format!("Rehearsal of {}", config.song), &body)
}

fn scores(rounds: &[Round]) -> Markup {
    let rows = rounds.iter().map(|round| {
        let [before, after] = round
            .held_out_rad
            .map_or_else(Default::default, |errors| errors.map(|e| format!("{:.2}", 1e3 * e)));
        vec![
            round.round.to_string(),
            format!("{:.1} of {}", round.notes.notes_right, round.notes.notes_due),
            format!("{:.1}", round.notes.notes_wrong),
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
        "late, ms",
        "F1, simulation",
        "F1, robot (mean ± standard deviation)",
        "gap",
        "fingers before, mrad",
        "after, mrad",
    ];
    table(
        "Notes, F1 by control step, and the error of the simulator in motions that no fit has seen",
        &columns,
        rows,
    )
}

/// Every number that a round has changed.
fn numbers(rounds: &[Round]) -> Markup {
    let fitted: Vec<&Round> = rounds.iter().filter(|round| !round.physics.is_empty()).collect();
    let mut columns = ["number", "unit", "default"].map(String::from).to_vec();
    columns.extend(fitted.iter().map(|round| format!("round {}", round.round)));
    let changed = PhysicalParams::rows()
        .filter(|(path, _, _)| fitted.iter().any(|round| round.physics.contains_key(path)));
    let rows = changed.map(|(path, row, default)| {
        let values = fitted.iter().map(|round| round.physics.get(&path).copied().unwrap_or(default));
        let values: Vec<String> = values.map(number).collect();
        [vec![path, row.unit.to_string(), number(default)], values].concat()
    });
    table("The simulator's numbers", &columns, rows)
}

/// Four significant digits.
fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".to_string();
    }
    let digits = 3 - value.abs().log10().floor() as i32;
    format!("{value:.*}", digits.clamp(0, 9) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use etude_lab::{IdentifyMethod, MeanNotes};

    fn round(round: usize) -> Round {
        Round {
            round,
            notes: MeanNotes { notes_right: 13.5, notes_due: 14, notes_wrong: 2.0, ..Default::default() },
            lead_secs: 0.025,
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
            truth: Some("worn".to_string()),
            rounds: 1,
            runs: 1,
            mode: etude_perform::Mode::Real,
            preset: "fast".to_string(),
            overrides: Vec::new(),
            policy: None,
            method: IdentifyMethod::Lm,
            evaluations: None,
            seed: 0,
            threads: None,
            keep_replay: false,
        };
        let page = rehearsal_page(&config, &[round(0), round(1)], Path::new("there"));
        for part in [
            "&lt;b&gt;&amp;.mid",
            "truth worn",
            "<td>13.5 of 14</td><td>2.0</td><td>+60</td><td>0.960</td><td>0.900 ± 0.010</td><td>6.0 %</td><td>13.00</td><td>1.70</td>",
            "src=\"round-1/performance/run-1.wav\"",
            "<td>joint.index_1.delay</td><td>s</td><td>0</td><td>0.01230</td>",
        ] {
            assert!(page.contains(part), "{part} is not in {page}");
        }
        assert!(!page.contains("<b>"));
    }
}
