//! The pianist: a trained policy, found by song or by path, or the scripted baseline.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail};
use etude_learn::Policy;
use etude_music::Song;
use etude_perform::shell_word;
use etude_task::reward::OF_A_FINGERING;
use etude_task::{ACTION_LEN, Piece, ScriptedBaseline, TaskConfig, TaskError, layout};
use serde_json::Value;

use crate::at_sight::predicted_at_sight;
use crate::config::{DEFAULT_PRESET, RunConfig, change, resolve};
use crate::folder::{other_notes, policy_in};
use crate::planning::plan;
use crate::play::scores_in_simulation;

/// Folder of the runs, in the working folder.
const RUNS: &str = "runs";
/// Name of the policy for pieces without one of their own, as of a song: `policies/sight-reader.safetensors` and runs in
/// `runs/sight-reader__…`.
pub const SIGHT_READER: &str = "sight-reader";

/// What chooses the actions.
#[derive(Clone)]
pub(crate) enum Kind {
    /// A learned policy, from this file.
    Policy(Box<Policy>, PathBuf),
    /// Inverse kinematics and timing, without learning.
    Script,
}

/// A pianist that is ready for one piece.
#[derive(Clone)]
pub(crate) enum Ready {
    Policy(Box<Policy>),
    Script(Box<ScriptedBaseline>),
}

impl Ready {
    /// What limits the scripted baseline on the piece; `None` for a policy.
    pub(crate) fn limits(&self) -> Option<String> {
        match self {
            Self::Policy(_) => None,
            Self::Script(script) => Some(script.limits().to_string()),
        }
    }
}

impl etude_task::Player for Ready {
    fn act(&mut self, step: usize, observation: &[f32], action: &mut [f32; ACTION_LEN]) {
        match self {
            Self::Policy(policy) => policy.act(observation, action),
            Self::Script(script) => *action = script.action(step),
        }
    }
}

/// A policy or the scripted baseline, with the configuration that it plays in.
#[derive(Clone)]
pub struct Pianist {
    pub(crate) kind: Kind,
    /// The configuration; of a policy the one that it was trained with.
    pub config: RunConfig,
    /// Title of the song that it learned, if the file says.
    pub song: Option<String>,
    /// F1 that the file claims, if it says.
    pub claimed_f1: Option<f64>,
    /// The mean of F1 and onset F1 with which it was saved.
    pub claimed_overall: Option<f64>,
    /// The notes that it then played right.
    pub claimed_notes: Option<f64>,
    /// The notes that were then due.
    pub claimed_due: Option<f64>,
}

/// Folders that may hold shipped policies: `policies` in the working folder, beside an installed binary, the source tree.
fn policy_folders() -> Vec<PathBuf> {
    let mut folders = vec![PathBuf::from("policies")];
    if let Some(prefix) =
        std::env::current_exe().ok().as_deref().and_then(Path::parent).and_then(Path::parent)
    {
        folders.push(prefix.join("share/etude/policies"));
    }
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../policies");
    folders.push(source.canonicalize().unwrap_or(source));
    folders
}

/// The policy for the song `slug` that comes with Étude.
pub fn shipped_policy(slug: &str) -> Option<PathBuf> {
    let name = format!("{slug}.safetensors");
    policy_folders().into_iter().map(|folder| folder.join(&name)).find(|path| path.is_file())
}

/// The policy called `name`: a policy file, the folder of a run, or the name of a policy that comes with Étude.
///
/// # Errors
/// If there is none.
pub fn policy_called(name: &Path) -> anyhow::Result<PathBuf> {
    if name.exists() {
        return Ok(name.to_path_buf());
    }
    name.to_str().and_then(shipped_policy).with_context(|| {
        let mut shipped: Vec<String> = policy_folders()
            .iter()
            .filter_map(|folder| std::fs::read_dir(folder).ok())
            .flatten()
            .flatten()
            .filter_map(|entry| Some(entry.file_name().to_str()?.strip_suffix(".safetensors")?.to_string()))
            .collect();
        shipped.sort();
        shipped.dedup();
        format!(
            "there is no policy `{}`: name the folder of a run, a policy file, or one that comes with Étude ({})",
            name.display(),
            shipped.join(", ")
        )
    })
}

