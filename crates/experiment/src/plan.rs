//! The plan of an experiment: the list of its trials.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{anyhow, bail};
use etude_lab::find_song;
use etude_music::Song;
use etude_perform::{Mode, shell_word};
use etude_twin::TwinParams;

use crate::config::{Experiment, FitConfig, PerformConfig, RehearseConfig, Variant, sets_the_seed};
use crate::trial::{TrainingConfig, Trial, Work, fingerprint, id, json};

/// Changes to an experiment from outside its file.
#[derive(Clone, Debug, Default)]
pub struct PlanConfig {
    /// Number of seeds, instead of the file's.
    pub seeds: Option<u64>,
    /// Everything once and as short as possible, as a test.
    pub smoke: bool,
    /// Overrides of every training, `path=value`; they come last.
    pub set: Vec<String>,
}

/// Overrides of a smoke test: two rounds of evaluation and a few updates between them.
const SMOKE: [&str; 4] = [
    "trainer.total_steps=480",
    "trainer.evaluate_every_steps=240",
    "trainer.warmup_steps=160",
    "trainer.checkpoint_every_steps=240",
];
/// Evaluations of a fit in a smoke test.
const SMOKE_EVALUATIONS: u64 = 2;

/// Stands for the song in the id of a corpus' training.
const CORPUS: &str = "corpus";

/// How policies play on a twin; a trial that was done otherwise has another id.
const PLAYED: &str = "with the lead that one run before has measured, F1 of the keys when they are heard";

impl PlanConfig {
    /// The flags that give it on the command line, as they are typed.
    pub fn flags(&self) -> String {
        let seeds = self.seeds.map(|seeds| format!(" --seeds {seeds}"));
        let budget = self.smoke.then(|| " --budget smoke".to_string());
        let set = self.set.iter().map(|set| format!(" --set {}", shell_word(set)));
        seeds.into_iter().chain(budget).chain(set).collect()
    }

    /// All overrides of a training: `set`, which is its own, then the seed and those of the plan.
    pub(crate) fn complete(&self, mut set: Vec<String>, seed: u64) -> Vec<String> {
        set.push(format!("trainer.seed={seed}"));
        if self.smoke {
            set.extend(SMOKE.map(str::to_string));
        }
        set.extend(self.set.iter().cloned());
        set
    }
}

impl Experiment {
    /// Its trials, in order. The seed changes slowest, so that early results cover every variant.
    ///
    /// # Errors
    /// If a song, setting or truth is not sound.
    pub fn plan(&self, config: &PlanConfig) -> anyhow::Result<Vec<Trial>> {
        if let Some(set) = config.set.iter().find(|set| sets_the_seed(set)) {
            bail!("`--set {set}` would make every training the same: --seeds says how many there are");
        }
        let smoke = config.smoke;
        let seeds = if smoke { 1 } else { config.seeds.unwrap_or(self.seeds) };
        let songs = all_or_first(&self.songs, smoke);
        let mut trials = Vec::new();
        for seed in 0..seeds {
            match (&self.identify, &self.play) {
                (Some(fit), _) => trials.extend(self.fits(fit, seed, smoke)?),
                (None, Some(play)) => trials.extend(self.plays(play, seed, config)?),
                (None, None) if songs.is_empty() => trials.extend(self.trainings(None, seed, config)?),
                (None, None) => {
                    for song in songs {
                        trials.extend(self.trainings(Some(song), seed, config)?);
                    }
                }
            }
        }
        // Two variants may have the same trial.
        let mut seen = BTreeSet::new();
        trials.retain(|trial: &Trial| seen.insert((trial.id.clone(), trial.labels.clone())));
        Ok(trials)
    }

    fn fits(&self, fit: &FitConfig, seed: u64, smoke: bool) -> anyhow::Result<Vec<Trial>> {
        let evaluations = if smoke { Some(SMOKE_EVALUATIONS) } else { fit.evaluations };
        let mut trials = Vec::new();
        for name in all_or_first(&fit.truths, smoke) {
            let content = self.fingerprint_of_truth(name)?;
            for method in &fit.methods {
                let work = Work::Identify { truth: name.clone(), method: *method, evaluations, seed };
                let labels = [("truth", name.clone()), ("method", method.name().to_string())];
                let labels = labels.into_iter().chain([("seed", seed.to_string())]);
                trials.push(Trial {
                    id: id("identify", name, seed, &(content.clone() + &json(&work))),
                    labels: labels.map(|(key, value)| (key.to_string(), value)).collect(),
                    work,
                });
            }
        }
        Ok(trials)
    }

