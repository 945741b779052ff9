//! Lets this crate's tests, which play on the twin, find MuJoCo where `make setup` put it. The
//! crate itself does not link it.

fn main() {
    let manifest = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    println!("cargo::rustc-link-arg-tests=-Wl,-rpath,{manifest}/../../.mujoco/lib");
    println!("cargo::rerun-if-changed=build.rs");
}
