//! `etude gallery`: an index page of recordings.

use std::collections::BTreeSet;
use std::path::PathBuf;

use etude_lab::{SongPlanner, choose_player, find_song, play};
use etude_music::repertoire;
use etude_perform::Job;
use etude_show::gallery::gallery;
use etude_show::replay::recordings;

use crate::output::{VerbEnd, line, note, print_json};
use crate::progress::stop_flag;
use crate::status::Status;

/// Folder of the recordings that the gallery makes itself.
const RECORDINGS: &str = "recordings";

/// Recordings and the folder of the pages.
#[derive(clap::Args)]
#[command(after_help = "\
Without recordings, each built-in song is played in simulation by its best policy.

Examples:
  etude gallery                               every built-in song
  etude gallery out runs/rehearse -o gallery  every recording in these folders")]
pub struct Args {
    /// Recordings (*.mcap), or folders that hold some, at any depth; of numbered results the latest
    #[arg(value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Folder of the pages
    #[arg(short = 'o', long = "out", default_value = "out/gallery", value_name = "DIR")]
    out: PathBuf,
    /// Print JSON: index, exhibits (recording, song, player, rig, mode, f1, notes, secs, replay,
    /// picture, roll, sound, incomplete), left_out, without_pictures
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<VerbEnd> {
    let stop = stop_flag()?;
    let mut status = Status::new(args.json);
    let mut paths = Vec::new();
    for path in &args.runs {
        paths.extend(recordings(path)?);
    }
    // The gallery's own recordings are left out.
    let own = args.out.join(RECORDINGS);
    let mut seen = BTreeSet::new();
    paths.retain(|path| !path.starts_with(&own) && seen.insert(path.clone()));
    if args.runs.is_empty() {
        let mut planner = SongPlanner::default();
        let ids: Vec<_> = repertoire::ids().collect();
        for (number, id) in ids.iter().enumerate() {
            show(&mut status, "playing", id, [number, ids.len()]);
            let folder = own.join(id);
            let song = find_song(id, false)?;
            let player = choose_player(id, id, &song, &mut planner)?.player;
            let played =
                play(&song, &player, &folder, None, &mut planner, &mut Job::new(&mut |_| {}, &stop))?;
            paths.push(played.files.recording);
        }
    }
    let mut tell = |number: &usize| {
        show(&mut status, "showing", &paths[*number].display().to_string(), [*number, paths.len()]);
    };
    let gallery = gallery(&paths, &args.out, &mut Job::new(&mut tell, &stop))?;
    drop(status);
    if args.json {
        print_json(&gallery)?;
        return Ok(VerbEnd::Done);
    }
    for exhibit in &gallery.exhibits {
        let f1 = exhibit.f1.map_or_else(|| "    -".to_string(), |f1| format!("{f1:.3}"));
        line(format!("{f1}  {:<28} {} {}", exhibit.song, exhibit.rig, exhibit.mode))?;
    }
    for exhibit in &gallery.exhibits {
        if let Some(text) = &exhibit.incomplete {
            note(format!("{}: {text}", exhibit.replay));
        }
    }
    for why in &gallery.left_out {
        note(format!("left out: {why}"));
    }
    if let Some(why) = &gallery.without_pictures {
        note(format!("piano rolls only: {why}"));
    }
    line(format!("Open in a browser: {}", gallery.index.display()))?;
    Ok(VerbEnd::Done)
}

/// Shows the next item and the time left.
fn show(status: &mut Status, phase: &str, what: &str, [number, all]: [usize; 2]) {
    status.part(phase, &format!(" {what} ({} of {all})", number + 1), number as f64 / all as f64);
}
