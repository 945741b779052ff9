//! Sets the extension's search path to the MuJoCo library in the Python package `mujoco` of the same version, so that both share one library.

fn main() {
    println!("cargo::rustc-link-arg=-Wl,-rpath,$ORIGIN/../mujoco");
}
