//! `etude evaluate`: how well a policy plays in many worlds.

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::sync::{Mutex, PoisonError};

use clap::ValueHint;
use etude_lab::{RobustnessConfig, RobustnessReport, SONG, ScoreSummary, evaluate_robustness, find_song};

use crate::args::{self, PlayerArgs};
use crate::output::{VerbEnd, line, note, print_json};
use crate::progress::stop_flag;
use crate::status::{Status, planner};

/// Number of parameters that are printed; the JSON has all.
const MAX_SHOWN: usize = 8;

/// Song, player and worlds.
#[derive(clap::Args)]
#[command(after_help = "\
The worlds are evenly spread over the parameters that the policy's configuration randomises (the paper's \
seven quantities, or task.randomisation.widths). They depend on --worlds, --intensity and --seed alone. \
DIR/1/worlds.csv has one line a world: world, player, f1, precision, recall, pooled_f1, notes_right, \
notes_wrong, onset_f1, collision_free, then every parameter that varies. The next evaluation goes to \
DIR/2, and DIR/latest links to the last one.

Examples:
  etude evaluate twinkle
  etude evaluate twinkle --policy runs/twinkle__fast__0 --worlds 128 --intensity 0.6
  etude evaluate twinkle --set task.randomisation.widths.joint.fingers.damping=0.02 --intensity 1")]
pub struct Args {
    /// A built-in id (see `etude songs`) or a MIDI file
    #[arg(value_parser = args::song(), value_hint = ValueHint::FilePath, hide_possible_values = true)]
    song: String,
    /// Play a file's silence before its first note too
    #[arg(long)]
    keep_silence: bool,
    #[command(flatten)]
    player: PlayerArgs,
    /// Number of worlds beside the nominal one
    #[arg(long, default_value_t = 64, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    worlds: u32,
    /// Randomisation intensity, the paper's C_dr, 0 to 1
    #[arg(long, default_value_t = 0.5, value_name = "C")]
    intensity: f64,
    /// Seed of the set of worlds
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Folder of the numbered results; by default out/SONG-worlds, or out/SONG-PLAYER-worlds if a
    /// player is chosen
    #[arg(short = 'o', long = "out", value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print JSON: notes_due; nominal, mean, worst_decile and worst, of each notes_right,
    /// notes_wrong, onset_error_secs and f1; marginals (path, range, f1 by thirds), scores, csv
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<VerbEnd> {
    let song = find_song(&args.song, args.keep_silence)?;
    song.check_range()?;
    let mut planner = planner(args.json);
    let player = args.player.load(&args.song, &song, &mut planner)?;
    let default = Path::new("out").join(args.player.folder_name(&args.song) + "-worlds");
    let out = args.out.unwrap_or_else(|| args::folder_of(&song, default));
    let config =
        RobustnessConfig { worlds: args.worlds as usize, intensity: args.intensity, seed: args.seed };
    let stop = stop_flag()?;
    let status = Mutex::new(Status::late(args.json));
    let watch = |done: usize| {
        let share = done as f64 / (f64::from(args.worlds) + 1.0);
        let mut status = status.lock().unwrap_or_else(PoisonError::into_inner);
        status.part("playing", &format!(", {done} worlds done"), share);
        !stop.load(Ordering::Relaxed)
    };
    let report = evaluate_robustness(&song, &player, &config, &mut planner, &watch)?;
    drop(status);
    let Some(mut report) = report else {
        note("stopped; nothing was written");
        return Ok(VerbEnd::Stopped);
    };
    report.write_csv(&out)?;
    if let Some(csv) = &report.csv {
        song.save(csv.with_file_name(SONG))?;
    }
    if args.json {
        print_json(&report)?
    } else {
        print(&report)?
    }
    Ok(VerbEnd::Done)
}

fn print(report: &RobustnessReport) -> anyhow::Result<()> {
    line(format!(
        "{} played by {} in {} worlds of intensity {}",
        report.song, report.player, report.config.worlds, report.config.intensity
    ))?;
    line(format!("{:16} {:>16} {:>7} {:>8} {:>8}", "", "notes right", "wrong", "late", "F1"))?;
    for (name, scores) in [
        ("nominal world", report.nominal),
        ("mean", report.mean),
        ("worst tenth", report.worst_decile),
        ("worst world", report.worst),
    ] {
        let ScoreSummary { notes_right: right, notes_wrong: wrong, onset_error_secs: late, f1 } = scores;
        let notes = format!("{right:.1} of {}", report.notes_due);
        let late = late.map_or_else(String::new, |secs| format!("{:+.0} ms", 1e3 * secs));
        line(format!("{name:16} {notes:>16} {wrong:>7.1} {late:>8} {f1:>8.3}"))?;
    }
    let mut marginals: Vec<_> = report.marginals.iter().collect();
    let swing =
        |f1: [f64; 3]| f1.iter().copied().fold(0.0, f64::max) - f1.iter().copied().fold(1.0, f64::min);
    marginals.sort_by(|a, b| swing(b.f1).total_cmp(&swing(a.f1)));
    if !marginals.is_empty() {
        line(format!("\n{:34} {:>21} {:>24}", "most influential", "range", "F1 low  middle  high"))?;
    }
    for marginal in marginals.into_iter().take(MAX_SHOWN) {
        let [low, middle, high] = marginal.f1;
        let range = format!("{:.4} … {:.4}", marginal.range[0], marginal.range[1]);
        line(format!("{:34} {range:>21} {low:>10.3} {middle:>6.3} {high:>6.3}", marginal.path))?;
    }
    if let Some(csv) = &report.csv {
        line(format!("\nEvery world: {}", csv.display()))?;
    }
    Ok(())
}
