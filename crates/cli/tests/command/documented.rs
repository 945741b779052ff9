//! Numbers in the documents: what they say of the shipped policies and of the scripted baseline is
//! what these play.
//!
//! Another processor rounds otherwise, and a contact may then fall the other way: hence the
//! tolerances.

use etude_music::{Split, melodies};
use serde_json::Value;

use crate::{Sandbox, root, shipped};

/// The column with F1 by the plan that is played.
const F1: &str = "F1 (articulated plan)";
/// The sight-reader's table: its beginning, and the column of the shipped policy.
const SIGHT_HEAD: &str = "| piece | sight-reader:";
const SIGHT: &str = "sight-reader: notes; onset F1; F1 (articulated plan); F1 (RoboPianist's rule)";
/// Tolerance of F1 and onset F1.
const SCORE: f64 = 0.03;
/// Tolerances of notes right and wrong.
const RIGHT: f64 = 1.0;
const WRONG: f64 = 2.0;
/// Tolerance of onset + offset F1: one note of fifteen.
const OFFSETS: f64 = 0.07;
/// Median onset error, ms: that of a physics step.
const LATE_MS: f64 = 5.0;
/// Latency compensations, ms.
const LATENCY_MS: f64 = 10.0;
/// The five songs that the paper reports.
const PAPER_SONGS: [&str; 5] =
    ["are-you-sleeping", "happy-birthday", "ode-to-joy", "twinkle", "c-major-scale"];

fn document(name: &str) -> String {
    std::fs::read_to_string(root().join(name)).unwrap()
}

/// A document with each paragraph on one line.
fn unwrapped(name: &str) -> String {
    document(name).split_whitespace().collect::<Vec<_>>().join(" ")
}

/// A table of a document with a row for each built-in song.
struct Table {
    name: String,
    header: Vec<String>,
    rows: Vec<Vec<String>>,
}

fn cells(line: &str) -> Vec<String> {
    line.trim_matches('|').split('|').map(|cell| cell.trim().to_string()).collect()
}

impl Table {
    /// The table in a document whose header begins with `header`.
    fn read(name: &str, header: &str) -> Self {
        let table = Self::of_any_rows(name, header);
        for song in etude_music::repertoire::ids() {
            assert!(table.rows.iter().any(|row| row[0] == song), "{name} has no row for {song}");
        }
        table
    }

    /// The same of a table whose rows are not the built-in songs.
    fn of_any_rows(name: &str, header: &str) -> Self {
        let document = document(name);
        let lines: Vec<_> = document.lines().skip_while(|line| !line.starts_with(header)).collect();
        assert!(!lines.is_empty(), "{name} has no table `{header}`");
        let rows = lines.iter().skip(2).take_while(|line| line.starts_with('|'));
        let rows = rows.map(|line| cells(line)).collect();
        Self { name: name.to_string(), header: cells(lines[0]), rows }
    }

    fn text(&self, song: &str, column: &str) -> &str {
        let at = self
            .header
            .iter()
            .position(|name| name == column)
            .unwrap_or_else(|| panic!("no column {column}"));
        &self.rows.iter().find(|row| row[0] == song).unwrap()[at]
    }

    /// The number with which a cell begins.
    fn number(&self, song: &str, column: &str) -> f64 {
        leading_number(self.text(song, column))
    }

    fn check(&self, song: &str, column: &str, played: f64, tolerance: f64) {
        let said = self.number(song, column);
        assert!(
            (said - played).abs() <= tolerance,
            "{}: {song}, {column}: {said}, but it is {played}",
            self.name
        );
    }
}

/// The number with which a text begins, without its sign.
fn leading_number(text: &str) -> f64 {
    let text = text.trim_start_matches(['+', '−']);
    let end = text.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(text.len());
    text[..end].parse().unwrap_or_else(|_| panic!("`{text}` begins with no number"))
}

