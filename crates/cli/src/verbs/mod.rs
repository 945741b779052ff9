//! One module a verb.

pub mod bench;
pub mod doctor;
pub mod model;
pub mod play;
pub mod songs;
pub mod train;

use std::path::{Path, PathBuf};

use etude_lab::RunConfig;

/// The layers of configuration that several verbs take.
#[derive(clap::Args)]
pub struct ConfigArgs {
    /// Start from this preset: quick, paper or appendix
    #[arg(long, default_value = "quick", value_name = "NAME")]
    preset: String,
    /// Then take what this TOML file says
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Then set single values, for example --set trainer.seed=3 --set task.stage.fences=false
    #[arg(long = "set", value_name = "PATH=VALUE")]
    overrides: Vec<String>,
}

impl ConfigArgs {
    fn resolve(&self, more: &[String]) -> anyhow::Result<RunConfig> {
        let overrides = [self.overrides.as_slice(), more].concat();
        Ok(etude_lab::resolve(&self.preset, self.config.as_deref(), &overrides)?)
    }
}

/// Folder-friendly name of what the user typed for a song: a built-in id, or a file's name without its ending.
fn slug(song: &str) -> String {
    let stem = if etude_music::repertoire::get(song).is_some() {
        song.to_string()
    } else {
        Path::new(song)
            .file_stem()
            .map_or_else(|| song.to_string(), |stem| stem.to_string_lossy().into_owned())
    };
    let plain: String =
        stem.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' }).collect();
    plain.split('-').filter(|part| !part.is_empty()).collect::<Vec<_>>().join("-")
}

/// Prints one line on standard output; a closed pipe is an error that ends the verb quietly.
fn line(text: impl std::fmt::Display) -> anyhow::Result<()> {
    use std::io::Write as _;
    writeln!(std::io::stdout(), "{text}")?;
    Ok(())
}

fn json(value: &impl serde::Serialize) -> anyhow::Result<()> {
    line(serde_json::to_string_pretty(value)?)
}

#[cfg(test)]
mod tests {
    use super::slug;

    #[test]
    fn slugs_are_folder_names() {
        assert_eq!(slug("twinkle"), "twinkle");
        assert_eq!(slug("songs/Au Clair_de-la Lune.mid"), "au-clair-de-la-lune");
        assert_eq!(slug("../../x.mid"), "x");
    }
}