    /// The trainings of a song, or of the preset's corpus.
    fn trainings(&self, song: Option<&str>, seed: u64, config: &PlanConfig) -> anyhow::Result<Vec<Trial>> {
        let smoke = config.smoke;
        let notes = song.map(find_song).transpose()?.map_or_else(String::new, |song| notes_of(&song));
        let mut trials = Vec::new();
        let alone = [Variant { name: String::new(), set: Vec::new(), modes: None }];
        let variants = if self.variants.is_empty() { &alone[..] } else { &self.variants };
        for variant in variants {
            for point in self.grid_points(smoke) {
                let mut labels = BTreeMap::from([("seed".to_string(), seed.to_string())]);
                labels.extend(song.map(|song| ("song".to_string(), song.to_string())));
                if !variant.name.is_empty() {
                    labels.insert("variant".to_string(), variant.name.clone());
                }
                let mut set: Vec<String> = [self.set.as_slice(), &variant.set].concat();
                for (path, value) in &point {
                    set.push(format!("{path}={value}"));
                    let label = path.rsplit('.').next().unwrap_or(path);
                    labels.insert(label.to_string(), value.trim_matches('"').to_string());
                }
                let set = config.complete(set, seed);
                let training = TrainingConfig {
                    song: song.map(str::to_string),
                    preset: self.preset.clone(),
                    set,
                    from: None,
                };
                let wrong = |error| anyhow!("experiment {}: {error}", self.name);
                let resolved = training.resolve().map_err(wrong)?;
                let mut what = fingerprint(&notes, &resolved);
                match &resolved.corpus {
                    // A rehearsal of a song may train on a corpus.
                    Some(corpus) if song.is_none() || self.rehearse.is_some() => {
                        what += &format!("{:016x}", corpus.checksum()?);
                    }
                    None if song.is_none() => {
                        bail!(
                            "experiment {}: key `songs`: name at least one song, or a preset with a corpus: `sight-reader`",
                            self.name
                        )
                    }
                    _ => {}
                }
                if song.is_none() && self.perform.is_some() {
                    bail!(
                        "experiment {}: [perform] needs songs, and a corpus is learned: train first, and name the policies in the \
                         `players` of another experiment",
                        self.name
                    );
                }
                match &self.rehearse {
                    Some(rehearse) => {
                        // Fits are what a smoke test would spend its time on.
                        for truth in all_or_first(&rehearse.truths, smoke) {
                            let what = format!("{what}{}", self.fingerprint_of_truth(truth)?);
                            trials
                                .extend(rehearsals(rehearse, truth, &training, &labels, smoke, seed, &what));
                        }
                    }
                    None => {
                        let (perform, on_twin) = self.performance(variant.modes.as_deref(), smoke)?;
                        let name = training.song.as_deref().unwrap_or(CORPUS);
                        let id = id("train", name, seed, &format!("{what}{on_twin}"));
                        trials.push(Trial { id, labels, work: Work::Train { training, perform } });
                    }
                }
            }
        }
        Ok(trials)
    }

    /// How a player plays on the twin, and a text that differs where the result may.
    pub(crate) fn performance(
        &self,
        modes: Option<&[Mode]>,
        smoke: bool,
    ) -> anyhow::Result<(Option<PerformConfig>, String)> {
        let perform = self.perform.clone().map(|perform| PerformConfig {
            modes: modes.map_or_else(|| perform.modes.clone(), <[Mode]>::to_vec),
            runs: if smoke { 1 } else { perform.runs },
            ..perform
        });
        let mut text = json(&perform);
        if perform.is_some() {
            text += PLAYED;
        }
        for truth in perform.iter().flat_map(|perform| &perform.truths) {
            text += &self.fingerprint_of_truth(truth)?;
        }
        Ok((perform, text))
    }

    /// Every combination of the grid's values; in a smoke test, of the first and the last of each.
    fn grid_points(&self, smoke: bool) -> Vec<Vec<(String, String)>> {
        let mut points = vec![Vec::new()];
        for (path, values) in &self.grid {
            let tried: Vec<&toml::Value> = match (smoke, values.as_slice()) {
                (true, [first, .., last]) => vec![first, last],
                _ => values.iter().collect(),
            };
            points = points
                .iter()
                .flat_map(|point| {
                    tried.iter().map(move |value| {
                        let mut point = point.clone();
                        point.push((path.clone(), value.to_string()));
                        point
                    })
                })
                .collect();
        }
        points
    }

    /// Differs for truths of different content, whether they come with Étude or from a file.
    fn fingerprint_of_truth(&self, truth: &str) -> anyhow::Result<String> {
        let truth = TwinParams::load(truth).map_err(|error| anyhow!("experiment {}: {error}", self.name))?;
        Ok(format!("{:08x}", truth.fingerprint()))
    }
}

