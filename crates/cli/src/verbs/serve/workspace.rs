//! The working folder: its songs, performances, comparisons and trainings. All of them are files,
//! so a new server finds them again.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

use etude_lab::{
    LATEST, LoadedPlayer, PAGE, RECORDING, REPORT, SongPlanner, all_results, choose_player, find_song,
};
use etude_music::{Song, SongError, is_named_midi, repertoire};
use etude_perform::write_file;
use etude_show::watch::{Point, RunFigures, WatchedRun, runs_in};
use hyper::StatusCode;
use serde::Serialize;
use serde_json::{Value, json};

use super::message::ApiError;
use crate::args::slug;

/// Folder of the uploaded songs, and of the output of `etude songs show`.
pub const SONGS: &str = "out/songs";
/// Folder of the comparisons.
pub const COMPARED: &str = "out/compared";
/// Folders of MIDI files that are offered.
const MIDI_FOLDERS: [&str; 2] = ["songs", SONGS];
const PERFORMANCES: &str = "out";
const RUNS: &str = "runs";
/// Performances and comparisons that are listed, the last ones.
const MAX_LISTED: usize = 40;
/// Trainings that are listed, with their curves.
const MAX_RUNS: usize = 12;
const MAX_CURVE_POINTS: usize = 300;
const MAX_NAME_CHARS: usize = 60;

/// A song that can be chosen.
#[derive(Clone, Debug, Serialize)]
pub struct ListedSong {
    /// Its id or path.
    pub song: String,
    pub title: String,
}

/// A performance.
pub struct Performance {
    pub recording: PathBuf,
    modified: Option<SystemTime>,
    /// Its files and scores, for the page.
    pub about: Value,
}

/// A training with its curves.
#[derive(Debug, Serialize)]
pub struct Training {
    #[serde(flatten)]
    pub figures: RunFigures,
    /// F1 of the evaluations: control steps and value.
    f1: Vec<[f64; 2]>,
    /// Reward per control step.
    reward_curve: Vec<[f64; 2]>,
}

/// The folder in which the server works. Paths are relative to it.
pub struct Workspace {
    pub root: PathBuf,
    watched: Mutex<BTreeMap<PathBuf, WatchedRun>>,
    /// Held while a song is added, so that two get different names.
    adding: Mutex<()>,
}

impl Workspace {
    pub fn new(root: PathBuf) -> Self {
        Self { root, watched: Mutex::default(), adding: Mutex::default() }
    }

    /// The built-in songs, then the MIDI files.
    pub fn songs(&self) -> Vec<ListedSong> {
        let built_in = repertoire::SONGS
            .iter()
            .map(|piece| ListedSong { song: piece.id.into(), title: piece.title.into() });
        let mut files: Vec<PathBuf> = MIDI_FOLDERS.into_iter().flat_map(entries).collect();
        files.retain(|path| is_named_midi(path) && path.is_file());
        files.sort();
        let stem = |path: &Path| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let files = files
            .iter()
            .filter_map(|path| Some(ListedSong { song: path.to_str()?.into(), title: stem(path) }));
        built_in.chain(files).collect()
    }

    /// A listed song.
    pub fn song(&self, song: &str) -> Result<(ListedSong, Song), ApiError> {
        let listed = self.songs().into_iter().find(|listed| listed.song == song);
        let listed = listed.ok_or_else(|| {
            ApiError::not_found(format!("there is no song `{song}` any more; reload the page"))
        })?;
        let song = find_song(song, false).map_err(anyhow::Error::from)?;
        Ok((listed, song))
    }

    /// Saves the uploaded MIDI file `name`; gives the path of the song.
    pub fn add_song(&self, name: &str, bytes: &[u8]) -> Result<String, ApiError> {
        let stem = tidy(name);
        Song::from_midi(bytes, &stem).map_err(|error| {
            ApiError::new(StatusCode::UNPROCESSABLE_ENTITY, format!("{name} cannot be used: {error}"))
        })?;
        let _adding = self.adding.lock().unwrap_or_else(PoisonError::into_inner);
        let is_same = |listed: &ListedSong| std::fs::read(&listed.song).is_ok_and(|theirs| theirs == bytes);
        match self.free_name(&stem, is_same) {
            Err(same) => Ok(same),
            Ok(path) => {
                make_folder(SONGS)?;
                write_file(Path::new(&path), bytes).map_err(anyhow::Error::from)?;
                Ok(path)
            }
        }
    }