/// Notes right and wrong of a cell: `15 of 15, 0` or `15 of 15, 0 wrong`.
fn right_and_wrong(cell: &str) -> [f64; 2] {
    let (right, wrong) = cell.split_once(", ").unwrap();
    [right, wrong].map(leading_number)
}

/// Checks a table of `scripts/tables.py notes`: `player` chooses who plays.
fn check_notes(table: &Table, player: impl Fn(&str) -> String) {
    for song in etude_music::repertoire::ids() {
        let report = Sandbox::new().json(&format!("play {song} {} -o out --json", player(song)));
        let number = |key: &str| report[key].as_f64().unwrap();
        for (column, played, tolerance) in [
            ("notes right", number("matched"), RIGHT),
            ("wrong", number("wrong"), WRONG),
            ("onset F1", number("onset_f1"), 2.0 * SCORE),
            ("onset + offset F1", number("onset_offset_f1"), OFFSETS),
            ("median onset error", (1e3 * number("onset_error_median_secs")).abs(), LATE_MS),
            (F1, number("f1"), SCORE),
        ] {
            table.check(song, column, played, tolerance);
        }
        let due = number("matched") + number("missed");
        assert!(
            table.text(song, "notes right").ends_with(&format!("of {due}")),
            "{song}: {due} notes are due"
        );
    }
}

/// The songs on the twin in real execution.
fn real_execution() -> Table {
    let mut table = Table::read("docs/results/twin.md", "| song | mode | notes right, wrong |");
    table.rows.retain(|row| row[1] == "real");
    table
}

fn policies() -> Table {
    Table::read("docs/results/learning.md", "| song | notes right | wrong | onset F1 |")
}

#[test]
fn the_shipped_policies_play_what_the_documents_say() {
    check_notes(&policies(), |song| format!("--policy {}", shipped(song).display()));
    let report =
        Sandbox::new().json(&format!("play twinkle --policy {} -o out --json", shipped("twinkle").display()));
    assert_eq!(
        (report["matched"].as_u64(), report["wrong"].as_u64()),
        (Some(14), Some(0)),
        "the song of `make demo`"
    );
}

#[test]
fn the_scripted_baseline_plays_what_the_documents_say() {
    check_notes(
        &Table::read("docs/results/scripted.md", "| song | notes right | wrong | onset F1 |"),
        |_| "--scripted".to_string(),
    );
}

