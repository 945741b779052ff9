//! Lets this crate's executables find MuJoCo at run time: beside an installed binary, else where
//! `make setup` put it; and lists the files of `configs/experiments`, so that an experiment is
//! added by adding its file.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

fn main() -> std::io::Result<()> {
    println!("cargo::rustc-link-arg=-Wl,-rpath,$ORIGIN/../lib");
    if let Ok(folder) = std::env::var("DEP_ETUDE_MUJOCO_LIBDIR") {
        println!("cargo::rustc-link-arg=-Wl,-rpath,{folder}");
    }
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/experiments").canonicalize()?;
    println!("cargo::rerun-if-changed={}", folder.display());
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(&folder)?.map(|entry| Ok(entry?.path())).collect::<std::io::Result<_>>()?;
    files.retain(|path| path.extension().is_some_and(|ending| ending == "toml"));
    files.sort();
    let mut text = String::from("const EXPERIMENTS: &[(&str, &str)] = &[\n");
    for path in files {
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        // Writing to a string cannot fail.
        let _ = writeln!(text, "    ({name:?}, include_str!({:?})),", path.display().to_string());
    }
    text += "];\n";
    std::fs::write(
        PathBuf::from(std::env::var_os("OUT_DIR").unwrap_or_default()).join("experiments.rs"),
        text,
    )
}
