//! Training a song or a corpus: the run folder, its description, and the trainer in it.

use std::fs::{File, TryLockError};
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context as _, anyhow, bail};
use etude_learn::{
    Outcome, Policy, Score, TrainError, Trainer, TrainerConfig, TrainingInputs, TrainingObserver, seed,
};
use etude_music::{Song, SongError};
use etude_perform::{Job, TrainingEvaluator, shell_word, write_file};
use etude_task::{Corpus, PianoVectorEnv, TaskConfig};
use serde_json::{Value, json};

use crate::config::{RunConfig, change_resumable, stored_config};
use crate::errors::unusable;
use crate::folder::{CONFIG, META, SONG, make_folder, other_notes, policy_in};
use crate::loaded_player::load_policy_file;
use crate::song_planner::SongPlanner;
use crate::training_progress::{JobObserver, TrainingProgress};
use crate::warm_start::warm_start;

/// Name of the file that a process locks while it works in a run's folder. The system releases the
/// lock when the process ends.
const LOCK: &str = "run.lock";

/// What a training without a song of its own learns, as its description says.
const SIGHT_READING: &str = "sight-reading";

/// A training in its folder, which is locked for other processes.
pub struct Training {
    /// The song; none where a corpus is learned.
    song: Option<Song>,
    config: RunConfig,
    trainer: Trainer,
    _lock: File,
}

impl Training {
    /// Starts a training in `folder`: of `song` or, without one, of the configuration's corpus.
    /// `command` is recorded.
    ///
    /// Without a `source` the networks are random. A `source` is what another training has learned,
    /// in any physics: a run's folder (its last policy with critics, targets and temperature) or a
    /// policy file (the actor alone). See [`WarmStart`](etude_learn::WarmStart).
    ///
    /// # Errors
    /// If there is neither a song nor a corpus, they or the configuration cannot be used, or the
    /// folder cannot be written or already holds a run; and if the source cannot be read, has
    /// learned another song, or its networks or its observations and actions have another form.
    /// Nothing is written before all of this is checked.
    pub fn start(
        song: Option<Song>,
        mut config: RunConfig,
        folder: &Path,
        command: &str,
        source: Option<&Path>,
        planner: &mut SongPlanner<'_>,
    ) -> anyhow::Result<Self> {
        if song.is_some() {
            config.corpus = None;
        } else if config.corpus.is_none() {
            bail!("name a song to learn, or a preset with a corpus of pieces: --preset sight-reader");
        }
        if Trainer::exists(folder) {
            if let Some(song) = &song
                && let Some(theirs) = other_notes(folder, song)
            {
                bail!(
                    "{} holds a training of another `{}` ({theirs} notes, yours has {}, or their times differ): choose another \
                     folder with -o, or delete that one",
                    folder.display(),
                    song.title(),
                    song.notes().len()
                );
            }
            bail!(
                "{} holds a training already: `etude train --resume {}` continues it, or choose another folder with -o",
                folder.display(),
                shell_word(folder.display())
            );
        }
        Trainer::check_vacant(folder)?;
        let config = config.complete();
        config.check()?;
        let title = song.as_ref().map(Song::title);
        let inputs = inputs(song.as_ref(), &config, planner)?;
        let warm = source.map(|source| warm_start(source, title, &config, &inputs)).transpose()?;
        check_replaceable(folder)?;
        make_folder(folder)?;
        let lock = lock_run(folder)?;
        let notes = song.as_ref().map(Song::to_midi);
        let meta = json!({
            "command": command,
            "from": source,
            "song": title.unwrap_or(SIGHT_READING),
            "song_crc32c": notes.as_deref().map(checksum),
            "etude": env!("CARGO_PKG_VERSION"),
            "mujoco": etude_stage::mujoco_version(),
            "cores": std::thread::available_parallelism().map_or(0, usize::from),
            "machine": std::env::consts::ARCH,
        });
        // The first file: it says that the others are a training's.
        write_file(&folder.join(META), &format!("{meta:#}\n"))?;
        write_config(folder, &config)?;
        if let Some(notes) = notes {
            write_file(&folder.join(SONG), &notes)?;
        }
        let (droq, trainer) = (&config.droq, &config.trainer);
        let trainer = Trainer::start(folder, droq, trainer, inputs, warm.as_ref())?;
        Ok(Self { song, config, trainer, _lock: lock })
    }