fn rehearsals(
    rehearse: &RehearseConfig,
    truth_name: &str,
    training: &TrainingConfig,
    labels: &BTreeMap<String, String>,
    smoke: bool,
    seed: u64,
    what: &str,
) -> Vec<Trial> {
    let trial = |mode: &Mode| {
        let (rounds, runs) = if smoke { (1, 1) } else { (rehearse.rounds, rehearse.runs) };
        let evaluations = if smoke { Some(SMOKE_EVALUATIONS) } else { rehearse.evaluations };
        // A later round continues from the best one.
        let from = if rounds > 1 { " from the best round" } else { "" };
        let all = format!("{what}{mode}{rounds} {runs} {truth_name} {evaluations:?}{from}{PLAYED}");
        let mut labels = labels.clone();
        labels.insert("mode".to_string(), mode.name().to_string());
        labels.insert("truth".to_string(), truth_name.to_string());
        let work = Work::Rehearse {
            training: training.clone(),
            mode: *mode,
            rounds,
            runs,
            truth: truth_name.to_string(),
            evaluations,
        };
        Trial { id: id("rehearse", &labels["song"], seed, &all), labels, work }
    };
    all_or_first(&rehearse.modes, smoke).iter().map(trial).collect()
}

/// The notes of a song, and its length, as part of an id.
pub(crate) fn notes_of(song: &Song) -> String {
    format!("{} {:?}", song.duration_secs(), song.notes())
}

/// All of them, in a smoke test the first.
pub(crate) fn all_or_first<T>(all: &[T], smoke: bool) -> &[T] {
    if smoke { &all[..all.len().min(1)] } else { all }
}

#[cfg(test)]
pub(crate) mod tests {

    use super::*;

    pub(crate) fn plan(text: &str, config: &PlanConfig) -> Vec<Trial> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mine.toml");
        std::fs::write(&path, text).unwrap();
        Experiment::load(path.to_str().unwrap()).unwrap().plan(config).unwrap()
    }

    pub(crate) const MINE: &str = r#"