    /// A path for a new song `stem`, numbered if another song has the same slug; `Err` is the song
    /// with this slug that `is_same`.
    pub fn free_name(&self, stem: &str, is_same: impl Fn(&ListedSong) -> bool) -> Result<String, String> {
        let known = self.songs();
        for number in 1.. {
            let name = if number == 1 { stem.to_string() } else { format!("{stem} {number}") };
            let path = format!("{SONGS}/{name}.mid");
            match known.iter().find(|listed| slug(&listed.song) == slug(&path)) {
                Some(same) if is_same(same) => return Err(same.song.clone()),
                Some(_) => {}
                None => return Ok(path),
            }
        }
        unreachable!("some number is free")
    }

    /// A song before anything runs: whether the keyboard has its notes, which policy would play it,
    /// and where the output of `etude songs show` is.
    pub fn describe(&self, song: &str) -> Result<Value, ApiError> {
        let (listed, notes) = self.song(song)?;
        let (about, reference) = analysis_files(song);
        let problem = notes.check_range().err();
        let (outside, transpositions) = match &problem {
            Some(SongError::OutOfRange(range)) => (range.notes.len(), range.transpositions.clone()),
            _ => (0, Vec::new()),
        };
        // The output may be of an older file, or of another song with the same slug.
        let is_new = |path: &String| {
            let made = modified(Path::new(path));
            made.is_some() && made >= modified(Path::new(song))
        };
        let analysis = || serde_json::from_slice::<Value>(&std::fs::read(&about).ok()?).ok();
        let is_ready = [&about, &reference].into_iter().all(is_new)
            && analysis().is_some_and(|analysis| analysis["title"] == notes.title());
        let player = choose_player(song, &slug(song), &notes, &mut SongPlanner::default())
            .ok()
            .map(|chosen| chosen.player);
        Ok(json!({
            "song": song, "title": listed.title, "about": about, "reference": reference,
            "is_ready": is_ready,
            "problem": problem.map(|error| error.to_string()), "transpositions": transpositions,
            "outside": outside, "notes": notes.notes().len(),
            "policy": player.as_ref().map(LoadedPlayer::name),
            "zero_shot": player.as_ref().is_some_and(LoadedPlayer::is_sight_reader),
            "policy_f1": player.and_then(|player| player.claimed_f1),
        }))
    }

    /// The performances, the last one first.
    pub fn performances(&self) -> Vec<Performance> {
        let mut folders = entries(PERFORMANCES);
        // A link to one of them.
        folders.retain(|folder| !folder.ends_with(LATEST));
        let results = folders.iter().flat_map(|folder| all_results(folder));
        let mut found: Vec<Performance> = results.flat_map(|result| performed(&result)).collect();
        found.sort_by(|a, b| b.modified.cmp(&a.modified).then(a.recording.cmp(&b.recording)));
        found.truncate(MAX_LISTED);
        found
    }

    /// The comparisons, output of `etude compare --json` with a page; the last one first.
    pub fn comparisons(&self) -> Vec<PathBuf> {
        let mut found = entries(COMPARED);
        found.retain(|path| {
            path.extension().is_some_and(|extension| extension == "json")
                && path.with_extension("html").is_file()
        });
        found.sort_by_key(|path| std::cmp::Reverse(modified(path)));
        found.truncate(MAX_LISTED);
        found
    }

    /// The trainings, the last one first.
    pub fn runs(&self) -> Vec<Training> {
        let found = runs_in(Path::new(RUNS)).into_iter().map(|(_, folder)| folder);
        let folders: Vec<PathBuf> = found.take(MAX_RUNS).collect();
        let mut watched = self.watched.lock().unwrap_or_else(PoisonError::into_inner);
        watched.retain(|folder, _| folders.contains(folder));
        let training = |folder: &PathBuf| {
            let run = watched.entry(folder.clone()).or_insert_with(|| WatchedRun::open(folder));
            // A file that cannot be read now is tried again with the next request.
            let _ = run.read();
            let history = run.history();
            Training {
                figures: run.figures(SystemTime::now()),
                f1: curve(&history.f1),
                reward_curve: curve(&history.reward),
            }
        };
        folders.iter().map(training).collect()
    }
}

/// The files of the output of `etude songs show` and of the reference sound.
pub fn analysis_files(song: &str) -> (String, String) {
    let mut name = slug(song);
    // A file name may have no ASCII letter.
    if name.is_empty() {
        name = "song".to_string();
    }
    (format!("{SONGS}/{name}.json"), format!("{SONGS}/{name}.wav"))
}