/// The policies for the song `slug`: those of the runs in `runs/`, then the one that comes with Étude.
pub fn policies(slug: &str) -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = std::fs::read_dir(RUNS)
        .into_iter()
        .flatten()
        .flatten()
        .filter(|entry| {
            let name = entry.file_name();
            name.to_string_lossy()
                .strip_prefix(slug)
                .is_some_and(|rest| rest.is_empty() || rest.starts_with("__"))
        })
        .filter_map(|entry| policy_in(&entry.path()))
        .collect();
    found.sort();
    found.extend(shipped_policy(slug));
    found
}

/// Loads the policy at `path`, a policy file or a run's folder.
///
/// # Errors
/// If there is none, or it cannot be used.
pub fn load_pianist(path: &Path) -> anyhow::Result<Pianist> {
    if !path.is_dir() {
        return open(path);
    }
    open(&policy_in(path).with_context(|| {
        format!("{} holds no policy; name the folder of a run, or a policy file", path.display())
    })?)
}

/// The best sight-reader, of those that were evaluated on the same pieces as the one that comes with Étude: scores on others do not
/// compare.
///
/// # Errors
/// If there are some, and none can be used.
pub(crate) fn sight_reader() -> anyhow::Result<Option<Pianist>> {
    // Another generator of melodies has other notes under the same configuration.
    let evaluated_on = |pianist: &Pianist| (pianist.config.corpus.clone(), pianist.claimed_due);
    let shipped = shipped_policy(SIGHT_READER).and_then(|path| open(&path).ok());
    let shipped = shipped.as_ref().map(evaluated_on);
    best_of(SIGHT_READER, |pianist| shipped.as_ref().is_none_or(|shipped| *shipped == evaluated_on(pianist)))
}

/// The best usable policy that there is for the song `slug`, of those that `fit` and were evaluated, if there is one: that with the
/// highest mean of F1 and onset F1, one by an articulated plan before all others, because scores do not compare between plans. Among
/// equally good policies, one of a run is preferred to the shipped one.
///
/// # Errors
/// If there are some, and none can be used.
fn best_of(slug: &str, fit: impl Fn(&Pianist) -> bool) -> anyhow::Result<Option<Pianist>> {
    // One damaged file must not keep the others from playing.
    let (mut pianists, mut errors) = (Vec::new(), Vec::new());
    for path in policies(slug) {
        match open(&path) {
            // A training that was stopped before its first evaluation has a policy that has learned nothing.
            Ok(pianist) if pianist.claimed_f1.is_none() || !fit(&pianist) => {}
            Ok(pianist) => pianists.push(pianist),
            Err(error) => errors.push(error),
        }
    }
    let rank = |pianist: &Pianist| (pianist.config.task.plan.rule, pianist.claimed_overall.unwrap_or(0.0));
    pianists.sort_by(|a, b| {
        let ((rule_a, score_a), (rule_b, score_b)) = (rank(a), rank(b));
        rule_b.cmp(&rule_a).then(score_b.total_cmp(&score_a))
    });
    match pianists.into_iter().next() {
        None => errors.into_iter().next().map_or(Ok(None), Err),
        found => Ok(found),
    }
}

/// The player of a song for which no policy was named.
pub struct Chosen {
    /// The player.
    pub pianist: Pianist,
    /// The best policy that has learned the song, if the sight-reader will play it better.
    pub passed_over: Option<Pianist>,
}

/// The player of `song`, which was `asked` for and has this short form, if no policy is named: the best of its policies that have
/// learned these notes, or else the sight-reader. If that policy misses notes and the sight-reader is predicted to play more, the
/// sight-reader plays the song in simulation, and is chosen if it plays more notes right, with a higher F1: a training that was stopped early must not make a song worse. A policy that
/// has learned loud and soft may have a slightly lower F1.
///
/// # Errors
/// If there is none, or none can be used.
pub fn pianist_for(asked: &str, slug: &str, song: &Song) -> anyhow::Result<Chosen> {
    let own = best_of(slug, |pianist| pianist.has_learned(song))?;
    let chosen = match own {
        None => sight_reader()?.map(|pianist| Chosen { pianist, passed_over: None }),
        Some(own) => Some(match better_at_sight(&own, song) {
            Some(pianist) => Chosen { pianist, passed_over: Some(own) },
            None => Chosen { pianist: own, passed_over: None },
        }),
    };
    chosen.with_context(|| {
        format!(
            "there is no policy for `{asked}` yet: `etude train {}` makes one, or name one with --policy (looked in \
             policies/ and {RUNS})",
            shell_word(asked)
        )
    })
}

