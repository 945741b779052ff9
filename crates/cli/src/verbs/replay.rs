//! `etude replay`: a page that shows and plays a recording.

use std::path::PathBuf;

use etude_lab::PAGE;
use etude_show::replay::{Take, read_take, recordings, replay_page};
use serde_json::json;

use crate::files::output_file;
use crate::output::{VerbEnd, line, note, note_incomplete, print_json};

/// Recordings and the page.
#[derive(clap::Args)]
#[command(after_help = "\
The page is one file and needs no network: open it in a browser, send it to a colleague. Two recordings, \
for example of the simulation and of the twin, are shown side by side, and the page marks where they \
differ.

Examples:
  etude replay out/twinkle
  etude replay out/twinkle out/twinkle-hybrid/1 -o both.html")]
pub struct Args {
    /// Recordings (*.mcap), or folders that hold some; of numbered results the latest
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// The page; by default replay.html beside the first recording, or compared.html if they are in
    /// several folders
    #[arg(short = 'o', long = "out", value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print JSON: page, bytes, and of each recording name, song, rig, mode, steps, f1, notes,
    /// marks, incomplete
    #[arg(long)]
    json: bool,
}

fn summary(take: &Take) -> serde_json::Value {
    json!({
        "name": take.name,
        "song": take.song,
        "rig": take.rig,
        "mode": take.mode,
        "steps": take.positions.len(),
        "f1": take.last.map(|scores| scores.f1),
        "notes": take.notes.len(),
        "marks": take.marks.len(),
        "incomplete": take.incomplete,
    })
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<VerbEnd> {
    let mut paths = Vec::new();
    for path in &args.recordings {
        paths.extend(recordings(path)?);
    }
    let takes = paths.iter().map(|path| read_take(path)).collect::<Result<Vec<_>, _>>()?;
    let page = match args.out {
        Some(folder) if folder.is_dir() => folder.join(PAGE),
        Some(page) => page,
        // The folder of the first recording may have its own page.
        None if paths.iter().any(|path| path.parent() != paths[0].parent()) => {
            paths[0].with_file_name("compared.html")
        }
        None => paths[0].with_file_name(PAGE),
    };
    let page = output_file(page, "html", "the name must end in .html")?;
    replay_page(&takes, &page)?;
    let bytes = std::fs::metadata(&page)?.len();
    if takes.iter().any(|take| !take.has_the_notes_of(&takes[0])) {
        note(
            "the recordings are not all of the same notes, so the marks of their differences mean nothing; choose recordings of one song",
        );
    }
    if args.json {
        let summaries: Vec<_> = takes.iter().map(summary).collect();
        print_json(&json!({ "page": page, "bytes": bytes, "takes": summaries }))?;
        return Ok(VerbEnd::Done);
    }
    note_incomplete(&takes);
    line(format!("Open in a browser: {} ({:.1} MB)", page.display(), bytes as f64 * 1e-6))?;
    Ok(VerbEnd::Done)
}
