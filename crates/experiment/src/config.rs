//! An experiment as a file: what is trained or fitted, what is compared, which figures are drawn,
//! and what the paper found.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{anyhow, bail};
use etude_perform::Mode;
use serde::{Deserialize, Serialize};

use etude_lab::{IdentifyMethod, RehearsalFit, toml_error};

// `build.rs` lists the files of `configs/experiments`: name and text of each.
include!(concat!(env!("OUT_DIR"), "/experiments.rs"));

/// An experiment, as in its TOML file.
///
/// Its trials are the product of songs, variants, grid and seeds.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Experiment {
    /// The file's name without its ending.
    #[serde(skip)]
    pub name: String,
    /// What it was asked for as: the name of one that comes with Étude, or a path.
    #[serde(skip)]
    pub asked: String,
    /// The question.
    pub title: String,
    /// Where the paper asks it, or why we do.
    pub source: String,
    /// What the paper found.
    #[serde(default)]
    pub finding: String,
    /// Songs: built-in ids or MIDI files. Without songs a preset with a corpus learns the corpus,
    /// and the policy of each seed is scored on its validation pieces.
    #[serde(default)]
    pub songs: Vec<String>,
    /// How many seeds, counted from 0.
    pub seeds: u64,
    /// Preset of the trainings.
    #[serde(default = "default_preset")]
    pub preset: String,
    /// Overrides of its values, `path=value`.
    #[serde(default)]
    pub set: Vec<String>,
    /// The variants. The others are compared with the first.
    #[serde(default)]
    pub variants: Vec<Variant>,
    /// Values for keys of the configuration, by path; all combinations are tried.
    #[serde(default)]
    pub grid: BTreeMap<String, Vec<toml::Value>>,
    /// Instead of a training for each song: players play songs and melodies.
    pub play: Option<PlayConfig>,
    /// The trained policies, or the players, play on the twin.
    pub perform: Option<PerformConfig>,
    /// The trained policies are rehearsed on the twin (Sim2Real2Sim).
    pub rehearse: Option<RehearseConfig>,
    /// Instead of a training: fits to recordings of the twin.
    pub identify: Option<FitConfig>,
    /// The figures, in order.
    #[serde(default)]
    pub figures: Vec<FigureConfig>,
    /// The paper's numbers.
    #[serde(default)]
    pub paper: Vec<Published>,
}

fn default_preset() -> String {
    etude_lab::DEFAULT_PRESET.to_string()
}

/// One variant of the configuration.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Variant {
    /// Its name in figures and tables.
    pub name: String,
    /// Its overrides, `path=value`.
    #[serde(default)]
    pub set: Vec<String>,
    /// The modes in which it is played, if not those of `[perform]` or `[rehearse]`.
    pub modes: Option<Vec<Mode>>,
    /// The twins on which it is played, if not those; with an empty list it is only trained.
    pub twin_params: Option<Vec<String>>,
}

/// Who plays, and pieces beside the songs.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlayConfig {
    /// `scripted`, the name of a policy that comes with Étude, a policy's file, or the folder of a
    /// run; `{seed}` in it stands for the seed. The others are compared with the first.
    pub players: Vec<String>,
    /// Players that first learn each piece.
    #[serde(default)]
    pub learners: Vec<LearnerConfig>,
    /// How many of the first test melodies.
    #[serde(default)]
    pub melodies: usize,
    /// How many of the first validation melodies, by which a sight-reader's best policy is chosen.
    #[serde(default)]
    pub validation_melodies: usize,
}

/// A player that learns each piece before it plays it.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LearnerConfig {
    /// Its name in figures and tables.
    pub name: String,
    /// Preset of its trainings.
    #[serde(default = "default_preset")]
    pub preset: String,
    /// Overrides, `path=value`.
    #[serde(default)]
    pub set: Vec<String>,
    /// What its trainings begin with: the name of a policy that comes with Étude, a policy's file,
    /// or the folder of a run (its best policy); nothing if not given.
    pub from: Option<String>,
}

/// How trained policies play on the twin.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PerformConfig {
    /// In which modes.
    pub modes: Vec<Mode>,
    /// How often in each.
    pub runs: usize,
    /// Parameter sets of the twin: names or files. The policy plays on a twin of each.
    #[serde(default = "standard")]
    pub twin_params: Vec<String>,
}

/// How a rehearsal (Sim2Real2Sim) is done: it begins with the trained policy.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RehearseConfig {
    /// In which modes; each is a separate rehearsal with each parameter set and each fit.
    pub modes: Vec<Mode>,
    /// How the simulator is fitted.
    #[serde(default = "our_fit")]
    pub fits: Vec<RehearsalFit>,
    /// Iterations after the first performance.
    pub iterations: usize,
    /// Performances an iteration.
    pub runs: usize,
    /// Parameter sets of the twin: names or files.
    #[serde(default = "standard")]
    pub twin_params: Vec<String>,
    /// Steps of the training in each iteration; those of the first training if not given.
    pub steps: Option<u64>,
    /// Evaluations of each fit at most; the method's own number if not given.
    pub evaluations: Option<u64>,
}