/// What loud and soft, which the sight-reader does not play, are worth in F1.
const WORTH_OF_LOUD_AND_SOFT: f64 = 0.05;

/// The sight-reader, if in simulation it plays more notes of `song` right than `own` has, and with a higher F1.
fn better_at_sight(own: &Pianist, song: &Song) -> Option<Pianist> {
    let worth = if own.config.task.velocities { WORTH_OF_LOUD_AND_SOFT } else { 0.0 };
    let notes = own.claimed_notes.filter(|notes| *notes < song.notes().len() as f64)?;
    let f1 = own.claimed_f1? + worth;
    let reader = sight_reader().ok()??;
    let task = &reader.config.task;
    let piece = plan(song, task).ok()?;
    // The prediction is often too high, seldom too low, and needs no simulation.
    let predicted = predicted_at_sight(song, task, &piece)?;
    if notes >= predicted.notes_right as f64 || f1 >= predicted.f1 {
        return None;
    }
    let at_sight = scores_in_simulation(&reader, &piece).ok()?;
    (notes < at_sight.note.matched as f64 && f1 < at_sight.frame.f1).then_some(reader)
}

/// The pianist with the policy in the file `path`.
pub(crate) fn open(path: &Path) -> anyhow::Result<Pianist> {
    let fail = |message: String| anyhow!("cannot use the policy {}: {message}", path.display());
    let policy = Policy::load(path)?;
    let notes = &policy.header().notes;
    let training = &notes["training"];
    let config = RunConfig::stored(training["config"].clone())
        .map_err(|e| fail(format!("its training configuration cannot be read: {e}")))?;
    if layout(&config.task) != policy.header().layout || policy.header().action_len != etude_task::ACTION_LEN
    {
        return Err(fail("it was trained for another observation or action".to_string()));
    }
    let song = training["song"].as_str().map(str::to_string);
    let claimed_f1 = notes["scores"]["f1"].as_f64();
    // Policies of earlier builds have F1 alone.
    let claimed_overall = notes["scores"]["overall"].as_f64().or(claimed_f1);
    let claimed_notes = notes["scores"]["notes_right"].as_f64();
    let missed = notes["scores"]["notes_missed"].as_f64();
    let claimed_due = claimed_notes.zip(missed).map(|(right, missed)| right + missed);
    let kind = Kind::Policy(Box::new(policy), path.to_path_buf());
    Ok(Pianist { kind, config, song, claimed_f1, claimed_overall, claimed_notes, claimed_due })
}

/// Adds to `changes` each value below `path` that `new` has and `old` has not.
fn list_changes(path: &str, old: &Value, new: &Value, changes: &mut Vec<String>) {
    match (old, new) {
        (Value::Object(old), Value::Object(new)) => {
            for (key, value) in new {
                list_changes(&format!("{path}.{key}"), old.get(key).unwrap_or(&Value::Null), value, changes);
            }
        }
        (old, new) if old != new => changes.push(format!("{path} = {new}")),
        _ => {}
    }
}

impl Pianist {
    /// The scripted baseline, the baseline that needs no training, in the world of the default preset. It plans for itself, so its actions
    /// are those of a task without a fingering: it moves the rail earlier than the plan, by the rail's lag.
    pub fn scripted() -> Self {
        let mut changes = ["task.fingering=false", "task.finger_range=0"].map(str::to_string).to_vec();
        changes.push(format!("task.change_steps={}", TaskConfig::default().change_steps));
        changes.extend(OF_A_FINGERING.map(|term| format!("task.reward.{term}=0")));
        let config = resolve(DEFAULT_PRESET, None, &changes).expect("a preset of our own is sound");
        Self {
            kind: Kind::Script,
            config,
            song: None,
            claimed_f1: None,
            claimed_overall: None,
            claimed_notes: None,
            claimed_due: None,
        }
    }

    /// The network that decides the actions; the scripted baseline has none.
    pub fn policy(&self) -> Option<&Policy> {
        match &self.kind {
            Kind::Policy(policy, _) => Some(policy),
            Kind::Script => None,
        }
    }

    /// Whether it is a policy that has learned a corpus of pieces, for pieces that it has not seen.
    pub fn reads_at_sight(&self) -> bool {
        self.config.corpus.is_some()
    }