/// Of songs that it has not learned: notes right and wrong; onset F1; F1.
#[test]
fn the_sight_reader_plays_what_the_documents_say() {
    let table = Table::read("docs/results/sight-reading.md", SIGHT_HEAD);
    let policy = shipped(etude_lab::SIGHT_READER);
    assert!(std::fs::metadata(&policy).unwrap().len() < 10_000_000);
    let file = |row: &str| match root().join(format!("songs/{row}.mid")) {
        path if path.is_file() => Some(path.display().to_string()),
        _ => None,
    };
    let files = table.rows.iter().filter_map(|row| Some((row[0].clone(), file(&row[0])?)));
    let built_in = etude_music::repertoire::ids().map(|id| (id.to_string(), id.to_string()));
    let mut five = Vec::new();
    let mut seven = Vec::new();
    for (row, song) in built_in.chain(files) {
        let report = Sandbox::new().json(&format!("play {song} --policy {} -o out --json", policy.display()));
        let said: Vec<&str> = table.text(&row, SIGHT).split("; ").collect();
        let [right, wrong] = right_and_wrong(said[0]);
        let [is_right, is_wrong] = ["matched", "wrong"].map(|key| report[key].as_f64().unwrap());
        assert!(
            is_right >= right - RIGHT && is_wrong <= wrong + WRONG,
            "{row}: {}, but it is {is_right}, {is_wrong}",
            said[0]
        );
        for (said, key, tolerance) in [(said[1], "onset_f1", 2.0 * SCORE), (said[2], "f1", SCORE)] {
            let (said, played) = (leading_number(said), report[key].as_f64().unwrap());
            assert!(played >= said - tolerance, "{row}, {key}: {said}, but it is {played}");
        }
        if PAPER_SONGS.contains(&row.as_str()) {
            five.push(["matched", "missed", "wrong", "f1"].map(|key| report[key].as_f64().unwrap()));
        }
        if etude_music::repertoire::get(&row).is_some() {
            seven.push(report["f1"].as_f64().unwrap());
        }
    }
    let mean = seven.iter().sum::<f64>() / seven.len() as f64;
    assert!(seven.len() == 7 && mean >= 0.97, "{seven:?}");
    let sum = |column: usize| five.iter().map(|song| song[column]).sum::<f64>();
    let introduction = document("docs/introduction.md");
    let row = "| the same songs, zero-shot |";
    let row = cells(introduction.lines().find(|line| line.starts_with(row)).expect("it has such a row"));
    let [said_right, said_wrong] = right_and_wrong(&row[1]);
    assert!(row[1].contains(&format!("of {}, ", sum(0) + sum(1))), "docs/introduction.md: {}", row[1]);
    let readme = format!("of the songs | {} wrong | {} |", row[1], row[3]);
    assert!(document("README.md").contains(&readme), "README.md does not say `{readme}`");
    for (what, said, played, tolerance) in [
        ("right", said_right, sum(0), 2.0 * RIGHT),
        ("wrong", said_wrong, sum(2), 2.0 * WRONG),
        ("F1", leading_number(&row[2]), sum(3) / five.len() as f64, SCORE),
    ] {
        assert!(
            (said - played).abs() <= tolerance,
            "docs/introduction.md, zero-shot, {what}: {said}, but it is {played}"
        );
    }
}

/// Of melodies that no training draws: the sums of the notes and the mean F1.
#[test]
fn the_sight_reader_plays_the_test_melodies_as_the_documents_say() {
    let table = Table::read("docs/results/sight-reading.md", SIGHT_HEAD);
    let said: Vec<&str> = table.text("20 test melodies", SIGHT).split("; ").collect();
    let [right, wrong] = right_and_wrong(said[0]);
    let sandbox = Sandbox::new();
    let mut sums = [0.0; 4];
    for song in melodies(Split::Test, 0).take(20) {
        song.save(sandbox.path("melody.mid")).unwrap();
        let report = sandbox.json("play melody.mid --policy sight-reader -o out --json");
        for (sum, key) in sums.iter_mut().zip(["matched", "wrong", "onset_f1", "f1"]) {
            *sum += report[key].as_f64().unwrap();
        }
    }
    let [is_right, is_wrong, onset_f1, f1] = sums;
    assert!((is_right - right).abs() <= 15.0 && (is_wrong - wrong).abs() <= 8.0, "{}: {sums:?}", said[0]);
    assert!((onset_f1 / 20.0 - leading_number(said[1])).abs() <= 0.02, "{}: {sums:?}", said[1]);
    assert!((f1 / 20.0 - leading_number(said[2])).abs() <= 0.01, "{}: {sums:?}", said[2]);
}

/// Soft and loud: the correlation of played and written velocities, in simulation and on the twin.
#[test]
fn a_piece_with_dynamics_is_played_soft_and_loud() {
    let (song, policy) = (root().join("songs/surprise-symphony.mid"), shipped("surprise-symphony"));
    // Its own policy plays, although the sight-reader is predicted to play one note more.
    let report = Sandbox::new().json(&format!("play {} -o out --json", song.display()));
    let played = |report: &Value, key: &str| report[key].as_f64().unwrap();
    assert!(report["player"].as_str().unwrap().contains("surprise-symphony"), "{report}");
    assert!(played(&report, "velocity_correlation") >= 0.8, "{report}");
    assert!(played(&report, "matched") >= 53.0 && played(&report, "f1") >= 0.95, "{report}");
    let asked = format!("{} --policy {} -o out --json", song.display(), policy.display());
    for twin_params in ["mild", "standard"] {
        let report =
            Sandbox::new().json(&format!("perform {asked} --robot twin --twin-params {twin_params}"));
        assert!(played(&report["runs"][0], "velocity_correlation") >= 0.6, "{twin_params}: {report}");
    }
}

