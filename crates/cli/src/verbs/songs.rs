//! `etude songs`: the built-in songs, and the difficulty of a song.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::ValueHint;
use etude_lab::{Arrangement, ZeroShot, easier, find_song, policies, predict_zero_shot};
use etude_music::{
    CONTROL_HZ, Note, Remark, Song, Split, chords, is_named_midi, melody, pitch_name, repertoire,
    resolve_file, sound,
};
use etude_perform::shell_word;
use etude_task::fingering::UnplayedNote;
use etude_task::{Piece, TaskConfig};
use serde_json::json;

use crate::args::{self, ConfigArgs};
use crate::files::check_replaceable;
use crate::output::{VerbEnd, line, note, print_json};
use crate::status::planner;

/// Action on songs.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  etude songs
  etude songs show happy-birthday
  etude songs show my-song.mid --frames due.csv --preset paper
  etude songs arrange my-song.mid --transpose -12 -o my-song-lower.mid
  etude songs make --seed 7 -o melody.mid")]
pub struct Args {
    #[command(subcommand)]
    what: Option<What>,
    /// Print JSON: id, title, notes, secs, frames, policy
    #[arg(long)]
    json: bool,
}

#[derive(clap::Subcommand)]
enum What {
    /// Show one song: notes by bar, range, notes a second, hard places, and the predicted zero-shot
    /// score
    Show {
        /// A built-in id or a MIDI file
        #[arg(value_parser = args::song(), value_hint = ValueHint::FilePath, hide_possible_values = true)]
        song: String,
        /// Show a file's silence before its first note too
        #[arg(long)]
        keep_silence: bool,
        /// Write the keys due at each control step (20 a second) by this configuration to this CSV
        /// file: step,due
        #[arg(long, value_name = "OUT.csv")]
        frames: Option<PathBuf>,
        /// Write the reference sound to this WAV file
        #[arg(long, value_name = "OUT.wav")]
        reference: Option<PathBuf>,
        #[command(flatten)]
        config: ConfigArgs,
        /// Print JSON: title, notes, secs, frames, lowest, highest, notes_per_sec, busiest_second,
        /// bars, warnings, remarks (what of a file is not played as written), zero_shot (predicted
        /// notes_right and f1 of the shipped sight-reader), easier (an arrangement with fewer
        /// omitted notes: stretch, melody, notes, left_out), fingering
        #[arg(long)]
        json: bool,
    },
    /// Write a song in another key or tempo as a MIDI file; refused if a note is not on the
    /// keyboard
    Arrange {
        /// A built-in id or a MIDI file
        #[arg(value_parser = args::song(), value_hint = ValueHint::FilePath, hide_possible_values = true)]
        song: String,
        /// Keep a file's silence before its first note too
        #[arg(long)]
        keep_silence: bool,
        #[command(flatten)]
        changes: Changes,
        /// The new file
        #[arg(short, long, value_name = "OUT.mid")]
        out: PathBuf,
    },
    /// Write a random melody, as in the corpus of the sight-reader
    Make {
        /// Seed of the melody; with --part, the first seed from this one on whose melody is in that
        /// part
        #[arg(long, default_value_t = 0, value_name = "N")]
        seed: u64,
        /// Part of the corpus: training, validation (it selects the best policy) or test
        #[arg(long, value_name = "PART", value_parser = part)]
        part: Option<Split>,
        /// The new file
        #[arg(short, long, value_name = "OUT.mid")]
        out: PathBuf,
        /// Print JSON: seed, part, notes, secs
        #[arg(long)]
        json: bool,
    },
}

/// What an arrangement changes.
#[derive(clap::Args, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Changes {
    /// Semitones up, or down if negative
    #[arg(long, default_value_t = 0, value_name = "SEMITONES", allow_hyphen_values = true)]
    pub transpose: i32,
    /// Factor for the duration: 2 is half the tempo
    #[arg(long, default_value_t = 1.0, value_name = "FACTOR", allow_hyphen_values = true)]
    pub stretch: f64,
    /// Keep the upper voice alone: notes that begin below a sounding one are dropped
    #[arg(long)]
    pub melody: bool,
    /// Leave out the notes that the keyboard does not have
    #[arg(long)]
    pub within_range: bool,
}

