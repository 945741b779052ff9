//! Warm starts: beginning a training with what another has learned.

use std::fmt::Display;
use std::path::Path;

use anyhow::{anyhow, bail};
use etude_learn::{TrainError, Trainer, TrainingInputs, WarmStart};
use serde_json::{Value, json};

use crate::config::RunConfig;
use crate::folder::policy_in;
use crate::loaded_player::load_policy_file;

/// `config` for a training that begins with what the run or policy at `source` has learned. The
/// range of the rail's targets is that of the source, whose actions have no meaning in another one.
/// If the source is a sight-reader, the training has its networks, its observation and its plan
/// too, which it has learned to play.
pub fn beginning_with(mut config: RunConfig, source: &Path) -> RunConfig {
    let file = if source.is_dir() { policy_in(source) } else { Some(source.to_path_buf()) };
    let Some(theirs) = file.and_then(|file| load_policy_file(&file).ok()).map(|player| player.config) else {
        return config;
    };
    config.task.rail_range = theirs.task.rail_range;
    if theirs.corpus.is_some() { in_the_form_of(config, &theirs) } else { config }
}

/// `config` with the networks and the observation of `other`, and its plan, so that a training can
/// begin with what that one has learned.
fn in_the_form_of(mut config: RunConfig, other: &RunConfig) -> RunConfig {
    config.droq.hidden.clone_from(&other.droq.hidden);
    let (task, other) = (&mut config.task, &other.task);
    task.lookahead = other.lookahead;
    task.previous_joints = other.previous_joints;
    task.previous_actions = other.previous_actions;
    task.fingering = other.fingering;
    task.change_steps = other.change_steps;
    task.finger_range = other.finger_range;
    task.view = other.view;
    task.rail_set_point = other.rail_set_point;
    task.scale = other.scale;
    config
}

/// Settings of a policy's task that a training must have too, to begin with it.
const SAME_SETTINGS: &str = "task.stage.side task.scale task.lookahead task.previous_joints task.previous_actions \
     task.fingering task.velocities task.finger_range task.rail_range task.view";

/// What the run or policy at `path` has learned, if a training by `config` of the song with this
/// title, or of a corpus, can begin with it.
pub(crate) fn warm_start(
    path: &Path,
    song: Option<&str>,
    config: &RunConfig,
    parts: &TrainingInputs,
) -> anyhow::Result<WarmStart> {
    let warm = match (path.is_dir(), policy_in(path)) {
        (false, _) => WarmStart::from_policy(path),
        (true, _) if Trainer::exists(path) => WarmStart::from_run(path),
        (true, Some(policy)) => WarmStart::from_policy(&policy),
        (true, None) => bail!(
            "{} holds no policy to begin with; name the folder of a run, or a policy file",
            path.display()
        ),
    };
    let warm = warm.map_err(TrainError::from)?;
    let unknown = || {
        anyhow!(
            "a training cannot begin with {}: it does not say which song and task it has learned; begin without --from",
            path.display()
        )
    };
    let theirs: RunConfig = serde_json::from_value(warm.notes()["config"].clone()).map_err(|_| unknown())?;
    let learned = warm.notes()["song"].as_str();
    if learned.is_none() && theirs.corpus.is_none() {
        return Err(unknown());
    }
    let differ = |what: &str, theirs: &dyn Display, ours: &dyn Display| {
        anyhow!(
            "a training cannot begin with what {} has learned: its {what} is {theirs}, that of this one {ours}; set the same \
             value, or begin without --from",
            path.display()
        )
    };
    // A training of any song can begin with what has learned a corpus, and one of a corpus with
    // what has learned a song.
    if let Some((theirs, ours)) = learned.zip(song).filter(|(theirs, ours)| theirs != ours) {
        return Err(differ("song", &format!("`{theirs}`"), &format!("`{ours}`")));
    }
    let [theirs, ours] = [&theirs, config].map(|config| json!({ "task": config.task }));
    for setting in SAME_SETTINGS.split_whitespace() {
        let value = |config: &'_ Value| config.pointer(&format!("/{}", setting.replace('.', "/"))).cloned();
        let [theirs, ours] = [&theirs, &ours].map(|config| value(config).unwrap_or_default());
        if theirs != ours {
            return Err(differ(setting, &theirs, &ours));
        }
    }
    warm.check(&config.droq, &*parts.environment)?;
    Ok(warm)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{DEFAULT_PRESET, resolve};
    use crate::policy_files::shipped_policy;

    /// Some policies have more room for the rail than the preset, and are trained further all the
    /// same.
    #[test]
    fn a_training_has_the_rails_range_of_the_policy_that_it_begins_with() {
        let fast = resolve(DEFAULT_PRESET, None, &[]).unwrap();
        let range = |song: &str| beginning_with(fast.clone(), &shipped_policy(song).unwrap()).task.rail_range;
        assert_eq!(range("surprise-symphony"), 0.04);
        assert_eq!(range("twinkle"), fast.task.rail_range);
        assert_eq!(range(crate::zero_shot::SIGHT_READER), fast.task.rail_range);
        assert_eq!(beginning_with(fast.clone(), Path::new("nowhere")), fast);
    }
}
