//! From what is wanted on the page to the verbs that do it.

use std::path::{Path, PathBuf};

use etude_lab::{RECORDING, run_file};
use etude_perform::Mode;
use etude_show::watch::RunState;
use serde::Deserialize;

use super::super::perform::performance_name;
use super::super::songs::{arrange_options, arranged};
use super::super::{PianistArgs, slug};
use super::desk::{COMPARED, Desk, Listed, SONGS, about, make_folder, replay_page};
use super::http::Refusal;
use super::jobs::{Order, Step};

/// A button of the page, with its settings.
#[derive(Deserialize)]
#[serde(tag = "verb", rename_all = "snake_case", deny_unknown_fields)]
pub enum Wanted {
    Show { song: String },
    Arrange(Arrangement),
    Play { song: String, player: Who },
    Perform { song: String, player: Who, mode: String },
    Train { song: String, minutes: Option<f64>, set: Vec<String> },
    Resume { run: PathBuf, minutes: Option<f64> },
    Replay { recording: PathBuf },
    Compare { one: PathBuf, other: PathBuf },
}

/// What `etude songs arrange` changes.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Arrangement {
    song: String,
    #[serde(default)]
    transpose: i32,
    #[serde(default = "same_tempo")]
    stretch: f64,
    #[serde(default)]
    melody: bool,
}

fn same_tempo() -> f64 {
    1.0
}

/// The player.
#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Who {
    /// The best policy that has learned the song; without one the sight-reader.
    Best,
    Scripted,
    /// The policy of a training.
    Run(PathBuf),
}

impl Wanted {
    /// The verbs, if all that is named is in the working folder.
    pub fn order(self, desk: &Desk) -> Result<Order, Refusal> {
        match self {
            Self::Show { song } => {
                let (listed, _) = desk.song(&song)?;
                make_folder(SONGS)?;
                let (text, sound) = about(&song);
                let mut step = quick(&["songs", "show", &song, "--json", "--reference", &sound]);
                step.keep = Some(PathBuf::from(&text));
                Ok(order(format!("Read {}", listed.title), song, text, vec![step]))
            }
            Self::Arrange(Arrangement { song, transpose, stretch, melody }) => {
                let (listed, _) = desk.song(&song)?;
                make_folder(SONGS)?;
                let mut stem = listed.title;
                if transpose != 0 {
                    stem += &format!(" {transpose:+}");
                }
                if stretch != 1.0 {
                    stem += &format!(" x{stretch}");
                }
                if melody {
                    stem += " melody";
                }
                // The same arrangement once more replaces its file. What cannot be arranged is refused by the verb.
                let notes = arranged(&song, transpose, stretch, melody).map(|song| song.to_midi());
                let is_same = |known: &Listed| {
                    notes
                        .as_ref()
                        .is_ok_and(|notes| std::fs::read(&known.song).is_ok_and(|theirs| theirs == *notes))
                };
                let made = desk.free_name(&stem, is_same).unwrap_or_else(|same| same);
                let options = arrange_options(transpose, stretch, melody);
                let mut arguments = vec!["songs", "arrange", &song];
                arguments.extend(options.iter().map(String::as_str));
                arguments.extend(["-o", &made]);
                let step = quick(&arguments);
                Ok(order(format!("Write {stem}"), song.clone(), made.clone(), vec![step]))
            }
            Self::Play { song, player } => {
                let (title, pianist) = pianist(desk, &song, player)?;
                let folder = format!("out/{}", pianist.folder_name(&song));
                let mut play = vec!["play".to_string(), song.clone(), "-o".to_string(), folder.clone()];
                play.extend(arguments(&pianist));
                let steps = vec![gentle(play), replay(&format!("{folder}/{RECORDING}"))];
                Ok(order(format!("Play {title}"), song, folder, steps))
            }
            Self::Perform { song, player, mode } => {
                let (title, pianist) = pianist(desk, &song, player)?;
                let mode: Mode = mode.parse().map_err(|error| anyhow::anyhow!("the mode: {error}"))?;
                let folder = format!("out/{}", performance_name(&pianist, &song, mode, []));
                let mut perform: Vec<String> =
                    ["perform", &song, "--robot", "twin", "-o", &folder].map(str::to_string).into();
                perform.push(format!("--mode={mode}"));
                perform.extend(arguments(&pianist));
                let steps = vec![gentle(perform), replay(&format!("{folder}/{}", run_file(0, "mcap")))];
                Ok(order(format!("Perform {title} on the twin"), song, folder, steps))
            }
            Self::Train { song, minutes, set } => {
                let (listed, _) = desk.song(&song)?;
                let name = |seed: u64| format!("runs/{}__{}__{seed}", slug(&song), etude_lab::DEFAULT_PRESET);
                let free = || (0..).find(|seed| !Path::new(&name(*seed)).exists()).unwrap_or_default();
                // As for `etude train`, the last one counts.
                let is_seed = |change: &String| {
                    change.split_once('=').is_some_and(|(path, _)| path.trim() == "trainer.seed")
                };
                // Settings that cannot work are refused by the verb.
                let config = set
                    .iter()
                    .any(is_seed)
                    .then(|| etude_lab::resolve(etude_lab::DEFAULT_PRESET, None, &set).ok());
                let seed = config.flatten().map_or_else(free, |config| config.trainer.seed);
                let run = name(seed);
                let mut train: Vec<String> = ["train", &song, "-o", &run].map(str::to_string).into();
                train.push(format!("--set=trainer.seed={seed}"));
                train.extend(set.iter().map(|change| format!("--set={change}")));
                train.extend(minutes.map(|minutes| format!("--minutes={minutes}")));
                let order = order(format!("Train {}", listed.title), song, run, vec![gentle(train)]);
                Ok(Order { is_training: true, minutes, ..order })
            }
            Self::Resume { run, minutes } => {
                let known = desk.runs().into_iter().find(|known| known.figures.run == run);
                let figures = known.ok_or_else(|| unknown(&run))?.figures;
                let run = run.display().to_string();
                let mut train: Vec<String> = ["train", "--resume", &run].map(str::to_string).into();
                // A training that has made all its steps continues as `etude train` advises.
                if figures.state == RunState::Finished {
                    train.push(format!("--set=trainer.total_steps={}", 2 * figures.step));
                }
                train.extend(minutes.map(|minutes| format!("--minutes={minutes}")));
                let title =
                    format!("Resume the training of {}", figures.song.as_deref().unwrap_or(&figures.name));
                Ok(Order {
                    is_training: true,
                    minutes,
                    ..order(title, String::new(), run, vec![gentle(train)])
                })
            }
            Self::Replay { recording } => {
                let recording = performance(desk, &recording)?;
                let step = replay(&recording);
                Ok(order(format!("Make the replay of {recording}"), String::new(), recording, vec![step]))
            }
            Self::Compare { one, other } => {
                let [one, other] = [performance(desk, &one)?, performance(desk, &other)?];
                make_folder(COMPARED)?;
                let name = |path: &str| {
                    let path = Path::new(path).with_extension("");
                    etude_lab::slug(&path.strip_prefix("out").unwrap_or(&path).to_string_lossy())
                };
                let made = format!("{COMPARED}/{}_{}", name(&one), name(&other));
                let page = format!("{made}.html");
                let mut step = quick(&["compare", &one, &other, "-o", &page, "--json"]);
                step.keep = Some(PathBuf::from(format!("{made}.json")));
                let title = format!("Compare {} and {}", name(&one), name(&other));
                Ok(order(title, String::new(), format!("{made}.json"), vec![step]))
            }
        }
    }
}

