//! The API: from a request of the page to the job that does it.

use std::path::{Path, PathBuf};

use etude_lab::{LATEST, RECORDING, folder_of_song, run_file};
use etude_perform::Mode;
use etude_show::watch::RunState;
use serde::Deserialize;

use super::super::perform::performance_name;
use super::super::songs::Changes;
use super::jobs::{JobSpec, Step};
use super::message::ApiError;
use super::workspace::{COMPARED, ListedSong, SONGS, Workspace, analysis_files, make_folder, replay_page};
use crate::args::{PlayerArgs, slug};

/// A button of the page, with its settings.
#[derive(Deserialize)]
#[serde(tag = "verb", rename_all = "snake_case", deny_unknown_fields)]
pub enum ApiRequest {
    Show { song: String },
    Arrange { song: String, changes: Changes },
    Play { song: String, player: PlayerChoice },
    Perform { song: String, player: PlayerChoice, mode: String },
    Train { song: String, minutes: Option<f64>, set: Vec<String> },
    Resume { run: PathBuf, minutes: Option<f64> },
    Replay { recording: PathBuf },
    Compare { one: PathBuf, other: PathBuf },
}

/// The player.
#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PlayerChoice {
    /// The best policy for the song; without one the sight-reader.
    Best,
    Scripted,
    /// The policy of a training.
    Run(PathBuf),
}

impl ApiRequest {
    /// The job, if all that the request names is in the working folder.
    pub fn job(self, workspace: &Workspace) -> Result<JobSpec, ApiError> {
        match self {
            Self::Show { song } => {
                let (listed, _) = workspace.song(&song)?;
                make_folder(SONGS)?;
                let (analysis, sound) = analysis_files(&song);
                let mut step = quick(&["songs", "show", &song, "--json", "--reference", &sound]);
                step.stdout = Some(PathBuf::from(&analysis));
                Ok(job(format!("Analyse {}", listed.title), &song, &analysis, vec![step]))
            }
            Self::Arrange { song, changes } => arrange(workspace, &song, &changes),
            Self::Play { song, player } => {
                let (title, args) = player_args(workspace, &song, player)?;
                let folder = folder_of(workspace, &song, &args.folder_name(&song))?;
                let play = step(&["play", &song, "-o", &folder], options(&args));
                let steps = vec![play, replay(&format!("{folder}/{LATEST}/{RECORDING}"))];
                Ok(job(format!("Play {title}"), &song, &folder, steps))
            }
            Self::Perform { song, player, mode } => {
                let (title, args) = player_args(workspace, &song, player)?;
                let mode: Mode = mode.parse().map_err(|error| anyhow::anyhow!("the mode: {error}"))?;
                let folder = folder_of(workspace, &song, &performance_name(&args, &song, mode, []))?;
                let mode = format!("--mode={mode}");
                let perform = ["perform", &song, "--robot", "twin", "-o", &folder, &mode];
                let perform = step(&perform, options(&args));
                let steps = vec![perform, replay(&format!("{folder}/{LATEST}/{}", run_file(0, "mcap")))];
                Ok(job(format!("Perform {title} on the twin"), &song, &folder, steps))
            }
            Self::Train { song, minutes, set } => train(workspace, &song, minutes, &set),
            Self::Resume { run, minutes } => {
                let known = workspace.runs().into_iter().find(|known| known.figures.run == run);
                let figures = known.ok_or_else(|| unknown(&run))?.figures;
                let run = run.display().to_string();
                // A finished training gets the steps that `etude train` suggests.
                let more_steps = (figures.state == RunState::Finished)
                    .then(|| format!("--set=trainer.total_steps={}", 2 * figures.step));
                let options = more_steps.into_iter().chain(time_limit(minutes));
                let steps = vec![step(&["train", "--resume", &run], options)];
                let title =
                    format!("Resume the training of {}", figures.song.as_ref().unwrap_or(&figures.name));
                Ok(JobSpec { is_training: true, minutes, ..job(title, "", &run, steps) })
            }
            Self::Replay { recording } => {
                let recording = performance(workspace, &recording)?;
                let steps = vec![replay(&recording)];
                Ok(job(format!("Make the replay of {recording}"), "", &recording, steps))
            }
            Self::Compare { one, other } => {
                let [one, other] = [performance(workspace, &one)?, performance(workspace, &other)?];
                make_folder(COMPARED)?;
                let name = |path: &str| {
                    let path = Path::new(path).with_extension("");
                    etude_lab::readable(&path.strip_prefix("out").unwrap_or(&path).to_string_lossy())
                };
                let stem = format!("{COMPARED}/{}_{}", name(&one), name(&other));
                let [page, comparison] = ["html", "json"].map(|extension| format!("{stem}.{extension}"));
                let mut step = quick(&["compare", &one, &other, "-o", &page, "--json"]);
                step.stdout = Some(PathBuf::from(&comparison));
                let title = format!("Compare {} and {}", name(&one), name(&other));
                Ok(job(title, "", &comparison, vec![step]))
            }
        }
    }
}