/// The replay page of a recording: each run of a performance has its own.
pub fn replay_page(recording: &Path) -> PathBuf {
    if recording.file_name().is_some_and(|name| name == RECORDING) {
        recording.with_file_name(PAGE)
    } else {
        recording.with_extension("html")
    }
}

/// Makes a folder in the working folder.
pub fn make_folder(folder: &str) -> Result<(), ApiError> {
    Ok(etude_lab::make_folder(Path::new(folder))?)
}

/// A file name without folder and extension, of letters, digits and a few signs.
fn tidy(name: &str) -> String {
    let name = name.rsplit(['/', '\\']).next().unwrap_or_default();
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    let plain: String =
        stem.chars().map(|c| if c.is_alphanumeric() || "-_()".contains(c) { c } else { ' ' }).collect();
    let words: Vec<&str> = plain.split_whitespace().collect();
    let text: String = words.join(" ").chars().take(MAX_NAME_CHARS).collect();
    let text = text.trim_matches(|c: char| !c.is_alphanumeric() && c != ')');
    if text.is_empty() { "song".to_string() } else { text.to_string() }
}

/// The entries of a folder with Unicode names; none if there is no folder.
fn entries(folder: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).filter(|path| path.to_str().is_some()).collect()
}

fn modified(path: &Path) -> Option<SystemTime> {
    path.metadata().and_then(|data| data.modified()).ok()
}

/// The performances in a folder of `etude play` or `etude perform`, from its report.
fn performed(folder: &Path) -> Vec<Performance> {
    let report = std::fs::read(folder.join(REPORT)).ok();
    let report = report.and_then(|bytes| serde_json::from_slice::<Value>(&bytes).ok()).unwrap_or_default();
    let runs = report["runs"].as_array().cloned().unwrap_or_else(|| vec![report.clone()]);
    let one = |run: &Value| {
        // The folder may have been moved.
        let file = |key: &str| Some(folder.join(Path::new(run["files"][key].as_str()?).file_name()?));
        let recording = file("recording").filter(|path| path.is_file())?;
        let made = modified(&recording);
        let page = Some(replay_page(&recording)).filter(|page| modified(page) >= made && page.is_file());
        let due = run["matched"].as_u64().zip(run["missed"].as_u64()).map(|(right, missed)| right + missed);
        let about = json!({
            "recording": recording, "wav": file("wav")?, "reference": file("reference")?,
            "page": page, // If there is one.
            "song": report["song"].as_str()?, "player": report["player"].as_str()?,
            "mode": report["mode"], // None in simulation.
            "f1": run["f1"],
            "notes_right": run["matched"], "notes_due": due, "notes_wrong": run["wrong"],
        });
        Some(Performance { modified: made, about, recording })
    };
    runs.iter().filter_map(one).collect()
}

/// At most [`MAX_CURVE_POINTS`] points of a curve, evenly chosen, with the last one.
fn curve(points: &[Point]) -> Vec<[f64; 2]> {
    let every = points.len().div_ceil(MAX_CURVE_POINTS).max(1);
    let chosen = points.iter().rev().step_by(every).rev();
    chosen.map(|point| [point.step, (point.value * 1e4).round() / 1e4]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uploaded_files_get_safe_names() {
        for (name, expected) in [
            ("Für Elise.mid", "Für Elise"),
            ("../../etc/passwd.mid", "passwd"),
            ("C:\\Music\\My Song.MID", "My Song"),
            ("-o out.mid", "o out"),
            (".hidden.mid", "hidden"),
            ("a\0b\nc<img>.mid", "a b c img"),
            ("песня.mid", "песня"),
            ("", "song"),
            ("...", "song"),
        ] {
            assert_eq!(tidy(name), expected, "{name:?}");
        }
        assert_eq!(tidy(&"x".repeat(500)).len(), MAX_NAME_CHARS);
    }

    #[test]
    fn long_curves_are_thinned() {
        let points = |count: u32| -> Vec<Point> {
            (0..count).map(|step| Point { step: f64::from(step), secs: 0.0, value: 0.5 }).collect()
        };
        assert_eq!(curve(&points(3)), [[0.0, 0.5], [1.0, 0.5], [2.0, 0.5]]);
        let thinned = curve(&points(1000));
        assert!(thinned.len() <= MAX_CURVE_POINTS && thinned.last() == Some(&[999.0, 0.5]));
        assert!(curve(&[]).is_empty());
    }
}