/// How the simulator is fitted to the twin's excitations.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FitConfig {
    /// Parameter sets of the twin.
    pub twin_params: Vec<String>,
    /// Methods.
    pub methods: Vec<IdentifyMethod>,
    /// Evaluations of each fit at most; the method's own number if not given.
    pub evaluations: Option<u64>,
}

fn our_fit() -> Vec<RehearsalFit> {
    vec![RehearsalFit::Lm]
}

fn standard() -> Vec<String> {
    vec!["standard".to_string()]
}

/// Kinds of figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FigureKind {
    /// Measures against a number that grows during a trial, such as `step`.
    Curves,
    /// Measures for each value of a label, side by side.
    Bars,
    /// Measures against a label that is a number.
    Lines,
}

/// A figure. Its series are the measures `y`, for each value of the label `by`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FigureConfig {
    /// Name of its files.
    pub name: String,
    /// What it shows.
    pub title: String,
    /// Which kind.
    pub kind: FigureKind,
    /// The number or the label along the horizontal axis.
    pub x: String,
    /// Measures.
    pub y: Vec<String>,
    /// Label with a series for each of its values.
    pub by: Option<String>,
    /// Only rows with these labels.
    #[serde(default, rename = "where")]
    pub filter: BTreeMap<String, String>,
}

/// A number of the paper.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Published {
    /// Labels of what it describes.
    #[serde(default, rename = "where")]
    pub filter: BTreeMap<String, String>,
    /// The measure.
    pub measure: String,
    /// The number.
    pub value: f64,
}

/// Labels that a grid cannot have.
const RESERVED: [&str; 10] =
    ["song", "seed", "variant", "mode", "run", "iteration", "twin_params", "method", "player", "pieces"];

/// Whether a setting `path=value` sets the seed, which the plan does.
pub(crate) fn sets_seed(set: &str) -> bool {
    set.split('=').next().is_some_and(|path| path.trim() == "trainer.seed")
}

/// Names of the experiments that come with Étude.
pub fn names() -> Vec<&'static str> {
    EXPERIMENTS.iter().map(|(name, _)| *name).collect()
}

impl Experiment {
    /// The experiment of this name, or in the TOML file at this path.
    ///
    /// # Errors
    /// If there is none, or a key is wrong; the message names the key.
    pub fn load(name_or_path: &str) -> anyhow::Result<Self> {
        if let Some((name, text)) = EXPERIMENTS.iter().find(|(name, _)| *name == name_or_path) {
            return Self::parse(name, name_or_path, text);
        }
        let path = Path::new(name_or_path);
        if path.extension().is_none_or(|ending| ending != "toml") {
            bail!(
                "there is no experiment `{name_or_path}`; there are: {}; or give the path of a TOML file",
                names().join(", ")
            );
        }
        let text = std::fs::read_to_string(path)
            .map_err(|error| anyhow!("cannot read the experiment {}: {error}", path.display()))?;
        Self::parse(
            &path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned()),
            name_or_path,
            &text,
        )
    }

    fn parse(name: &str, asked: &str, text: &str) -> anyhow::Result<Self> {
        let wrong = |message: String| anyhow!("experiment {name}: {message}");
        let value: toml::Value = text
            .parse::<toml::Table>()
            .map(toml::Value::Table)
            .map_err(|error| wrong(toml_error(text, &error)))?;
        let mut experiment: Self = serde_path_to_error::deserialize(value)
            .map_err(|error| wrong(format!("key `{}`: {}", error.path(), error.inner().message())))?;
        experiment.name = name.to_string();
        experiment.asked = asked.to_string();
        experiment.check().map_err(wrong)?;
        Ok(experiment)
    }

    fn check(&self) -> Result<(), String> {
        if self.seeds == 0 {
            return Err("key `seeds`: there must be at least one".to_string());
        }
        let kinds = [self.play.is_some(), self.rehearse.is_some(), self.identify.is_some()];
        if kinds.iter().filter(|is_there| **is_there).count() > 1 {
            return Err("it can be one of [play], [rehearse] and [identify]".to_string());
        }
        if let Some(play) = &self.play {
            if play.players.is_empty() {
                return Err("key `play.players`: name at least one player".to_string());
            }
            if !(self.set.is_empty() && self.variants.is_empty() && self.grid.is_empty()) {
                return Err(
                    "with [play] only [[play.learners]] are trained: no `set`, [[variants]] or [grid]"
                        .to_string(),
                );
            }
            let names = play.players.iter().chain(play.learners.iter().map(|learner| &learner.name));
            if let Some(name) = repeated(names) {
                return Err(format!("two players are called `{name}`"));
            }
        }
        if (self.play.is_some() || self.rehearse.is_some()) && self.songs.is_empty() {
            return Err("key `songs`: name at least one song".to_string());
        }
        if self.perform.is_some() && (self.rehearse.is_some() || self.identify.is_some()) {
            return Err("[perform] goes with neither [rehearse] nor [identify]".to_string());
        }
        if let Some((path, _)) = self.grid.iter().find(|(_, values)| values.is_empty()) {
            return Err(format!("key `grid.{path}`: name at least one value"));
        }
        if let Some(name) = repeated(self.variants.iter().map(|variant| &variant.name)) {
            return Err(format!("two variants are called `{name}`"));
        }
        let learners = self.play.iter().flat_map(|play| &play.learners).flat_map(|learner| &learner.set);
        let sets =
            self.set.iter().chain(self.variants.iter().flat_map(|variant| &variant.set)).chain(learners);
        if let Some(set) = sets.chain(self.grid.keys()).find(|set| sets_seed(set)) {
            return Err(format!(
                "`{set}` would make every training the same: `seeds` says how many there are"
            ));
        }
        let mut labels: Vec<&str> = RESERVED.to_vec();
        for path in self.grid.keys() {
            let label = path.rsplit('.').next().unwrap_or(path);
            if labels.contains(&label) {
                return Err(format!("key `grid.{path}`: its label `{label}` is taken; make variants of it"));
            }
            labels.push(label);
        }
        for figure in &self.figures {
            let plain = |c: char| c.is_ascii_alphanumeric() || c == '-';
            if figure.name.is_empty() || !figure.name.chars().all(plain) {
                return Err(format!(
                    "figure `{}`: its name is a file's: letters, digits and hyphens",
                    figure.name
                ));
            }
            if figure.y.is_empty() {
                return Err(format!("figure `{}`: key `y`: name at least one measure", figure.name));
            }
        }
        Ok(())
    }
}

