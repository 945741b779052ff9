//! What plays a song: a trained policy, loaded from its file, or the scripted baseline.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail};
use etude_learn::Policy;
use etude_music::Song;
use etude_task::reward::FINGERING_TERMS;
use etude_task::{ACTION_LEN, Piece, ScriptedBaseline, TaskConfig, TaskError, layout};
use serde_json::Value;

use crate::config::{DEFAULT_PRESET, RunConfig, change, resolve};
use crate::folder::{other_notes, policy_in};

/// What chooses the actions.
#[derive(Clone)]
pub(crate) enum PlayerKind {
    /// A learned policy, from this file.
    Policy(Box<Policy>, PathBuf),
    /// Inverse kinematics and timing, without learning.
    Scripted,
}

/// The [`Player`](etude_task::Player) of one piece.
#[derive(Clone)]
pub(crate) enum PolicyOrScripted {
    Policy(Box<Policy>),
    Scripted(Box<ScriptedBaseline>),
}

impl PolicyOrScripted {
    /// What limits the scripted baseline on the piece; `None` for a policy.
    pub(crate) fn limits(&self) -> Option<String> {
        match self {
            Self::Policy(_) => None,
            Self::Scripted(baseline) => Some(baseline.unplayed().to_string()),
        }
    }
}

impl etude_task::Player for PolicyOrScripted {
    fn act(&mut self, step: usize, observation: &[f32], action: &mut [f32; ACTION_LEN]) {
        match self {
            Self::Policy(policy) => policy.act(observation, action),
            Self::Scripted(baseline) => *action = baseline.action(step),
        }
    }
}

/// A policy or the scripted baseline, with the configuration that it plays in.
#[derive(Clone)]
pub struct LoadedPlayer {
    pub(crate) kind: PlayerKind,
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

/// Loads the policy at `path`, a policy file or a run's folder.
///
/// # Errors
/// If there is none, or it cannot be used.
pub fn load_player(path: &Path) -> anyhow::Result<LoadedPlayer> {
    if !path.is_dir() {
        return load_policy_file(path);
    }
    load_policy_file(&policy_in(path).with_context(|| {
        format!("{} holds no policy; name the folder of a run, or a policy file", path.display())
    })?)
}

/// The policy in the file `path`.
pub(crate) fn load_policy_file(path: &Path) -> anyhow::Result<LoadedPlayer> {
    let fail = |message: String| anyhow!("cannot use the policy {}: {message}", path.display());
    let policy = Policy::load(path)?;
    let notes = &policy.header().notes;
    let training = &notes["training"];
    let config: RunConfig = serde_json::from_value(training["config"].clone())
        .map_err(|e| fail(format!("its training configuration cannot be read: {e}")))?;
    if layout(&config.task) != policy.header().layout || policy.header().action_len != etude_task::ACTION_LEN
    {
        return Err(fail("it was trained for another observation or action".to_string()));
    }
    let song = training["song"].as_str().map(str::to_string);
    let claimed_f1 = notes["scores"]["f1"].as_f64();
    let claimed_overall = notes["scores"]["overall"].as_f64();
    let claimed_notes = notes["scores"]["notes_right"].as_f64();
    let missed = notes["scores"]["notes_missed"].as_f64();
    let claimed_due = claimed_notes.zip(missed).map(|(right, missed)| right + missed);
    let kind = PlayerKind::Policy(Box::new(policy), path.to_path_buf());
    Ok(LoadedPlayer { kind, config, song, claimed_f1, claimed_overall, claimed_notes, claimed_due })
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

impl LoadedPlayer {
    /// The scripted baseline, the baseline that needs no training, in the world of the default
    /// preset. It plans for itself, so its actions are those of a task without a fingering: it
    /// moves the rail earlier than the plan, by the rail's lag.
    pub fn scripted() -> Self {
        let mut changes = ["task.fingering=false", "task.finger_range=0"].map(str::to_string).to_vec();
        changes.push(format!("task.change_steps={}", TaskConfig::default().change_steps));
        changes.extend(FINGERING_TERMS.map(|term| format!("task.reward.{term}=0")));
        let config = resolve(DEFAULT_PRESET, None, &changes).expect("a preset of our own is sound");
        Self {
            kind: PlayerKind::Scripted,
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
            PlayerKind::Policy(policy, _) => Some(policy),
            PlayerKind::Scripted => None,
        }
    }

    /// Whether it is a policy that has learned a corpus of pieces, for pieces that it has not seen.
    pub fn is_sight_reader(&self) -> bool {
        self.config.corpus.is_some()
    }

    /// The policy's file; the scripted baseline has none.
    pub fn file(&self) -> Option<&Path> {
        match &self.kind {
            PlayerKind::Policy(_, path) => Some(path),
            PlayerKind::Scripted => None,
        }
    }

    /// The policy's file, or `scripted`.
    pub fn name(&self) -> String {
        self.file().map_or_else(|| "scripted".to_string(), |path| path.display().to_string())
    }

    /// Whether a policy was trained on `song`, as far as its file and its folder say.
    pub(crate) fn has_learned(&self, song: &Song) -> bool {
        self.song.as_deref().is_none_or(|learned| learned == song.title())
            && self.learned_other_notes(song).is_none()
    }

    /// Number of notes of the song that the policy was trained on, if these are not the notes of
    /// `song`; `None` if they are, or if the policy is not in a run's folder. Titles are not
    /// compared.
    pub fn learned_other_notes(&self, song: &Song) -> Option<usize> {
        match &self.kind {
            PlayerKind::Policy(_, path) => other_notes(path.parent()?, song),
            PlayerKind::Scripted => None,
        }
    }

    /// What plays `piece` in `task`. `on_progress` receives the share of its planning that is done.
    pub(crate) fn for_piece(
        &self,
        task: &TaskConfig,
        piece: &Piece,
        on_progress: &mut dyn FnMut(f64),
    ) -> Result<PolicyOrScripted, TaskError> {
        Ok(match &self.kind {
            PlayerKind::Policy(policy, _) => PolicyOrScripted::Policy(policy.clone()),
            PlayerKind::Scripted => PolicyOrScripted::Scripted(Box::new(
                ScriptedBaseline::new_with_progress(task, piece, on_progress)?,
            )),
        })
    }

    /// Changes the world that the policy is played in, by overrides of the form `a.b=value`.
    /// Returns the settings that are not those of its training, except the latency compensation,
    /// which changes nothing for the policy.
    ///
    /// # Errors
    /// If an override is not sound, or would change what the policy sees.
    pub fn reconfigure(&mut self, overrides: &[String]) -> anyhow::Result<Vec<String>> {
        let changed = change(&self.config, overrides)?;
        if let PlayerKind::Policy(policy, path) = &self.kind
            && layout(&changed.task) != policy.header().layout
        {
            let message = "it was trained for another observation than these overrides make".to_string();
            bail!("cannot use the policy {}: {message}", path.display());
        }
        let mut others = Vec::new();
        if matches!(self.kind, PlayerKind::Policy(..)) {
            let value =
                |task: &TaskConfig| serde_json::to_value(task).expect("a configuration is plain data");
            list_changes("task", &value(&self.config.task), &value(&changed.task), &mut others);
            others.retain(|change| !change.starts_with("task.plan.latency_compensation_secs"));
        }
        self.config = changed;
        Ok(others)
    }
}