/// Real execution: notes right of those due, wrong ones; onset F1; the latency compensation; F1.
#[test]
fn the_shipped_policies_play_on_the_twin_what_the_documents_say() {
    let table = real_execution();
    for song in etude_music::repertoire::ids() {
        let sandbox = Sandbox::new();
        let report = sandbox
            .json(&format!("perform {song} --policy {} --robot twin -o out --json", shipped(song).display()));
        let number = |key: &str| report[key].as_f64().unwrap();
        table.check(song, "sent early by", 1e3 * number("latency_compensation_secs"), LATENCY_MS);
        table.check(song, "onset F1", number("onset_f1"), 2.0 * SCORE);
        table.check(song, F1, number("robot_f1"), SCORE);
        let [right, wrong] = right_and_wrong(table.text(song, "notes right, wrong"));
        assert!(
            (right - number("notes_right")).abs() <= RIGHT,
            "{song}: {right} right, but {}",
            number("notes_right")
        );
        assert!(
            (wrong - number("notes_wrong")).abs() <= 2.0 * WRONG,
            "{song}: {wrong} wrong, but {}",
            number("notes_wrong")
        );
    }
}

/// Sums and means elsewhere are those of the tables.
#[test]
fn the_sums_in_the_documents_are_those_of_the_tables() {
    let table = policies();
    let songs: Vec<_> = etude_music::repertoire::ids().collect();
    let paper = &PAPER_SONGS[..];
    let sum = |songs: &[&str], column| songs.iter().map(|song| table.number(song, column)).sum::<f64>();
    let mean = |songs: &[&str]| sum(songs, F1) / songs.len() as f64;
    let (all, five) = (mean(&songs), mean(paper));
    let [right, wrong] = ["notes right", "wrong"].map(|column| sum(&songs, column));
    let [five_right, five_wrong] = ["notes right", "wrong"].map(|column| sum(paper, column));
    // In real execution.
    let twin = real_execution();
    let on_twin = PAPER_SONGS.map(|song| {
        let [right, wrong] = right_and_wrong(twin.text(song, "notes right, wrong"));
        [right, wrong, twin.number(song, F1)]
    });
    let twin_sum = |column: usize| on_twin.iter().map(|song| song[column]).sum::<f64>();
    let (twin_right, twin_wrong, twin_f1) = (twin_sum(0), twin_sum(1), twin_sum(2) / on_twin.len() as f64);
    let twin_said =
        format!("{twin_right} of {five_right} notes right, {twin_wrong} wrong, and F1 {twin_f1:.3}");
    for (name, said) in [
        ("docs/results/learning.md", format!("All {right} notes, and {wrong} wrong one")),
        ("docs/results/learning.md", format!("the mean F1 is {all:.3}, of the paper's five songs {five:.3}")),
        (
            "docs/introduction.md",
            format!(
                "shipped policies (preset `fast`) | {five_right} of {five_right}, {five_wrong} | {five:.3} |"
            ),
        ),
        ("docs/introduction.md", format!("they play all {right} of the seven songs, and {wrong} wrong one")),
        ("README.md", twin_said.clone()),
        ("docs/introduction.md", twin_said),
        ("README.md", format!("By that rule they have F1 {five:.3}")),
    ] {
        assert!(unwrapped(name).contains(&said), "{name} does not say `{said}`");
    }
    let rules = Table::read("docs/robopianist.md", "| song | F1 (articulated plan) |");
    let rule = "F1 (RoboPianist's rule)";
    let by_rule = paper.iter().map(|song| rules.number(song, rule)).sum::<f64>() / paper.len() as f64;
    let readme = Table::of_any_rows("README.md", "| what plays | notes right, wrong |");
    let shipped = "[the shipped policies](docs/results/learning.md)";
    let notes = format!("{five_right} of {five_right}, {five_wrong} wrong");
    assert_eq!(readme.text(shipped, "notes right, wrong"), notes);
    assert_eq!(readme.text(shipped, rule), format!("{by_rule:.3}"));
}

