//! Where policies are: those that come with Étude, and those of runs.

use std::path::{Path, PathBuf};

use anyhow::Context as _;

use crate::folder::policy_in;

/// Folder of the runs, in the working folder.
pub(crate) const RUNS: &str = "runs";

/// Folders that may hold shipped policies: `policies` in the working folder, beside an installed
/// binary, the source tree.
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

/// The policy called `name`: a policy file, the folder of a run, or the name of a policy that comes
/// with Étude.
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

/// The policies for the song `slug`: those of the runs in `runs/`, then the one that comes with
/// Étude.
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
