//! Sets the extension's search path to the MuJoCo library of the Python package `mujoco`, in the
//! same version, so that both share it.

fn main() {
    println!("cargo::rustc-link-arg=-Wl,-rpath,$ORIGIN/../mujoco");
}