    /// Resumes the training in `folder` from its last checkpoint, bit for bit. `overrides` may
    /// change its length and how often it is evaluated, logged and saved, but nothing that affects
    /// what it learns.
    ///
    /// # Errors
    /// If the folder holds no run or a damaged one, or an override would make another training of
    /// it.
    pub fn resume(
        folder: &Path,
        overrides: &[String],
        planner: &mut SongPlanner<'_>,
    ) -> anyhow::Result<Self> {
        let without = |name: &str| match Trainer::exists(folder) {
            true => anyhow!(
                "the training in {} cannot be continued without its {name}: put it back, or choose another folder",
                folder.display()
            ),
            false => anyhow!(
                "{} holds no run to continue; `etude train SONG -o {}` starts one",
                folder.display(),
                shell_word(folder.display())
            ),
        };
        if Trainer::exists(folder) {
            Trainer::check_schema(folder).map_err(|error| with_policy_hint(error, folder))?;
        }
        let settings =
            Some(folder.join(CONFIG)).filter(|config| config.is_file()).ok_or_else(|| without(CONFIG))?;
        let config = stored_config(&settings)
            .with_context(|| {
                let from = shell_word(folder.display());
                format!(
                    "the training in {} cannot be continued as it is (`--from {from}` begins another with its policy)",
                    folder.display()
                )
            })?;
        if config.corpus.is_none() && !folder.join(SONG).is_file() {
            return Err(without(SONG));
        }
        let config = change_resumable(&config, overrides)?;
        config.check()?;
        let song = match config.corpus {
            Some(_) => None,
            None => Some(titled(Song::load(folder.join(SONG))?, folder)?),
        };
        let lock = lock_run(folder)?;
        if learned_task(folder).is_some_and(|task| task != config.task) {
            let [config, from] =
                [folder.join(CONFIG), folder.to_path_buf()].map(|path| shell_word(path.display()));
            bail!(
                "the `task` of {}/{CONFIG} is not what this training has learned so far: put it back, or begin another \
                 training with `--config {config} --from {from} -o DIR`",
                folder.display()
            );
        }
        if song.is_some() && recorded_checksum(folder) != Some(song_checksum(folder)?) {
            let folder = folder.display();
            bail!(
                "{folder}/{SONG} is not the song that this training has learned so far: put it back, or begin another training \
                 with `etude train SONG -o DIR`"
            );
        }
        let trainer =
            Trainer::resume(folder, &config.droq, &config.trainer, inputs(song.as_ref(), &config, planner)?)
                .map_err(|error| with_policy_hint(error, folder))?;
        if !overrides.is_empty() {
            write_config(folder, &config)?;
        }
        Ok(Self { song, config, trainer, _lock: lock })
    }

    /// Resumes the training in `folder`, or starts it, as [`start`](Self::start).
    ///
    /// # Errors
    /// As those.
    pub fn start_or_resume(
        song: Option<Song>,
        config: RunConfig,
        folder: &Path,
        command: &str,
        source: Option<&Path>,
        planner: &mut SongPlanner<'_>,
    ) -> anyhow::Result<Self> {
        let threads = format!("trainer.threads={}", config.trainer.threads);
        if Trainer::exists(folder) {
            return Self::resume(folder, &[threads], planner);
        }
        Self::start(song, config, folder, command, source, planner)
    }

    /// The song that is learned; none where a corpus is.
    pub fn song(&self) -> Option<&Song> {
        self.song.as_ref()
    }

    /// The resolved configuration.
    pub fn config(&self) -> &RunConfig {
        &self.config
    }

    /// Environment steps made so far.
    pub fn step(&self) -> u64 {
        self.trainer.step()
    }

    /// Scores of the best policy so far; none before the first evaluation.
    pub fn best_scores(&self) -> &[Score] {
        self.trainer.best().map_or(&[], |best| &best.scores)
    }

    /// Trains to the end, or until the observer stops it; in both cases everything is saved.
    ///
    /// # Errors
    /// If the training fails; the last checkpoint is then intact.
    pub fn run(&mut self, observer: &mut dyn TrainingObserver) -> anyhow::Result<Outcome> {
        Ok(self.trainer.run(observer)?)
    }

    /// The same as a job, whose interruption stops it.
    ///
    /// # Errors
    /// As [`run`](Self::run).
    pub fn run_job(&mut self, job: &mut Job<'_, TrainingProgress>) -> anyhow::Result<Outcome> {
        let (step, total) = (self.step(), self.config.trainer.total_steps);
        let at = TrainingProgress::new(step, total, self.best_scores());
        self.run(&mut JobObserver { at, job })
    }
}

/// Checksum of the song's file in a run's folder.
fn song_checksum(folder: &Path) -> anyhow::Result<String> {
    let path = folder.join(SONG);
    let bytes = std::fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
    Ok(checksum(&bytes))
}

fn checksum(bytes: &[u8]) -> String {
    format!("{:08x}", crc32c::crc32c(bytes))
}

/// What is recorded of the run in `folder`, if anything.
fn read_meta(folder: &Path) -> Option<Value> {
    serde_json::from_slice(&std::fs::read(folder.join(META)).ok()?).ok()
}

/// The checksum of the song when the run was started.
fn recorded_checksum(folder: &Path) -> Option<String> {
    Some(read_meta(folder)?["song_crc32c"].as_str()?.to_string())
}