/// The first name that was there before.
fn repeated<'a>(mut names: impl Iterator<Item = &'a String>) -> Option<&'a String> {
    let mut seen = BTreeSet::new();
    names.find(|name| !seen.insert(*name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trial_plan::ExperimentConfig;

    #[test]
    fn every_experiment_that_comes_with_us_can_be_read() {
        for name in names() {
            let experiment = Experiment::load(name).unwrap();
            assert!(!experiment.title.is_empty() && !experiment.figures.is_empty(), "{name}");
        }
    }

    #[test]
    fn errors_name_the_experiment_and_the_key() {
        let said = |text: &str| Experiment::parse("mine", "mine.toml", text).unwrap_err().to_string();
        let least = "title = 'T'\nsource = 'S'\nsongs = ['twinkle']\nseeds = 1\n";
        assert!(Experiment::parse("mine", "mine.toml", least).is_ok());
        assert!(said("title = 3").contains("`title`"));
        assert!(said(&least.replace("seeds", "sead")).contains("sead"));
        assert!(said(&least.replace("seeds = 1", "seeds = 0")).contains("`seeds`"));
        assert!(said(&format!("{least}[perform]\nmodes = ['loud']\nruns = 1")).contains("perform.modes"));
        assert!(
            said(&format!("{least}[[variants]]\nname = 'a'\n[[variants]]\nname = 'a'"))
                .contains("two variants")
        );
        assert!(said(&format!("{least}[grid]\n'task.x' = []")).contains("task.x"));
        assert!(said(&format!("{least}[grid]\n'a.mode' = [1]")).contains("`mode` is taken"));
        assert!(said(&format!("{least}[grid]\n'a.x' = [1]\n'b.x' = [1]")).contains("`x` is taken"));
        assert!(said(&format!("{least}[play]\nplayers = []")).contains("play.players"));
        let both =
            format!("{least}[play]\nplayers = ['scripted']\n[identify]\ntwin_params = []\nmethods = []");
        assert!(said(&both).contains("one of [play]"));
        let trained = format!("{least}set = ['task.lookahead=3']\n[play]\nplayers = ['scripted']");
        assert!(said(&trained).contains("only [[play.learners]] are trained"));
        let twice = format!("{least}[play]\nplayers = ['scripted']\n[[play.learners]]\nname = 'scripted'");
        assert!(said(&twice).contains("two players are called `scripted`"));
        let silent = least.replace("songs = ['twinkle']\n", "");
        assert!(
            Experiment::parse("mine", "mine.toml", &silent)
                .unwrap()
                .plan(&ExperimentConfig::default())
                .is_err()
        );
        assert!(said(&format!("{silent}[play]\nplayers = ['scripted']")).contains("`songs`"));
        assert!(said(&format!("{least}set = ['trainer.seed=3']")).contains("`seeds`"));
        let unknown = Experiment::load("no-such").unwrap_err().to_string();
        assert!(unknown.contains("no-such") && unknown.contains("songs"), "{unknown}");
    }
}