title = "T"
source = "S"
songs = ["twinkle", "c-major-scale"]
seeds = 2
[[variants]]
name = "fences"
[[variants]]
name = "none"
set = ["task.stage.fences=false"]
[grid]
"task.randomisation.intensity" = [0.0, 0.5, 1.0]
[perform]
modes = ["real"]
runs = 3
"#;

    #[test]
    fn a_plan_is_the_product_of_songs_variants_grid_and_seeds() {
        let trials = plan(MINE, &PlanConfig::default());
        assert_eq!(trials.len(), 2 * 2 * 3 * 2);
        let ids: BTreeSet<&str> = trials.iter().map(|trial| trial.id.as_str()).collect();
        assert_eq!(ids.len(), trials.len());
        let labels = &trials[1].labels;
        assert_eq!(labels["song"], "twinkle");
        assert_eq!(labels["variant"], "fences");
        assert_eq!(labels["intensity"], "0.5");
        assert_eq!(plan(MINE, &PlanConfig { seeds: Some(1), ..PlanConfig::default() }).len(), 12);
    }

    #[test]
    fn a_corpus_is_learned_once_a_seed() {
        let mine = "title = 'T'\nsource = 'S'\npreset = 'sight-reader'\nseeds = 2\n";
        let trials = plan(mine, &PlanConfig::default());
        assert_eq!(trials.len(), 2);
        for (seed, trial) in trials.iter().enumerate() {
            let Work::Train { training, perform: None } = &trial.work else { panic!("{trial:?}") };
            assert_eq!(training.song, None);
            assert_eq!(training.resolve().unwrap().trainer.seed, seed as u64);
            assert!(trial.id.starts_with(&format!("train__corpus__{seed}__")), "{}", trial.id);
        }
        let refused = |text: String| {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("mine.toml");
            std::fs::write(&path, text).unwrap();
            let experiment = Experiment::load(path.to_str().unwrap()).unwrap();
            experiment.plan(&PlanConfig::default()).unwrap_err().to_string()
        };
        // With songs the preset trains on each of them.
        let songs = plan(&format!("{mine}songs = ['twinkle', 'ode-to-joy']\n"), &PlanConfig::default());
        assert_eq!(songs.len(), 4);
        assert!(refused(format!("{mine}[perform]\nmodes = ['real']\nruns = 1\n")).contains("`players`"));
        assert!(refused(mine.replace("sight-reader", "fast")).contains("name at least one song"));
    }

    #[test]
    fn another_corpus_is_another_trial() {
        let folder = tempfile::tempdir().unwrap();
        let set = format!("set = ['corpus.folder={}']", folder.path().display());
        let mine = format!("title = 'T'\nsource = 'S'\npreset = 'sight-reader'\nseeds = 1\n{set}\n");
        let id = |seed: u64| {
            etude_music::melody(seed).save(folder.path().join("one.mid")).unwrap();
            plan(&mine, &PlanConfig::default())[0].id.clone()
        };
        let [first, second, again] = [1, 2, 1].map(id);
        assert!(first != second && first == again);
        let rehearse = "songs = ['twinkle']\n[rehearse]\nmodes = ['real']\nrounds = 1\nruns = 1\n";
        let id = |seed: u64| {
            etude_music::melody(seed).save(folder.path().join("one.mid")).unwrap();
            plan(&format!("{mine}{rehearse}"), &PlanConfig::default())[0].id.clone()
        };
        assert_ne!(id(1), id(2));
    }

    #[test]
    fn ids_are_those_of_the_work_whoever_asks_for_it() {
        let trials = plan(MINE, &PlanConfig::default());
        assert_eq!(plan(MINE, &PlanConfig::default()), trials);
        // Said in other words, it is the same work.
        let other = MINE
            .replace("name = \"none\"", "name = \"without\"")
            .replace("seeds = 2", "seeds = 2\nset = [\"task.stage.fences=true\"]");
        let others = plan(&other, &PlanConfig::default());
        let ids = |trials: &[Trial]| trials.iter().map(|trial| trial.id.clone()).collect::<Vec<_>>();
        assert_eq!(ids(&others), ids(&trials));
        let threads = PlanConfig { set: vec!["trainer.threads=1".to_string()], ..PlanConfig::default() };
        assert_eq!(ids(&plan(MINE, &threads)), ids(&trials));
        let steps = PlanConfig { set: vec!["trainer.total_steps=1000".to_string()], ..PlanConfig::default() };
        assert!(ids(&plan(MINE, &steps)).iter().all(|id| !ids(&trials).contains(id)));
    }

    #[test]
    fn a_smoke_test_does_everything_once() {
        let trials = plan(MINE, &PlanConfig { smoke: true, ..PlanConfig::default() });
        assert_eq!(trials.len(), 2 * 2);
        let Work::Train { training, perform } = &trials[0].work else { panic!("{trials:?}") };
        assert_eq!(training.resolve().unwrap().trainer.total_steps, 480);
        assert_eq!(perform.as_ref().unwrap().runs, 1);
    }

    #[test]
    fn another_truth_under_the_same_name_is_another_trial() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("standard.toml");
        let text = include_str!("../../../configs/twin-params/standard.toml");
        let experiment = Experiment::load("identification").unwrap();
        let fingerprint_of = |text: &str| {
            std::fs::write(&file, text).unwrap();
            experiment.fingerprint_of_truth(file.to_str().unwrap()).unwrap()
        };
        let built_in = experiment.fingerprint_of_truth("standard").unwrap();
        assert_eq!(fingerprint_of(text), built_in, "the content counts, not where it is stored");
        let edited = format!("{text}\n[[faults]]\nkind = \"arm-silent\"\nat_secs = 30.0\n");
        assert_ne!(fingerprint_of(&edited), built_in);
    }

    #[test]
    fn truths_are_part_of_the_work_and_each_has_its_rehearsal() {
        let config = PlanConfig::default();
        let ids = |trials: &[Trial]| trials.iter().map(|trial| trial.id.clone()).collect::<BTreeSet<_>>();
        let [one, both] =
            ["", "truths = ['standard', 'worn']"].map(|line| plan(&format!("{MINE}{line}\n"), &config));
        assert_eq!(one.len(), both.len(), "a policy is trained once and plays on each");
        assert!(ids(&one).is_disjoint(&ids(&both)));
        let rehearse = MINE.replace("[perform]", "[rehearse]\nrounds = 1\ntruths = ['standard', 'worn']");
        let rehearsals = plan(&rehearse, &config);
        assert_eq!(rehearsals.len(), 2 * one.len());
        assert_eq!(ids(&rehearsals).len(), rehearsals.len());
        for trial in &rehearsals {
            let Work::Rehearse { truth, .. } = &trial.work else { panic!("{trial:?}") };
            assert_eq!(&trial.labels["truth"], truth);
        }
    }

    #[test]
    fn every_experiment_that_comes_with_us_can_be_planned() {
        for name in crate::config::names() {
            for smoke in [false, true] {
                let config = PlanConfig { smoke, ..PlanConfig::default() };
                assert!(!Experiment::load(name).unwrap().plan(&config).unwrap().is_empty(), "{name}");
            }
        }
    }
}
