//! One module a verb.

pub mod bench;
pub mod compare;
pub mod completions;
pub mod doctor;
pub mod evaluate;
pub mod experiment;
pub mod export;
pub mod gallery;
pub mod identify;
pub mod man;
pub mod model;
pub mod perform;
pub mod play;
pub mod record;
pub mod rehearse;
pub mod render;
pub mod replay;
pub mod robot;
pub mod serve;
pub mod songs;
pub mod train;
pub mod twin;
pub mod watch;
<<<<<<< HEAD
=======

use std::ffi::OsStr;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::builder::{PossibleValue, PossibleValuesParser, StringValueParser, TypedValueParser};
use etude_lab::{
    Chosen, Kept, Pianist, RunConfig, SIGHT_READER, cannot_be_played, load_pianist, pianist_for, player_slug,
    policies, policy_called,
};
use etude_music::Song;
use etude_perform::shell_word;

use crate::status::while_planning;

/// Text that is one of these names or the path of a file: any text is taken, and a shell can complete the names.
#[derive(Clone)]
pub struct NameOrPath(fn() -> Vec<&'static str>);

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

fn song() -> NameOrPath {
    NameOrPath(|| etude_music::repertoire::ids().collect())
}

fn twin_params() -> NameOrPath {
    NameOrPath(|| etude_twin::TwinParams::names().into_iter().chain(["random:"]).collect())
}

/// The layers of configuration that several verbs take.
#[derive(clap::Args)]
pub struct ConfigArgs {
    /// Start from this preset: fast (a song in minutes), expressive (soft and loud as written, in more steps), quick
    /// (without a fingering), paper (as published), appendix (the paper's variant), appendix-fast (that, with a fingering)
    /// or sight-reader (for pieces that it has not seen)
    #[arg(long, default_value = etude_lab::DEFAULT_PRESET, value_name = "NAME", value_parser = PossibleValuesParser::new(etude_lab::presets()), hide_possible_values = true)]
    preset: String,
    /// Then take what this TOML file says
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Then set single values, for example --set trainer.seed=3 --set task.stage.fences=false
    #[arg(long = "set", value_name = "PATH=VALUE")]
    overrides: Vec<String>,
}

impl ConfigArgs {
    fn resolve(&self) -> anyhow::Result<RunConfig> {
        etude_lab::resolve(&self.preset, self.config.as_deref(), &self.overrides)
    }
}

/// The player, as several verbs take it.
#[derive(clap::Args)]
pub struct PianistArgs {
    /// A policy file, the folder of a run, or the name of a policy that comes with Étude, for example sight-reader; if not given the best
    /// for this song or, without one, the sight-reader
    #[arg(long, value_name = "PATH")]
    policy: Option<PathBuf>,
    /// Play by inverse kinematics and timing instead of a policy: the baseline that needs no training
    #[arg(long, conflicts_with = "policy")]
    scripted: bool,
    /// Change the world that is simulated, for example --set task.physics.key.threshold=0.7
    #[arg(long = "set", value_name = "PATH=VALUE")]
    overrides: Vec<String>,
}

impl PianistArgs {
    /// Name of the folder of what is played, if none is given: the song, and what was asked for beside it. So nobody replaces the files
    /// of another player, or of the same one in another world.
    fn folder_name(&self, asked: &str) -> String {
        let mut name = slug(asked);
        let mut add = |part: &str| name = format!("{name}-{}", etude_lab::slug(part));
        if self.scripted {
            add("scripted");
        }
        if let Some(policy) = &self.policy {
            add(&player_slug(policy));
        }
        for change in &self.overrides {
            let (path, value) = change.split_once('=').unwrap_or((change, ""));
            add(&format!("{}-{value}", path.rsplit('.').next().unwrap_or(path)));
        }
        name
    }

    /// The player of `song`, which was asked for as `asked`; says so if it learned another one. `quiet` hides the progress of a long
    /// planning.
    fn load(&self, asked: &str, song: &Song, quiet: bool) -> anyhow::Result<Pianist> {
        let mut passed_over = None;
        let mut pianist = if self.scripted {
            Pianist::scripted()
        } else {
            match &self.policy {
                Some(policy) => load_pianist(&policy_called(policy)?)?,
                None => {
                    let Chosen { pianist, passed_over: over } = pianist_for(asked, &slug(asked), song)?;
                    passed_over = over;
                    pianist
                }
            }
        };
        if !self.overrides.is_empty() {
            let changes = pianist.reconfigure(&self.overrides)?;
            if !changes.is_empty() {
                note(format!(
                    "warning: this policy was trained with other settings; now {}",
                    changes.join(", ")
                ));
            }
        }
        if pianist.reads_at_sight() {
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
                    format!("is not the piece that the policies called `{}` learned", slug(asked))
                };
                note(format!(
                    "`{asked}` {why}: {} plays it at sight; `etude train {} --from {SIGHT_READER}` trains a policy for it",
                    pianist.name(),
                    shell_word(asked)
                ));
            }
            for warning in while_planning(quiet, || cannot_be_played(song, &pianist.config.task))? {
                note(format!(
                    "warning: {warning}; `etude songs show {}` shows the plan, and what is easier to play",
                    shell_word(asked)
                ));
            }
        } else if let Some(learned) = pianist.song.as_deref().filter(|learned| *learned != song.title()) {
            note(format!(
                "warning: this policy learned `{learned}` and was not trained on `{}`; train one with `etude train {}`",
                song.title(),
                shell_word(asked)
            ));
        } else if let Some(notes) = pianist.learned_other_notes(song) {
            note(format!(
                "warning: this policy learned another `{}` ({notes} notes, or at other times) and was not trained on this one; train one with \
                 `etude train {}`",
                song.title(),
                shell_word(asked)
            ));
        }
        Ok(pianist)
    }
}

