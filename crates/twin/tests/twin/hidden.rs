//! Nobody but the twin knows its parameters: that `TwinParams` has no readable fields is shown
//! beside it (`src/params.rs`), here that nobody goes around it.

use std::fs;
use std::path::{Path, PathBuf};

/// Crates that may hand a parameter set to a twin, or tell one parameter set from another, which is
/// all that they can do with one.
const MAY_USE_A_TWIN: [&str; 3] = ["cli", "experiment", "perform"];

fn crates() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).filter(|path| path.is_dir()).collect()
}

/// Everything of Rust under `folder`.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).into_iter().flatten() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

#[test]
fn only_crates_that_set_up_a_twin_depend_on_it() {
    let mut users = Vec::new();
    for path in crates() {
        let name = path.file_name().unwrap().to_str().unwrap().to_string();
        let manifest = fs::read_to_string(path.join("Cargo.toml")).unwrap_or_default();
        // A crate's tests may play on a twin.
        let needed = manifest.split("[dev-dependencies]").next().unwrap();
        if name != "twin" && needed.contains("etude-twin") {
            users.push(name);
        }
    }
    users.sort();
    assert_eq!(users, MAY_USE_A_TWIN);
}

/// A file of twin parameters, and what a twin's devices were told of it, are not looked at by those
/// who have a twin.
#[test]
fn nobody_else_reads_twin_parameters() {
    let mut found = Vec::new();
    for path in crates().into_iter().filter(|path| !path.ends_with("twin")) {
        sources(&path.join("src"), &mut found);
    }
    assert!(found.len() > 100, "{}", found.len());
    for path in found.into_iter().filter(|path| !path.ends_with("tests.rs")) {
        let text = fs::read_to_string(&path).unwrap();
        // A test may edit a copy of a parameter set.
        let text = text.split("#[cfg(test)]").next().unwrap();
        assert!(!text.contains("twin-params/"), "{} knows where twin parameters lie", path.display());
        if text.contains("etude_twin") {
            for word in ["config_mut", ".twin."] {
                assert!(!text.contains(word), "{} looks into a twin: {word}", path.display());
            }
        }
    }
}

/// What is kept of a song that was played on a twin: its parameter set's name, and no more.
#[test]
fn what_is_kept_has_the_name_of_the_parameter_set_alone() {
    let mut found = Vec::new();
    for name in MAY_USE_A_TWIN.into_iter().chain(["lab"]) {
        sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(name).join("src"), &mut found);
    }
    // Tests of experiments name parameter sets as they like.
    found.retain(|path| !path.ends_with("tests.rs"));
    let uses: Vec<String> = found
        .iter()
        .flat_map(|path| fs::read_to_string(path).unwrap().lines().map(str::to_string).collect::<Vec<_>>())
        .filter(|line| line.contains("twin_params."))
        .filter(|line| !line.trim_start().starts_with("//"))
        .collect();
    assert!(!uses.is_empty());
    for line in uses {
        let allowed = [
            "twin_params.name()",
            "twin_params.with_seed_added(",
            "twin_params.with_faults(",
            "twin_params.fingerprint()",
            // Whether the hand has a weight, and no more.
            "twin_params.rig()",
            // Names of parameter sets, under the same name: a set itself has none of these.
            "config.twin_params.as_deref()",
            "twin_params.to_string()",
            "perform.twin_params.iter()",
            "rehearse.twin_params.iter()",
            "twin_params.is_empty()",
            "variant.twin_params.clone()",
        ];
        assert!(allowed.iter().any(|call| line.contains(call)), "{line}");
    }
}