/// What the README says of the degraded twin is what the tables of the pages say.
#[test]
fn the_readme_says_of_the_degraded_twin_what_the_pages_say() {
    let iterations = Table::of_any_rows("docs/results/rehearsals.md", "| mode, twin params | seeds |");
    let adaptation = Table::of_any_rows("docs/results/adaptation.md", "| twin parameters | songs |");
    let row = |table: &Table, begins: &[&str]| -> Vec<String> {
        let found = |row: &&Vec<String>| begins.iter().all(|cell| row.contains(&cell.to_string()));
        table.rows.iter().find(found).expect("the row").clone()
    };
    let [before, after] = ["before", "after"].map(|when| {
        let row = row(&iterations, &["real, worn", when]);
        let f1 = row[4].split(' ').next().unwrap().to_string();
        (format!("{f1}, RoboPianist's"), leading_number(&row[8]))
    });
    let [real, adapted] = ["real execution", "joint mirroring, adapted"].map(|how| {
        let row = row(&adaptation, &["`worn`", "the paper's five", how]);
        (format!("{}, articulated", row[5]), leading_number(&row[3]))
    });
    let readme = Table::of_any_rows("README.md", "| on `worn` | F1, by its rule |");
    let due = "of 116";
    for (row, (f1, right)) in readme.rows.iter().zip([before, after, real, adapted]) {
        assert_eq!(row[1..], [f1, format!("{right:.0} {due}")], "{}", row[0]);
    }
    assert_eq!(readme.rows.len(), 4);
}

/// What the front pages say of the paper's method and of ours beside it is what the rows say.
#[test]
fn the_front_pages_say_of_the_papers_method_what_was_measured() {
    let table = Table::of_any_rows("docs/results/paper.md", "| song | seeds | F1 (RoboPianist's rule)");
    let best = table.text("all", "F1 (RoboPianist's rule) of the best policy: mean (each)");
    let last = table.text("all", "last twenty: F1");
    // Rows of song, seed, step, F1: the first step at which the mean is the paper's.
    let mut by_step = std::collections::BTreeMap::<u32, Vec<f64>>::new();
    for line in document("docs/results/data/songs/course.csv").lines().skip(1) {
        let row: Vec<_> = line.split(',').collect();
        by_step.entry(row[2].parse().unwrap()).or_default().push(row[3].parse().unwrap());
    }
    let reached = |f1: &Vec<f64>| f1.len() == 15 && f1.iter().sum::<f64>() / 15.0 >= 0.946;
    let (step, _) = by_step.iter().find(|(_, f1)| reached(f1)).expect("the mean reaches it");
    for (name, said) in [
        ("README.md", format!("of the five songs have F1 {best}, the last evaluations {last} (one seed")),
        ("README.md", format!("0.946 by the same rule after {},000 steps", step / 1000)),
        ("docs/introduction.md", format!("| | {best} |")),
    ] {
        assert!(unwrapped(name).contains(&said), "{name} does not say `{said}`");
    }
}

/// The table is the one place for what a shipped policy plays; its file says the same.
#[test]
fn the_files_of_the_shipped_policies_claim_what_the_documents_say() {
    let table = policies();
    for song in etude_music::repertoire::ids() {
        let policy = etude_learn::Policy::load(&shipped(song)).unwrap();
        table.check(song, F1, policy.header().notes["scores"]["f1"].as_f64().unwrap(), SCORE);
    }
}