    /// The policy's file; the scripted baseline has none.
    pub fn file(&self) -> Option<&Path> {
        match &self.kind {
            Kind::Policy(_, path) => Some(path),
            Kind::Script => None,
        }
    }

    /// The policy's file, or `scripted`.
    pub fn name(&self) -> String {
        self.file().map_or_else(|| "scripted".to_string(), |path| path.display().to_string())
    }

    /// Whether a policy was trained on `song`, as far as its file and its folder say.
    fn has_learned(&self, song: &Song) -> bool {
        self.song.as_deref().is_none_or(|learned| learned == song.title())
            && self.learned_other_notes(song).is_none()
    }

    /// Number of notes of the song that the policy was trained on, if these are not the notes of `song`; `None` if they are, or if
    /// the policy is not in a run's folder. Titles are not compared.
    pub fn learned_other_notes(&self, song: &Song) -> Option<usize> {
        match &self.kind {
            Kind::Policy(_, path) => other_notes(path.parent()?, song),
            Kind::Script => None,
        }
    }

    /// What plays `piece` in `task`; tells what share of its planning is done, 0 to 1.
    pub(crate) fn ready(
        &self,
        task: &TaskConfig,
        piece: &Piece,
        tell: &mut dyn FnMut(f64),
    ) -> Result<Ready, TaskError> {
        Ok(match &self.kind {
            Kind::Policy(policy, _) => Ready::Policy(policy.clone()),
            Kind::Script => Ready::Script(Box::new(ScriptedBaseline::new_with_progress(task, piece, tell)?)),
        })
    }

    /// Changes the world that the policy is played in, by overrides of the form `a.b=value`. Returns the settings that
    /// are not those of its training, except the lead of the plan, which changes nothing for the policy.
    ///
    /// # Errors
    /// If an override is not sound, or would change what the policy sees.
    pub fn reconfigure(&mut self, overrides: &[String]) -> anyhow::Result<Vec<String>> {
        let changed = change(&self.config, overrides)?;
        if let Kind::Policy(policy, path) = &self.kind
            && layout(&changed.task) != policy.header().layout
        {
            let message = "it was trained for another observation than these overrides make".to_string();
            bail!("cannot use the policy {}: {message}", path.display());
        }
        let mut others = Vec::new();
        if matches!(self.kind, Kind::Policy(..)) {
            let value =
                |task: &TaskConfig| serde_json::to_value(task).expect("a configuration is plain data");
            list_changes("task", &value(&self.config.task), &value(&changed.task), &mut others);
            others.retain(|change| !change.starts_with("task.plan.latency_compensation_secs"));
        }
        self.config = changed;
        Ok(others)
    }
}

#[cfg(test)]
mod tests {
    use etude_music::repertoire;

    use super::*;

    /// The prediction for chords without silence is too high. What counts is what the sight-reader plays.
    #[test]
    fn a_policy_is_passed_over_for_what_the_sight_reader_plays_and_not_for_what_is_predicted() {
        let song = repertoire::get("chord-progression").unwrap();
        let reader = sight_reader().unwrap().unwrap();
        let piece = plan(&song, &reader.config.task).unwrap();
        let at_sight = scores_in_simulation(&reader, &piece).unwrap();
        let predicted = predicted_at_sight(&song, &reader.config.task, &piece).unwrap();
        assert!(predicted.notes_right > at_sight.note.matched && predicted.f1 > at_sight.frame.f1 - 0.005);
        let mut own = open(&shipped_policy("chord-progression").unwrap()).unwrap();
        let is_passed_over = |own: &mut Pianist, notes: usize, f1: f64| {
            (own.claimed_notes, own.claimed_f1) = (Some(notes as f64), Some(f1));
            better_at_sight(own, &song).is_some()
        };
        let (notes, f1) = (at_sight.note.matched, at_sight.frame.f1);
        assert!(is_passed_over(&mut own, notes - 1, f1 - 0.01));
        assert!(!is_passed_over(&mut own, notes, f1 - 0.01), "as many notes");
        assert!(!is_passed_over(&mut own, notes - 1, f1 + 0.001), "a higher F1");
        own.config.task.velocities = true;
        assert!(!is_passed_over(&mut own, notes - 1, f1 - 0.01), "loud and soft are worth more");
    }
}