/// A length of time on the command line: a number above zero, and not so large that clocks overflow.
fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "it is not a number".to_string())?;
    if value > 0.0 && value <= 1e9 {
        Ok(value)
    } else {
        Err("it must be above 0, for example 10".to_string())
    }
}

/// Folder-friendly name of what the user typed for a song: a built-in id, or a file's name without its ending.
fn slug(song: &str) -> String {
    let stem = Path::new(song).file_stem().filter(|_| etude_music::repertoire::get(song).is_none());
    etude_lab::slug(&stem.map_or_else(|| song.into(), |stem| stem.to_string_lossy()))
}

/// The file `out`, whose folder is made; refused if it has not the `ending` of what is written.
fn file_to_write(out: PathBuf, ending: &str, hint: &str) -> anyhow::Result<PathBuf> {
    if out.extension().is_none_or(|given| given != ending) {
        anyhow::bail!("cannot write {}: {hint}", out.display());
    }
    if let Some(folder) = out.parent() {
        etude_lab::make_folder(folder)?;
    }
    Ok(out)
}

/// Refuses to replace a file that this command has not written: one without this `mark` in its first bytes.
fn replaces_its_own(out: &Path, mark: &str) -> anyhow::Result<()> {
    let unreadable = || format!("cannot see whether {} may be replaced", out.display());
    let mut first = Vec::new();
    match out.metadata() {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(error).with_context(unreadable),
        // A device or a pipe has no content to lose.
        Ok(there) if !there.is_file() => return Ok(()),
        Ok(_) => {
            let file = std::fs::File::open(out).with_context(unreadable)?;
            file.take(4096).read_to_end(&mut first).with_context(unreadable)?;
        }
    }
    if !first.is_empty() && !first.windows(mark.len()).any(|bytes| bytes == mark.as_bytes()) {
        anyhow::bail!(
            "{} exists, and this command has not written it: choose another name, or remove the file",
            out.display()
        );
    }
    Ok(())
}

/// Says where a performance is that a new one in `folder` has not replaced.
fn kept(kept: Option<&Kept>, folder: &Path) {
    if let Some(Kept { song, player, folder: now }) = kept {
        note(format!(
            "the earlier performance of {song} by {player} was moved from {} to {}",
            folder.display(),
            now.display()
        ));
    }
}

/// Prints one line on standard output; a closed pipe is an error that ends the verb quietly.
fn line(text: impl std::fmt::Display) -> anyhow::Result<()> {
    use std::io::Write as _;
    writeln!(std::io::stdout(), "{text}")?;
    Ok(())
}

/// Prints one line on standard error; if it is closed, the work continues.
pub fn note(text: impl std::fmt::Display) {
    use std::io::Write as _;
    let _ = writeln!(std::io::stderr(), "{text}");
}

fn json(value: &impl serde::Serialize) -> anyhow::Result<()> {
    line(serde_json::to_string_pretty(value)?)
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
        assert_eq!(slug("songs/Au Clair_de-la Lune.mid"), "au-clair-de-la-lune");
        assert_eq!(slug("../../x.mid"), "x");
    }
}
>>>>>>> f7edce8 (robot, emulators, twin: the field's names, Robot in parts, tests with their crate, no circles)
