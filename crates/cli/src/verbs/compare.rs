//! `etude compare`: two performances of one piece, note by note.

use std::path::PathBuf;

use etude_music::pitch_name;
use etude_show::compare::{Comparison, Stroke};
use etude_show::replay::{Take, TakeNote, read_take, recording, replay_page};
use serde_json::json;

use super::play::note_summary;
use crate::files::output_file;
use crate::output::{VerbEnd, line, note_incomplete, print_json};

/// The two performances, and the page.
#[derive(clap::Args)]
#[command(after_help = "\
Onset, length: played minus due, in ms; late and long are positive. A note marked ! is more than 50 ms early or \
late: it counts as missed and its stroke as wrong. Velocity: MIDI, 1 to 127.

Examples:
  etude compare out/twinkle out/twinkle-real
  etude compare before.mcap after.mcap -o both.html   # and a page with both, to see and to hear")]
pub struct Args {
    /// A recording (*.mcap), or a folder that holds one; of numbered results the latest
    #[arg(value_name = "A")]
    one: PathBuf,
    /// Another one of the same piece
    #[arg(value_name = "B")]
    other: PathBuf,
    /// Also write a replay page that shows and plays both
    #[arg(short = 'o', long = "out", value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print JSON: a and b (name, player, scores), notes (due_secs, name, played: onset_error_secs,
    /// …), strays, page
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<VerbEnd> {
    let takes = [read_take(&recording(&args.one)?)?, read_take(&recording(&args.other)?)?];
    let comparison = Comparison::new(&takes[0], &takes[1])?;
    let page = args.out.map(|page| output_file(page, "html", "the name must end in .html")).transpose()?;
    if let Some(page) = &page {
        replay_page(&takes, page)?;
    }
    if args.json {
        let [a, b] = takes.each_ref().map(summary);
        let Comparison { notes, strays } = &comparison;
        print_json(&json!({ "a": a, "b": b, "notes": notes, "strays": strays, "page": page }))?;
    } else {
        print(&takes, &comparison)?;
        if let Some(page) = &page {
            line(format!("Open in a browser: {}", page.display()))?;
        }
    }
    Ok(VerbEnd::Done)
}

fn summary(take: &Take) -> serde_json::Value {
    json!({ "name": take.name, "song": take.song, "player": take.player, "rig": take.rig, "mode": take.mode,
              "notes": take.note_scores, "frames": take.last })
}

fn print(takes: &[Take; 2], comparison: &Comparison) -> anyhow::Result<()> {
    line(&takes[0].song)?;
    for (letter, take) in ["A", "B"].into_iter().zip(takes) {
        let what = [&take.rig, &take.mode, &take.who].map(String::as_str);
        let what: Vec<&str> = what.into_iter().filter(|text| !text.is_empty()).collect();
        line(format!("{letter}  {} ({})", take.name, what.join(" · ")))?;
        let f1 = take.last.map_or_else(String::new, |frame| format!("; F1 {:.3}", frame.f1));
        line(format!("   {}{f1}", take.note_scores.as_ref().map_or_else(String::new, note_summary)))?;
    }
    line("")?;
    line(format!("{:>18}{:^28}{:^28}", "", "A", "B"))?;
    let heads = format!("{:>9} {:>7} {:>9} ", "onset", "length", "velocity");
    line(format!("{:>9}  {:7}{heads}{heads}", "due", "note").trim_end())?;
    for due in &comparison.notes {
        let [a, b] = due.played.map(cells);
        line(format!("{:>7.2} s  {:7}{a}{b}", due.due_secs, due.name).trim_end())?;
    }
    for (letter, strays) in ["A", "B"].into_iter().zip(&comparison.strays) {
        if !strays.is_empty() {
            let strokes: Vec<String> = strays.iter().map(stray_text).collect();
            line(format!("Wrong strokes of {letter}: {}", strokes.join(", ")))?;
        }
    }
    note_incomplete(takes);
    Ok(())
}

fn cells(stroke: Option<Stroke>) -> String {
    let Some(stroke) = stroke else { return format!("{:>9} {:>7} {:>9} ", "missed", "", "") };
    let mark = if stroke.right { ' ' } else { '!' };
    let (onset, length) = (stroke.onset_error_secs * 1e3, stroke.length_error_secs * 1e3);
    format!("{:>8} {:>7} {:>9} ", format!("{onset:+.0}{mark}"), format!("{length:+.0}"), stroke.velocity)
}

fn stray_text(note: &TakeNote) -> String {
    format!("{} at {:.2} s for {:.0} ms", pitch_name(note.pitch), note.start, (note.end - note.start) * 1e3)
}
