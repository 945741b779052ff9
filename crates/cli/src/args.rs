//! Arguments that several verbs share.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use clap::builder::{PossibleValue, PossibleValuesParser, StringValueParser, TypedValueParser};
use etude_lab::{
    Chosen, LoadedPlayer, RunConfig, SIGHT_READER, SongPlanner, cannot_be_played, choose_player,
    folder_of_song, load_player, player_slug, policies, policy_called, readable,
};
use etude_music::{Song, repertoire};
use etude_perform::shell_word;

use crate::output::note;

/// Any text; a shell completes these names and paths of files.
#[derive(Clone)]
pub struct NameOrPath(pub fn() -> Vec<&'static str>);

impl TypedValueParser for NameOrPath {
    type Value = String;

    fn parse_ref(
        &self,
        command: &clap::Command,
        arg: Option<&clap::Arg>,
        value: &OsStr,
    ) -> Result<String, clap::Error> {
        StringValueParser::new().parse_ref(command, arg, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new((self.0)().into_iter().map(PossibleValue::new)))
    }
}

pub fn song() -> NameOrPath {
    NameOrPath(|| etude_music::repertoire::ids().collect())
}

pub fn twin_params() -> NameOrPath {
    NameOrPath(|| etude_twin::TwinParams::names().into_iter().chain(["random:"]).collect())
}

/// The layers of a configuration.
#[derive(clap::Args)]
pub struct ConfigArgs {
    /// Start from this preset: fast (a song in minutes), expressive (soft and loud as written, in
    /// more steps), paper (as published), appendix (the paper's variant) or sight-reader (for songs
    /// that it has not seen)
    #[arg(long, default_value = etude_lab::DEFAULT_PRESET, value_name = "NAME", value_parser = PossibleValuesParser::new(etude_lab::presets()), hide_possible_values = true)]
    pub preset: String,
    /// Then apply this TOML file
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Then set single values, for example --set trainer.seed=3 --set task.stage.fences=false
    #[arg(long = "set", value_name = "PATH=VALUE")]
    pub overrides: Vec<String>,
}

impl ConfigArgs {
    pub fn resolve(&self) -> anyhow::Result<RunConfig> {
        etude_lab::resolve(&self.preset, self.config.as_deref(), &self.overrides)
    }
}

/// The player.
#[derive(clap::Args)]
pub struct PlayerArgs {
    /// A policy file, the folder of a run, or the name of a shipped policy, for example
    /// sight-reader; by default the best policy for this song or, without one, the sight-reader
    #[arg(long, value_name = "PATH")]
    pub policy: Option<PathBuf>,
    /// Play the scripted baseline (inverse kinematics and timing, no training) instead of a policy
    #[arg(long, conflicts_with = "policy")]
    pub scripted: bool,
    /// Change the simulated world, for example --set task.physics.key.threshold=0.7
    #[arg(long = "set", value_name = "PATH=VALUE")]
    pub overrides: Vec<String>,
}

impl PlayerArgs {
    /// Name of the default folder of a performance: the song and the options. So another player, or
    /// the same one in another world, has its own folder.
    pub fn folder_name(&self, asked: &str) -> String {
        let mut parts = vec![slug(asked)];
        if self.scripted {
            parts.push("scripted".to_string());
        }
        parts.extend(self.policy.as_deref().map(player_slug));
        for change in &self.overrides {
            let (path, value) = change.split_once('=').unwrap_or((change, ""));
            parts.push(readable(&format!("{} {value}", path.rsplit('.').next().unwrap_or(path))));
        }
        parts.join("-")
    }

    /// The player of `song`, which the user named `asked`; warns if it learned another song.
    pub fn load(
        &self,
        asked: &str,
        song: &Song,
        planner: &mut SongPlanner<'_>,
    ) -> anyhow::Result<LoadedPlayer> {
        let Chosen { mut player, passed_over } = match &self.policy {
            _ if self.scripted => Chosen { player: LoadedPlayer::scripted(), passed_over: None },
            Some(policy) => Chosen { player: load_player(&policy_called(policy)?)?, passed_over: None },
            None => choose_player(asked, &slug(asked), song, planner)?,
        };
        if !self.overrides.is_empty() {
            let changes = player.reconfigure(&self.overrides)?;
            if !changes.is_empty() {
                note(format!(
                    "warning: this policy was trained with other settings; now {}",
                    changes.join(", ")
                ));
            }
        }
        if player.is_sight_reader() {
            if self.policy.is_none() {
                let why = if let Some(own) = &passed_over {
                    let (right, due) = (own.claimed_notes.unwrap_or(0.0), song.notes().len());
                    format!(
                        "has a policy that plays {right} of {due} notes right ({}; use --policy PATH to play it)",
                        own.name()
                    )
                } else if policies(&slug(asked)).is_empty() {
                    "has no policy of its own".to_string()
                } else {
                    format!("is not the song that the policies named `{}` learned", slug(asked))
                };
                note(format!(
                    "`{asked}` {why}: {} plays it zero-shot; `etude train {} --from {SIGHT_READER}` trains a policy for it",
                    player.name(),
                    shell_word(asked)
                ));
            }
            for warning in cannot_be_played(song, &player.config.task, planner)? {
                note(format!(
                    "warning: {warning}; `etude songs show {}` shows the plan, and what is easier to play",
                    shell_word(asked)
                ));
            }
        } else if let Some(learned) = player.song.as_deref().filter(|learned| *learned != song.title()) {
            note(format!(
                "warning: this policy learned `{learned}` and was not trained on `{}`; train one with `etude train {}`",
                song.title(),
                shell_word(asked)
            ));
        } else if let Some(notes) = player.learned_other_notes(song) {
            note(format!(
                "warning: this policy learned another `{}` ({notes} notes, or at other times) and was not trained on this one; train one with \
                 `etude train {}`",
                song.title(),
                shell_word(asked)
            ));
        }
        Ok(player)
    }
}

/// The default folder of what is made of this song. Another song of that name keeps its folder; a
/// note says so.
pub fn folder_of(song: &Song, default: PathBuf) -> PathBuf {
    let folder = folder_of_song(&default, song);
    if folder != default {
        note(format!(
            "{} is of another song of this name: that of this one is {}",
            default.display(),
            folder.display()
        ));
    }
    folder
}

/// A duration: a number above zero, small enough that clocks do not overflow.
pub fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "it is not a number".to_string())?;
    if value > 0.0 && value <= 1e9 {
        Ok(value)
    } else {
        Err("it must be above 0, for example 10".to_string())
    }
}

/// Folder name of a song: of a built-in id, or of a file's name without its extension, which stays
/// if the rest is a built-in id.
pub fn slug(song: &str) -> String {
    if repertoire::get(song).is_some() {
        return song.to_string();
    }
    let path = Path::new(song);
    let name = |part: Option<&OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
    let (stem, file) = (name(path.file_stem()), name(path.file_name()));
    etude_lab::slug(if repertoire::get(&stem).is_some() { &file } else { &stem })
}

#[cfg(test)]
mod tests {
    use super::{positive, slug};

    #[test]
    fn times_are_positive_numbers() {
        assert_eq!(positive("0.5"), Ok(0.5));
        assert!(["-1", "0", "nan", "inf", "1e300", "soon"].iter().all(|text| positive(text).is_err()));
    }

    #[test]
    fn slugs_are_folder_names() {
        assert_eq!(slug("twinkle"), "twinkle");
        assert_eq!(slug("songs/月光.mid"), "月光");
        assert_eq!(slug("./twinkle.mid"), "twinkle.mid");
        assert!(slug("songs/Au Clair_de-la Lune.mid").starts_with("au-clair_de-la-lune-"));
        assert_eq!(slug("../../x.mid"), "x");
    }
}
