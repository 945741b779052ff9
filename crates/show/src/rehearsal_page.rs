//! The page of a rehearsal: the gap by round, the performances to listen to, and the simulator's numbers.

use std::fmt::Write as _;
use std::path::Path;

use etude_identify::html::{escape, page};
use etude_lab::{RehearsalConfig, Round};
use etude_perform::{FileError, write_file};
use etude_stage::PhysicalParams;

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
    let mut body = String::new();
    let truth = match &config.truth {
        Some(name) => format!(" (truth {name})"),
        None => String::new(),
    };
    // Writing to a string cannot fail.
    let _ = writeln!(
        body,
        "<p>Mode {}, robot {}{}, preset {}, {} runs a round, seed {}.</p>",
        config.mode,
        escape(&config.rig),
        escape(&truth),
        escape(&config.preset),
        config.runs,
        config.seed
    );
    scores(&mut body, rounds);
    takes(&mut body, rounds, folder);
    numbers(&mut body, rounds);
    page(&format!("Rehearsal of {}", config.song), &body)
}

fn scores(body: &mut String, rounds: &[Round]) {
    table(
        body,
        "F1 by control step, and the error of the simulator in motions that no fit has seen",
        &[
            "round",
            "simulation",
            "robot (mean ± standard deviation)",
            "gap",
            "fingers before, mrad",
            "after, mrad",
        ],
        rounds.iter().map(|round| {
            let [before, after] = match round.held_out_rad {
                Some(errors) => errors.map(|error| format!("{:.2}", 1e3 * error)),
                None => Default::default(),
            };
            let robot = format!("{:.3} ± {:.3}", round.robot_f1, round.robot_f1_std);
            let number = |value: f64| format!("{value:.3}");
            vec![
                round.round.to_string(),
                number(round.sim_f1),
                robot,
                format!("{:.1} %", 100.0 * round.gap),
                before,
                after,
            ]
        }),
    );
}

fn takes(body: &mut String, rounds: &[Round], folder: &Path) {
    body.push_str("<section>\n<h2>Listen</h2>\n");
    for round in rounds {
        let _ = writeln!(body, "<p>Round {}</p>", round.round);
        for recording in &round.recordings {
            // The page is moved with its folder, so links begin there.
            let recording = recording.strip_prefix(folder).unwrap_or(recording);
            let [sound, recording] = [recording.with_extension("wav"), recording.to_path_buf()]
                .map(|path| escape(&path.display().to_string()));
            let _ = writeln!(
                body,
                "<p><audio controls=\"\" preload=\"none\" src=\"{sound}\"></audio> <a href=\"{recording}\">{recording}</a></p>"
            );
        }
    }
    body.push_str("</section>\n");
}

/// Every number that a round has changed.
fn numbers(body: &mut String, rounds: &[Round]) {
    let fitted: Vec<&Round> = rounds.iter().filter(|round| !round.physics.is_empty()).collect();
    if fitted.is_empty() {
        return;
    }
    let names: Vec<String> = fitted.iter().map(|round| format!("round {}", round.round)).collect();
    let mut columns = vec!["number", "unit", "default"];
    columns.extend(names.iter().map(String::as_str));
    let changed = PhysicalParams::rows()
        .filter(|(path, _, _)| fitted.iter().any(|round| round.physics.contains_key(path)));
    let rows = changed.map(|(path, row, default)| {
        let values = fitted.iter().map(|round| round.physics.get(&path).copied().unwrap_or(default));
        let values: Vec<String> = values.map(number).collect();
        [vec![path, row.unit.to_string(), number(default)], values].concat()
    });
    table(body, "The simulator's numbers", &columns, rows);
}

/// Four significant digits.
fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".to_string();
    }
    let digits = 3 - value.abs().log10().floor() as i32;
    format!("{value:.*}", digits.clamp(0, 9) as usize)
}

fn table(body: &mut String, caption: &str, columns: &[&str], rows: impl Iterator<Item = Vec<String>>) {
    let cells = |tag: &str, words: &[String]| -> String {
        words.iter().map(|word| format!("<{tag}>{}</{tag}>", escape(word))).collect()
    };
    let heads: Vec<String> = columns.iter().map(|name| (*name).to_string()).collect();
    let rows: String = rows.map(|row| format!("<tr>{}</tr>\n", cells("td", &row))).collect();
    let _ = writeln!(
        body,
        "<div class=\"table\"><table>\n<caption>{}</caption>\n<thead><tr>{}</tr></thead>\n<tbody>\n{rows}</tbody>\n</table></div>",
        escape(caption),
        cells("th", &heads)
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use etude_lab::IdentifyMethod;

    fn round(round: usize) -> Round {
        Round {
            round,
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
        };
        let page = rehearsal_page(&config, &[round(0), round(1)], Path::new("there"));
        for part in [
            "&lt;b&gt;&amp;.mid",
            "truth worn",
            "<td>0.900 ± 0.010</td><td>6.0 %</td><td>13.00</td><td>1.70</td>",
            "src=\"round-1/performance/run-1.wav\"",
            "<td>joint.index_1.delay</td><td>s</td><td>0</td><td>0.01230</td>",
        ] {
            assert!(page.contains(part), "{part} is not in {page}");
        }
        assert!(!page.contains("<b>"));
    }
}
