//! The table of `docs/robot.md`: what a person meets, what is said, and what to do. It is made from
//! the rows of the matrix, and from what the robot said in them.

use std::fmt::Write as _;

use crate::faults::End::{Fault, Stopped};
use crate::faults::{End, Row, WHENS, When};

const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/robot.md");
const BEGIN: &str = "<!-- faults -->\n";
const END: &str = "<!-- end of faults -->\n";
/// When set, the page gets the table.
const WRITE: &str = "ETUDE_WRITE_PAGE";

/// First words of what an operator receives as instructions.
const INSTRUCTIONS: [&str; 26] = [
    "bring",
    "calibrate",
    "check",
    "clear",
    "close",
    "connect",
    "disconnect",
    "do",
    "end",
    "let",
    "look",
    "make",
    "play",
    "press",
    "read",
    "release",
    "see",
    "set",
    "slow",
    "start",
    "stop",
    "switch",
    "type",
    "update",
    "use",
    "write",
];

/// What a message says, and what to do: all from the first instruction on.
fn parts(message: &str) -> (&str, &str) {
    let ends = message.match_indices([':', ';']).map(|(at, _)| at);
    let is_instruction = |at: &usize| {
        let words = message[at + 1..].trim_start().split(' ');
        words.clone().next().is_some_and(|word| INSTRUCTIONS.contains(&word))
    };
    let at = ends.clone().find(is_instruction);
    let at = at.unwrap_or_else(|| panic!("it does not say what to do: {message}"));
    (&message[..at], message[at + 1..].trim_start())
}

/// Within how many milliseconds the robot stands, while it follows a policy if the fault comes
/// then.
fn within(row: &Row) -> Option<u32> {
    let millis = |end: &End| match end {
        Fault(millis) => Some(*millis),
        _ => None,
    };
    let following = WHENS.iter().position(|when| *when == When::Following).unwrap();
    millis(&row.ends[following]).or_else(|| row.ends.iter().filter_map(millis).max())
}

/// A time, or the shortest and the longest of several.
fn times(mut within: Vec<u32>) -> String {
    let text = |millis: u32| match millis {
        0..1000 => format!("{millis} ms"),
        _ => format!("{:.1} s", f64::from(millis) / 1000.0),
    };
    within.sort_unstable();
    within.dedup();
    match within[..] {
        [] => "continues".to_string(),
        [one] => text(one),
        [least, .., most] => format!("{} to {}", text(least), text(most)),
    }
}

/// Numbers are those of one run, and differ a little where the world's arithmetic does.
fn without_numbers(text: &str) -> String {
    let mut last = ' ';
    let digits = text.replace(|c: char| c.is_ascii_digit(), "0");
    digits.chars().filter(|c| std::mem::replace(&mut last, *c) != '0' || *c != '0').collect()
}

/// Faults that end in the same words.
struct Group {
    names: Vec<&'static str>,
    said: String,
    within: Vec<u32>,
}

/// The table of these rows and of what was said in each. Faults that nothing is said of are left out.
fn table(said: impl Iterator<Item = (&'static Row, Option<String>)>) -> String {
    let mut groups: Vec<Group> = Vec::new();
    for (row, said) in said.filter(|(row, _)| !row.ends.contains(&Stopped)) {
        let Some(said) = said else { continue };
        let words = without_numbers(&said);
        let known = groups.iter().position(|group| without_numbers(&group.said) == words);
        let known = known.unwrap_or_else(|| {
            groups.push(Group { names: Vec::new(), said, within: Vec::new() });
            groups.len() - 1
        });
        groups[known].names.push(row.name);
        groups[known].within.extend(within(row));
    }
    let mut table =
        "| what happens | what is said | what to do | stopped within |\n|---|---|---|---|\n".to_string();
    for Group { names, said, within } in groups {
        let (said, remedy) = parts(&said);
        writeln!(table, "| {} | {said} | {remedy} | {} |", names.join("<br>"), times(within)).unwrap();
    }
    table
}

/// The page has the table; its numbers may be of another machine.
pub fn compare(said: impl Iterator<Item = (&'static Row, Option<String>)>) {
    let table = table(said);
    let page = std::fs::read_to_string(PAGE).unwrap();
    let (before, rest) = page.split_once(BEGIN).expect("the mark of the table");
    let (old, after) = rest.split_once(END).expect("the mark of its end");
    if std::env::var_os(WRITE).is_some() {
        std::fs::write(PAGE, [before, BEGIN, "\n", &table, "\n", END, after].concat()).unwrap();
    } else {
        assert_eq!(
            without_numbers(old.trim()),
            without_numbers(table.trim()),
            "the table of docs/robot.md is not what the robot says: \
             `{WRITE}=1 cargo test -p etude-robot --test safety matrix` writes it"
        );
    }
}
