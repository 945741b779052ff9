//! Lets the extension find MuJoCo beside it, in the Python package `mujoco` of the same version, so that both share one library.

fn main() {
    println!("cargo::rustc-link-arg=-Wl,-rpath,$ORIGIN/../mujoco");
}