/// The error of a training that cannot be resumed, with what of it can still be used.
fn with_policy_hint(error: TrainError, folder: &Path) -> anyhow::Error {
    let policy = policy_in(folder).filter(|_| !matches!(error, TrainError::NothingToResume { .. }));
    let Some(policy) = policy.filter(|policy| Policy::load(policy).is_ok()) else { return error.into() };
    let [song, config, policy] =
        [folder.join(SONG), folder.join(CONFIG), policy].map(|path| shell_word(path.display()));
    // A corpus has no song.
    let song = if folder.join(SONG).is_file() { format!("{song} ") } else { String::new() };
    let begin = format!("`etude train {song}--config {config} --from {policy} -o DIR`");
    anyhow!("{error}; its policy is not damaged: {begin} starts a new training from it")
}

/// The task that the run in `folder` has learned so far, if its last policy holds it.
fn learned_task(folder: &Path) -> Option<TaskConfig> {
    load_policy_file(&folder.join("policy-last.safetensors")).ok().map(|player| player.config.task)
}

/// The song of this name or path; that of a run's folder as it was learned, with its title then.
/// The silence before a file's first note is left out, unless `keep_silence`.
///
/// # Errors
/// As [`etude_music::resolve`].
pub fn find_song(name_or_path: &str, keep_silence: bool) -> Result<Song, SongError> {
    match Path::new(name_or_path).parent() {
        Some(folder) if Path::new(name_or_path).ends_with(SONG) => {
            titled(etude_music::resolve_file(name_or_path)?.song, folder)
        }
        _ if keep_silence => Ok(etude_music::resolve_file(name_or_path)?.song),
        _ => etude_music::resolve(name_or_path),
    }
}

/// `song` under the title that the description of the run in `folder` gives it, if there is one.
fn titled(song: Song, folder: &Path) -> Result<Song, SongError> {
    let Some(title) = read_meta(folder).and_then(|meta| meta["song"].as_str().map(str::to_string)) else {
        return Ok(song);
    };
    let beats = song.beats().clone();
    Ok(Song::new(title, song.notes().to_vec(), song.duration_secs())?.with_beats(beats))
}

/// Refuses a folder with files that a training would replace, unless a training without a
/// checkpoint, which has failed or was killed, has written them.
fn check_replaceable(folder: &Path) -> anyhow::Result<()> {
    let is_of_a_training = read_meta(folder).is_some_and(|meta| meta["etude"].is_string());
    let mut names = [META, CONFIG, SONG, "metrics.jsonl"].iter();
    match names.find(|name| folder.join(name).exists()).filter(|_| !is_of_a_training) {
        Some(name) => bail!(
            "{} is not of a training, and would be replaced: choose another folder with -o, or move the file away",
            folder.join(name).display()
        ),
        None => Ok(()),
    }
}

fn write_config(folder: &Path, config: &RunConfig) -> anyhow::Result<()> {
    Ok(write_file(&folder.join(CONFIG), &toml::to_string(config)?)?)
}

/// Takes the lock of a run's `folder`. Where the file system has no locks, every process gets it.
fn lock_run(folder: &Path) -> anyhow::Result<File> {
    let path = folder.join(LOCK);
    let file =
        File::options().create(true).append(true).open(&path).map_err(|error| unusable(&path, error))?;
    if matches!(file.try_lock(), Err(TryLockError::WouldBlock)) {
        bail!(
            "another `etude train` is at work in {}: wait for it, stop it, or choose another folder with -o",
            folder.display()
        );
    }
    Ok(file)
}

/// What a training of `song` or, without one, of the corpus needs.
fn inputs(
    song: Option<&Song>,
    config: &RunConfig,
    planner: &mut SongPlanner<'_>,
) -> anyhow::Result<TrainingInputs> {
    let (task, envs) = (&config.task, config.trainer.num_envs);
    let root = seed::split(config.trainer.seed, "task");
    let (environment, evaluator) = if let Some(song) = song {
        let piece = planner.plan(song, task)?;
        (PianoVectorEnv::new(task, &piece, envs, root)?, TrainingEvaluator::new(task, &piece)?)
    } else {
        let corpus = Arc::new(Corpus::new(&config.corpus.clone().unwrap_or_default(), task)?);
        let evaluator = TrainingEvaluator::of_corpus(task, &corpus)?;
        (PianoVectorEnv::of_corpus(task, &corpus, envs, root)?, evaluator)
    };
    // Threads do not change the result, so they are not stored in a policy: same seed, same bytes.
    let defaults = TrainerConfig::default();
    let (threads, overlap) = (defaults.threads, defaults.overlap);
    let trainer = TrainerConfig { threads, overlap, ..config.trainer.clone() };
    let notes = json!({ "song": song.map(Song::title), "config": RunConfig { trainer, ..config.clone() } });
    Ok(TrainingInputs { environment: Box::new(environment), evaluator: Box::new(evaluator), notes })
}
