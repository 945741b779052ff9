//! Finds MuJoCo where `make setup` puts it, and passes the folder to dependent crates, which set
//! their run-time search path from it.

use std::path::Path;

const LIBRARY: &str = "libmujoco.so.3.17.0";

fn main() {
    let manifest = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    let folder = Path::new(&manifest).join("../../.mujoco/lib");
    println!("cargo::rerun-if-changed={}", folder.join(LIBRARY).display());
    let Ok(folder) = folder.canonicalize().and_then(|f| f.join(LIBRARY).metadata().map(|_| f)) else {
        println!("cargo::error=MuJoCo is not in .mujoco/: run `make setup` once, then build again");
        return;
    };
    let folder = folder.display();
    println!("cargo::rustc-link-search=native={folder}");
    println!("cargo::metadata=libdir={folder}");
    println!("cargo::rustc-link-arg=-Wl,-rpath,{folder}");
}