/// Writes an arrangement. The same one again replaces its file.
fn arrange(workspace: &Workspace, song: &str, changes: &Changes) -> Result<JobSpec, ApiError> {
    let (listed, written) = workspace.song(song)?;
    make_folder(SONGS)?;
    let mut stem = listed.title;
    if changes.transpose != 0 {
        stem += &format!(" {:+}", changes.transpose);
    }
    if changes.stretch != 1.0 {
        stem += &format!(" x{}", changes.stretch);
    }
    if changes.melody {
        stem += " melody";
    }
    if changes.within_range {
        stem += " within range";
    }
    // The verb reports what cannot be arranged.
    let notes = changes.of(&written).map(|song| song.to_midi()).ok();
    let is_same = |known: &ListedSong| notes.is_some() && std::fs::read(&known.song).ok() == notes;
    let file = workspace.free_name(&stem, is_same).unwrap_or_else(|same| same);
    let options = changes.options();
    let options: Vec<&str> = options.iter().map(String::as_str).collect();
    let step = quick(&[&["songs", "arrange", song], options.as_slice(), &["-o", &file]].concat());
    Ok(job(format!("Write {stem}"), song, &file, vec![step]))
}

/// Trains with the seed of the settings, or with the first one that has no run.
fn train(
    workspace: &Workspace,
    song: &str,
    minutes: Option<f64>,
    set: &[String],
) -> Result<JobSpec, ApiError> {
    let (listed, _) = workspace.song(song)?;
    let folder = |seed: u64| format!("runs/{}__{}__{seed}", slug(song), etude_lab::DEFAULT_PRESET);
    let is_seed =
        |change: &String| change.split_once('=').is_some_and(|(path, _)| path.trim() == "trainer.seed");
    // The verb reports wrong settings.
    let config = set.iter().any(is_seed).then(|| etude_lab::resolve(etude_lab::DEFAULT_PRESET, None, set));
    let seed = config.and_then(Result::ok).map_or_else(
        || (0..).find(|seed| !Path::new(&folder(*seed)).exists()).unwrap_or_default(),
        |config| config.trainer.seed,
    );
    let run = folder(seed);
    let settings = std::iter::once(format!("trainer.seed={seed}")).chain(set.iter().cloned());
    let options = settings.map(|change| format!("--set={change}")).chain(time_limit(minutes));
    let steps = vec![step(&["train", song, "-o", &run], options)];
    let job = job(format!("Train {}", listed.title), song, &run, steps);
    Ok(JobSpec { is_training: true, minutes, ..job })
}

fn job(title: String, song: &str, output: &str, steps: Vec<Step>) -> JobSpec {
    let (song, output) = (song.to_string(), output.to_string());
    JobSpec { title, song, output, steps, is_training: false, minutes: None }
}

/// A verb that saves its state when it is stopped.
fn step(args: &[&str], options: impl IntoIterator<Item = String>) -> Step {
    let args = args.iter().map(ToString::to_string).chain(options).collect();
    Step { args, stdout: None, is_quick: false }
}

/// A verb that has nothing to save when it is stopped.
fn quick(args: &[&str]) -> Step {
    Step { is_quick: true, ..step(args, []) }
}

fn replay(recording: &str) -> Step {
    let page = replay_page(Path::new(recording)).display().to_string();
    quick(&["replay", recording, "-o", &page])
}

fn time_limit(minutes: Option<f64>) -> Option<String> {
    minutes.map(|minutes| format!("--minutes={minutes}"))
}

fn unknown(path: &Path) -> ApiError {
    ApiError::not_found(format!("there is no {} any more; reload the page", path.display()))
}

/// The path of a listed performance.
fn performance(workspace: &Workspace, recording: &Path) -> Result<String, ApiError> {
    let is_known = workspace.performances().iter().any(|known| known.recording == *recording);
    is_known.then(|| recording.display().to_string()).ok_or_else(|| unknown(recording))
}

/// The folder `out/NAME` of a song's performances, as the verbs choose it.
fn folder_of(workspace: &Workspace, song: &str, name: &str) -> Result<String, ApiError> {
    let (_, song) = workspace.song(song)?;
    Ok(folder_of_song(&Path::new("out").join(name), &song).display().to_string())
}

/// The song's title, and the player.
fn player_args(
    workspace: &Workspace,
    song: &str,
    player: PlayerChoice,
) -> Result<(String, PlayerArgs), ApiError> {
    let (listed, _) = workspace.song(song)?;
    let (policy, scripted) = match player {
        PlayerChoice::Best => (None, false),
        PlayerChoice::Scripted => (None, true),
        PlayerChoice::Run(run) if workspace.runs().iter().any(|known| known.figures.run == run) => {
            (Some(run), false)
        }
        PlayerChoice::Run(run) => return Err(unknown(&run)),
    };
    Ok((listed.title, PlayerArgs { policy, scripted, overrides: Vec::new() }))
}

/// The command line's options for the player.
fn options(args: &PlayerArgs) -> Vec<String> {
    let policy = args.policy.iter().map(|policy| format!("--policy={}", policy.display()));
    policy.chain(args.scripted.then(|| "--scripted".to_string())).collect()
}