fn order(title: String, song: String, makes: String, steps: Vec<Step>) -> Order {
    Order { title, song, makes, steps, is_training: false, minutes: None }
}

/// A verb that stops on request and keeps what it has.
fn gentle(args: Vec<String>) -> Step {
    Step { args, keep: None, is_quick: false }
}

/// A verb that has nothing to keep before it is done.
fn quick(args: &[&str]) -> Step {
    Step { args: args.iter().map(ToString::to_string).collect(), keep: None, is_quick: true }
}

fn replay(recording: &str) -> Step {
    let page = replay_page(Path::new(recording)).display().to_string();
    quick(&["replay", recording, "-o", &page])
}

fn unknown(path: &Path) -> Refusal {
    Refusal::missing(format!("there is no {} any more; reload the page", path.display()))
}

/// The path of a performance that is listed.
fn performance(desk: &Desk, recording: &Path) -> Result<String, Refusal> {
    let is_known = desk.performances().iter().any(|known| known.recording == *recording);
    is_known.then(|| recording.display().to_string()).ok_or_else(|| unknown(recording))
}

/// Title of the song, and who plays it.
fn pianist(desk: &Desk, asked: &str, player: Who) -> Result<(String, PianistArgs), Refusal> {
    let (listed, _) = desk.song(asked)?;
    let (policy, scripted) = match player {
        Who::Best => (None, false),
        Who::Scripted => (None, true),
        Who::Run(run) if desk.runs().iter().any(|known| known.figures.run == run) => (Some(run), false),
        Who::Run(run) => return Err(unknown(&run)),
    };
    Ok((listed.title, PianistArgs { policy, scripted, overrides: Vec::new() }))
}

/// How the pianist is named on the command line.
fn arguments(pianist: &PianistArgs) -> Vec<String> {
    let policy = pianist.policy.iter().map(|policy| format!("--policy={}", policy.display()));
    policy.chain(pianist.scripted.then(|| "--scripted".to_string())).collect()
}