impl Default for Changes {
    fn default() -> Self {
        Self { transpose: 0, stretch: 1.0, melody: false, within_range: false }
    }
}

impl Changes {
    /// The song with these changes.
    pub fn of(&self, song: &Song) -> anyhow::Result<Song> {
        let song = song.transpose(self.transpose)?.stretch(self.stretch)?;
        let song = if self.melody { song.upper_voice() } else { song };
        Ok(if self.within_range { song.within_range() } else { song })
    }

    /// The options of `etude songs arrange`.
    pub fn options(&self) -> Vec<String> {
        let mut options = Vec::new();
        if self.transpose != 0 {
            options.extend(["--transpose".to_string(), self.transpose.to_string()]);
        }
        if self.stretch != 1.0 {
            options.extend(["--stretch".to_string(), self.stretch.to_string()]);
        }
        let flags = [(self.melody, "--melody"), (self.within_range, "--within-range")];
        options.extend(flags.into_iter().filter(|(is_set, _)| *is_set).map(|(_, flag)| flag.to_string()));
        options
    }
}

fn part(text: &str) -> Result<Split, String> {
    Split::ALL
        .into_iter()
        .find(|part| part.to_string() == text)
        .ok_or_else(|| "it must be training, validation or test".to_string())
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<VerbEnd> {
    match args.what {
        None => list(args.json)?,
        Some(What::Show { song, keep_silence, frames, reference, config, json }) => {
            show(&song, keep_silence, frames, reference, &config.resolve()?.task, json || args.json)?;
        }
        Some(What::Arrange { song, keep_silence, changes, out }) => {
            arrange(&song, &changes.of(&find_song(&song, keep_silence)?)?, &out)?;
        }
        Some(What::Make { seed, part, out, json }) => make(seed, part, &out, json || args.json)?,
    }
    Ok(VerbEnd::Done)
}

fn list(as_json: bool) -> anyhow::Result<()> {
    let mut rows = Vec::new();
    if !as_json {
        line(format!("{:18} {:28} {:>5} {:>7} {:>7}  policy", "id", "title", "notes", "secs", "frames"))?;
    }
    for piece in repertoire::SONGS {
        let (id, song) = (piece.id, piece.song());
        let (title, notes, secs) = (song.title(), song.notes().len(), song.duration_secs());
        let frames = song.episode_frames(CONTROL_HZ, 1.0)?.len();
        let policy = !policies(id).is_empty();
        if as_json {
            rows.push(json!({
                "id": id, "title": title, "notes": notes, "secs": secs, "frames": frames, "policy": policy,
            }));
        } else {
            let policy = if policy { "yes" } else { "train it" };
            line(format!("{id:18} {title:28} {notes:>5} {secs:>7.1} {frames:>7}  {policy}"))?;
        }
    }
    if as_json {
        return print_json(&rows);
    }
    line("\nFrames are control steps at 20 Hz after one second of silence. `etude songs show ID` shows one.")
}

fn show(
    name: &str,
    keep_silence: bool,
    frames_csv: Option<PathBuf>,
    reference: Option<PathBuf>,
    task: &TaskConfig,
    as_json: bool,
) -> anyhow::Result<()> {
    let song = find_song(name, keep_silence)?;
    let is_true = |remark: &Remark| !keep_silence || !matches!(remark, Remark::Silence { .. });
    let remarks = resolve_file(name)?.remarks.into_iter().filter(is_true);
    let remarks: Vec<String> = remarks.map(|remark| remark.to_string()).collect();
    // Whether or not the policy is shown a fingering, it says what the hand cannot play.
    let task = &TaskConfig { fingering: true, ..task.clone() };
    frames_csv.iter().try_for_each(|path| check_replaceable(path, "step,due\n"))?;
    reference.iter().try_for_each(|path| check_replaceable(path, "WAVE"))?;
    let fits = song.check_range();
    let silence = task.initial_silence_secs;
    let mut planner = planner(as_json);
    let piece = fits.is_ok().then(|| planner.plan(&song, task)).transpose()?;
    let zero_shot = piece.as_ref().and_then(|piece| predict_zero_shot(&song, task, piece, &mut planner));
    let arrangement = piece.as_ref().and_then(|piece| easier(&song, task, piece, &mut planner));
    let frames = piece.as_ref().map_or(&[][..], Piece::frames);
    let limits = piece.as_ref().and_then(Piece::fingering).map(|fingering| fingering.unplayed());
    let position_of = |limit: &UnplayedNote| {
        // Control steps are rounded: the nearest note of this key is meant.
        let away = |note: &&Note| (note.start_secs + silence - limit.secs()).abs();
        let same = song.notes().iter().filter(|note| pitch_name(note.pitch) == limit.note());
        let secs = same.min_by(|a, b| away(a).total_cmp(&away(b))).map_or(0.0, |note| note.start_secs);
        (song.position(secs), secs)
    };
    let pitches = || song.notes().iter().map(|note| note.pitch);
    let (notes, secs) = (song.notes().len(), song.duration_secs());
    let (lowest, highest) = (pitches().min(), pitches().max());
    let pace = song.notes_per_sec();
    let busiest = song
        .busiest_second()
        .map(|second| (second.notes, song.position(second.start_secs), second.start_secs));
    let bars = bars(&song);
    let warnings = task.key_schedule.quick_repeats(&song);
    if as_json {
        print_json(&json!({
            "title": song.title(), "notes": notes, "secs": secs, "frames": frames.len(), "lowest": lowest,
            "highest": highest, "notes_per_sec": pace, "busiest_second": busiest.map(|(notes, place, secs)| {
                json!({"notes": notes, "bar": place.bar, "beat": place.beat, "secs": secs})
            }), "bars": bars.iter().map(|(bar, secs, chords)| {
                json!({"bar": bar, "secs": secs, "chords": chords})
            }).collect::<Vec<_>>(), "warnings": warnings, "remarks": remarks, "zero_shot": zero_shot, "easier": arrangement, "fingering": limits.map(|limits| json!({
                "summary": limits.to_string(),
                "limits": limits.notes.iter().map(|limit| {
                    let (place, secs) = position_of(limit);
                    json!({"bar": place.bar, "beat": place.beat, "secs": secs, "note": limit.note(), "leap": limit.is_leap(), "chord": limit.is_chord(), "what": limit.what()})
                }).collect::<Vec<_>>(),
            })),
        }))?;
    } else {
        let [lowest, highest] = [lowest, highest].map(|pitch| pitch.map_or_else(String::new, pitch_name));
        line(song.title())?;
        // A song outside the keyboard has no key schedule.
        let planned = piece.as_ref().map_or_else(String::new, |piece| {
            format!(", {} frames with {silence} s of silence first", piece.steps())
        });
        let are = if notes == 1 { "note" } else { "notes" };
        line(format!("{notes} {are} from {lowest} to {highest}, {secs:.1} s{planned}"))?;
        if let Some((notes, place, secs)) = busiest {
            line(format!("{pace:.1} notes a second; at most {notes} in one, from {place} ({secs:.2} s) on"))?;
        }
        line("Notes by bar; + joins a chord, the number is its length in beats")?;
        for (bar, _, chords) in bars {
            line(format!("  bar {bar:3}  {}", chords.join("  ")))?;
        }
        print_first(remarks.iter().map(|remark| format!("note: {remark}")))?;
        print_first(warnings.iter().map(|warning| format!("warning: {warning}")))?;
        if let Some(limits) = limits {
            line(format!("With three fingers: {limits}"))?;
            if let Some(ZeroShot { notes_right, f1 }) = zero_shot {
                line(format!("Predicted zero-shot: {notes_right} of {notes} notes, F1 {f1:.2}"))?;
            }
            let wide = limits.notes.iter().filter(|limit| limit.is_chord()).count();
            if wide > 0 {
                line(format!("Chords too wide, or of more notes than fingers: {wide}"))?;
            }
            if let Some(first) = limits.leaps().next() {
                let (place, secs) = position_of(first);
                let leaps = limits.leaps().count();
                line(format!(
                    "Omitted or shortened because of leaps: {leaps}, the first at {place} ({secs:.2} s)"
                ))?;
            }
            if let Some(Arrangement { stretch, melody, notes, left_out }) = arrangement {
                line(format!(
                    "Arranged by `etude songs arrange {} {} -o easier.mid`: {} of {notes} notes{}",
                    shell_word(name),
                    Changes { stretch, melody, ..Changes::default() }.options().join(" "),
                    notes - left_out,
                    if melody { " of the upper voice" } else { "" }
                ))?;
            }
            print_first(limits.notes.iter().map(|limit| {
                let (place, secs) = position_of(limit);
                format!("  {place} ({secs:.2} s): {} {}", limit.note(), limit.what())
            }))?;
        }
    }
    fits?;
    if let Some(path) = frames_csv {
        etude_perform::write_frames_csv(&path, frames, None)?;
        note(format!("The keys due at each control step are in {}", path.display()));
    }
    if let (Some(path), Some(piece)) = (reference, &piece) {
        sound::write_wav(&path, &sound::render(piece.notes(), None)?)?;
        note(format!("Listen: {}", path.display()));
    }
    Ok(())
}

/// Printed lines of a list.
const MAX_LINES: usize = 12;

/// Prints the first lines of a list, and the number of the others.
fn print_first(mut lines: impl ExactSizeIterator<Item = String>) -> anyhow::Result<()> {
    let more = lines.len().saturating_sub(MAX_LINES);
    lines.by_ref().take(MAX_LINES).try_for_each(line)?;
    if more > 0 {
        line(format!("  … and {more} more: --json has all"))?;
    }
    Ok(())
}

/// Number of each bar with notes, start of its first note (s), and its chords.
fn bars(song: &Song) -> Vec<(u32, f64, Vec<String>)> {
    let bar = |note: &Note| song.position(note.start_secs).bar;
    let bars = song.notes().chunk_by(|one, next| bar(one) == bar(next));
    bars.map(|notes| {
        let names = chords(notes).map(|chord| chord_name(song, chord)).collect();
        (bar(&notes[0]), notes[0].start_secs, names)
    })
    .collect()
}

/// A chord and the length of its longest note in beats: `C4+E4 2`.
fn chord_name(song: &Song, chord: &[Note]) -> String {
    let names: Vec<String> = chord.iter().map(|note| pitch_name(note.pitch)).collect();
    let secs = chord.iter().map(|note| note.end_secs - note.start_secs).fold(0.0, f64::max);
    let beats = secs / song.beats().beat_secs(chord[0].start_secs);
    format!("{} {}", names.join("+"), (beats * 100.0).round() / 100.0)
}

fn arrange(name: &str, song: &Song, out: &Path) -> anyhow::Result<()> {
    song.check_range()?;
    anyhow::ensure!(
        !song.notes().is_empty(),
        "no note of it is on the keyboard: transpose it with --transpose"
    );
    let same = |path: &Path| std::fs::canonicalize(path).ok();
    if same(out).is_some_and(|out| same(Path::new(name)) == Some(out)) {
        anyhow::bail!("{} is the song itself; choose another name with -o", out.display());
    }
    save(song, out)?;
    let (notes, secs) = (song.notes().len(), song.duration_secs());
    line(format!("{notes} notes, {secs:.1} s: learn it with `etude train {}`", shell_word(out.display())))
}

/// Writes a song; only a MIDI file is replaced.
fn save(song: &Song, out: &Path) -> anyhow::Result<()> {
    if !is_named_midi(out) {
        anyhow::bail!("cannot write {}: the name must end in .mid", out.display());
    }
    if out.is_file() && std::fs::read(out)? != song.to_midi() {
        anyhow::bail!(
            "{} exists, and holds something else: choose another name with -o, or remove the file",
            out.display()
        );
    }
    Ok(song.save(out)?)
}

fn make(seed: u64, part: Option<Split>, out: &Path, as_json: bool) -> anyhow::Result<()> {
    let is_wanted = |seed: &u64| part.is_none_or(|part| melody(*seed).split() == part);
    let seed =
        (seed..=u64::MAX).find(is_wanted).context("there is no melody of this part from that seed on")?;
    let song = melody(seed);
    save(&song, out)?;
    let (part, notes, secs) = (song.split().to_string(), song.notes().len(), song.duration_secs());
    if as_json {
        return print_json(&json!({ "seed": seed, "part": part, "notes": notes, "secs": secs }));
    }
    let file = shell_word(out.display());
    line(format!("{} for {part}: {notes} notes, {secs:.1} s: hear it with `etude play {file}`", song.title()))
}
