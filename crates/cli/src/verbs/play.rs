//! `etude play`: play a song with a trained policy.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::ValueHint;
use etude_lab::{PlayReport, find_song, play};
use etude_music::metrics::NoteScores;
use etude_music::sound::SoundFont;
use etude_perform::{Job, NoteCounts, Scores};

use crate::args::{self, PlayerArgs};
use crate::output::{VerbEnd, line, print_json};
use crate::progress::stop_flag;
use crate::status::{Status, planner};

/// Song, player and output of a performance.
#[derive(clap::Args)]
#[command(after_help = "\
The default policy is the best one of this song that is shipped or in a run under runs/, unless the \
sight-reader is predicted to play better.

Files: performance.mid and performance.wav (as played), reference.wav (as written), frames.csv \
(step,due,pressed: MIDI numbers of the keys due and pressed at each control step), recording.mcap, \
report.json, song.mid. They are in DIR/1 for the first performance, DIR/2 for the next: none is replaced. \
DIR/latest links to the last one, which `replay`, `compare` and `render` take if they are given DIR.

Examples:
  etude play twinkle
  etude play my-song.mid --policy runs/my-song__fast__0 -o out/mine")]
pub struct Args {
    /// A built-in id (see `etude songs`) or a MIDI file
    #[arg(value_parser = args::song(), value_hint = ValueHint::FilePath, hide_possible_values = true)]
    song: String,
    /// Play a file's silence before its first note too
    #[arg(long)]
    keep_silence: bool,
    #[command(flatten)]
    player: PlayerArgs,
    /// Folder of the numbered results; if not given out/SONG, with the player if it is not the best
    /// policy for the song
    #[arg(short = 'o', long = "out", value_name = "DIR")]
    out: Option<PathBuf>,
    /// A SoundFont (.sf2) for the sound; a built-in piano tone if not given
    #[arg(long, value_name = "FILE")]
    soundfont: Option<PathBuf>,
    /// Print JSON: precision, recall, f1, pooled_f1, onset_f1, onset_offset_f1, matched, missed,
    /// wrong, files, …
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<VerbEnd> {
    let song = find_song(&args.song, args.keep_silence)?;
    song.check_range()?;
    let stop = stop_flag()?;
    let mut planner = planner(args.json);
    let player = args.player.load(&args.song, &song, &mut planner)?;
    let font = args.soundfont.as_deref().map(SoundFont::load).transpose().context("no sound")?;
    let folder = args.out.unwrap_or_else(|| {
        args::folder_of(&song, Path::new("out").join(args.player.folder_name(&args.song)))
    });
    let mut status = Status::late(args.json);
    let mut on_progress = |share: &f64| status.share("playing", *share);
    let mut job = Job::new(&mut on_progress, &stop);
    let report = play(&song, &player, &folder, font.as_ref(), &mut planner, &mut job)?;
    drop(status);
    if args.json {
        print_json(&report)?
    } else {
        print(&report)?
    }
    Ok(VerbEnd::Done)
}

/// The scores by note in one line.
pub(super) fn note_summary(note: &NoteScores) -> String {
    let error = note.onset_error_median_secs.zip(note.onset_error_p95_secs);
    let error = error.map_or_else(String::new, |(median, p95)| {
        format!("; median onset error {:+.0} ms, 95 % within {:.0} ms", median * 1e3, p95 * 1e3)
    });
    let loudness = note.velocity_correlation.map_or_else(String::new, |correlation| {
        format!(
            "; velocity correlation {correlation:.2}, onset F1 with velocity {:.3}",
            note.onset_velocity_f1
        )
    });
    format!("{}{error}{loudness}", NoteCounts::from(note))
}

fn print(report: &PlayReport) -> anyhow::Result<()> {
    let Scores { frame, note, .. } = &report.scores;
    line(format!("{} played by {}, {} control steps", report.song, report.player, report.steps))?;
    line(note_summary(note))?;
    line(format!("{:22} {:>9} {:>9} {:>9}", "", "precision", "recall", "F1"))?;
    let row = |name: &str, values: [f64; 3]| {
        line(format!("{name:22} {:>9.3} {:>9.3} {:>9.3}", values[0], values[1], values[2]))
    };
    row("notes, onset", [note.onset_precision, note.onset_recall, note.onset_f1])?;
    row(
        "notes, onset + offset",
        [note.onset_offset_precision, note.onset_offset_recall, note.onset_offset_f1],
    )?;
    row("by control step", [frame.precision, frame.recall, frame.f1])?;
    line(format!("{:22} {:>29.3}", "by RoboPianist's rule", report.scores.robopianist_f1))?;
    row("pooled over key-time", [frame.pooled_precision, frame.pooled_recall, frame.pooled_f1])?;
    if let Some(limits) = &report.limits {
        line(limits)?;
    }
    let files = &report.files;
    line(format!("Listen: {}", files.wav.display()))?;
    line(format!("        {} (as written)", files.reference.display()))?;
    for path in [&files.midi, &files.frames, &files.recording].into_iter().chain(&files.report) {
        line(format!("        {}", path.display()))?;
    }
    Ok(())
}
