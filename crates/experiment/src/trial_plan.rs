//! The plan of an experiment: the list of its trials.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{anyhow, bail};
use etude_lab::find_song;
use etude_music::Song;
use etude_perform::shell_word;
use etude_twin::TwinParams;

use crate::config::{Experiment, FitConfig, PerformConfig, RehearseConfig, Variant, sets_seed};
use crate::trial::{TrainingConfig, Trial, TrialWork, fingerprint, id, json};

/// Changes to an experiment from outside its file.
#[derive(Clone, Debug, Default)]
pub struct ExperimentConfig {
    /// Number of seeds, instead of the file's.
    pub seeds: Option<u64>,
    /// Everything once and as short as possible, as a test.
    pub smoke: bool,
    /// Overrides of every training, `path=value`; they come last.
    pub set: Vec<String>,
}

/// Overrides of a smoke test: two evaluations and a few updates between them.
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

/// How policies play on a twin. It is part of the ids.
const PLAYED: &str = "latency compensation measured in one run before, F1 of the keys when they sound";

impl ExperimentConfig {
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
    /// If a song, setting or parameter set is not sound.
    pub fn plan(&self, config: &ExperimentConfig) -> anyhow::Result<Vec<Trial>> {
        if let Some(set) = config.set.iter().find(|set| sets_seed(set)) {
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
        for name in all_or_first(&fit.twin_params, smoke) {
            let content = self.fingerprint_of_twin(name)?;
            for method in &fit.methods {
                let work =
                    TrialWork::Identify { twin_params: name.clone(), method: *method, evaluations, seed };
                let labels = [("twin_params", name.clone()), ("method", method.name().to_string())];
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
    fn trainings(
        &self,
        song: Option<&str>,
        seed: u64,
        config: &ExperimentConfig,
    ) -> anyhow::Result<Vec<Trial>> {
        let smoke = config.smoke;
        let notes = song
            .map(|name| find_song(name, false))
            .transpose()?
            .map_or_else(String::new, |song| notes_of(&song));
        let mut trials = Vec::new();
        let alone = [Variant::default()];
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
                    Some(corpus) if song.is_none() => {
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
                let (perform, on_twin) = self.performance(variant, smoke)?;
                let (rehearse, rehearsed) = self.rehearsal(variant, smoke)?;
                let name = training.song.as_deref().unwrap_or(CORPUS);
                let id = id("train", name, seed, &format!("{what}{on_twin}{rehearsed}"));
                trials.push(Trial { id, labels, work: TrialWork::Train { training, perform, rehearse } });
            }
        }
        Ok(trials)
    }

    /// How a player plays on the twin, and a text that differs where the result may.
    pub(crate) fn performance(
        &self,
        variant: &Variant,
        smoke: bool,
    ) -> anyhow::Result<(Option<PerformConfig>, String)> {
        let perform = self.perform.clone().map(|perform| PerformConfig {
            modes: variant.modes.clone().unwrap_or(perform.modes),
            runs: if smoke { 1 } else { perform.runs },
            twin_params: variant.twin_params.clone().unwrap_or(perform.twin_params),
        });
        let mut text = json(&perform);
        if perform.is_some() {
            text += PLAYED;
        }
        for name in perform.iter().flat_map(|perform| &perform.twin_params) {
            text += &self.fingerprint_of_twin(name)?;
        }
        Ok((perform, text))
    }

    /// How a trained policy is rehearsed, and a text that differs where the result may. In a smoke
    /// test once, since fits are what it would spend its time on.
    fn rehearsal(&self, variant: &Variant, smoke: bool) -> anyhow::Result<(Option<RehearseConfig>, String)> {
        let Some(rehearse) = self.rehearse.clone() else { return Ok((None, String::new())) };
        let modes = variant.modes.clone().unwrap_or(rehearse.modes);
        let twin_params = variant.twin_params.clone().unwrap_or(rehearse.twin_params);
        if twin_params.is_empty() {
            return Ok((None, String::new()));
        }
        let rehearse = RehearseConfig {
            modes: all_or_first(&modes, smoke).to_vec(),
            twin_params: all_or_first(&twin_params, smoke).to_vec(),
            fits: all_or_first(&rehearse.fits, smoke).to_vec(),
            iterations: if smoke { 1 } else { rehearse.iterations },
            runs: if smoke { 1 } else { rehearse.runs },
            steps: rehearse.steps.filter(|_| !smoke),
            evaluations: if smoke { Some(SMOKE_EVALUATIONS) } else { rehearse.evaluations },
        };
        let mut text = json(&rehearse) + PLAYED;
        for name in &rehearse.twin_params {
            text += &self.fingerprint_of_twin(name)?;
        }
        Ok((Some(rehearse), text))
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

    /// Differs for twin parameters of different content, whether they come with Étude or from a
    /// file.
    fn fingerprint_of_twin(&self, name: &str) -> anyhow::Result<String> {
        let params = TwinParams::load(name).map_err(|error| anyhow!("experiment {}: {error}", self.name))?;
        Ok(format!("{:08x}", params.fingerprint()))
    }
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
pub(crate) mod tests;
