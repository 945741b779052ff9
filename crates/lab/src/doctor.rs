//! What this machine has and lacks, for `etude doctor`.

use std::path::{Path, PathBuf};

use etude_robot::priority::{Priority, Rank};
use serde::Serialize;

use crate::policy_files::shipped_policy;

/// Something that this machine has or lacks.
#[derive(Clone, Debug, Serialize)]
pub struct Finding {
    /// Its name.
    pub name: &'static str,
    /// Whether it is there.
    pub ok: bool,
    /// What was found, or where it was looked for.
    pub found: String,
    /// What its absence costs; empty if it is there.
    pub cost: &'static str,
}

/// Looks for everything that Étude can use.
pub fn examine() -> Vec<Finding> {
    let always = |name, found| Finding { name, ok: true, found, cost: "" };
    let optional = |name, found: Option<String>, absent: &str, cost| match found {
        Some(found) => Finding { name, ok: true, found, cost: "" },
        None => Finding { name, ok: false, found: absent.to_string(), cost },
    };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    vec![
        always("étude", format!("{} for {}", env!("CARGO_PKG_VERSION"), std::env::consts::ARCH)),
        always("mujoco", format!("{} from {}", etude_stage::mujoco_version(), loaded_library())),
        always("arms", format!("tried with firmware {}, emulated", etude_robot::xarm::tried_firmware())),
        always("cores", format!("{cores}, using {}", cpu_features())),
        optional(
            "gl",
            library("libEGL.so.1"),
            "no libEGL",
            "no pictures or video of the simulation; training, playing and sound need none \
             (Debian, Ubuntu: apt-get install -y libegl1 libgl1-mesa-dri)",
        ),
        optional(
            "ffmpeg",
            program("ffmpeg"),
            "not on the PATH",
            "no MP4 video; pictures still work (Debian, Ubuntu: apt-get install -y ffmpeg)",
        ),
        optional(
            "midi",
            Path::new("/dev/snd/seq").exists().then(|| "/dev/snd/seq".to_string()),
            "no ALSA sequencer at /dev/snd/seq",
            "no MIDI keyboard can be connected; simulation needs none (try: modprobe snd-seq)",
        ),
        optional(
            "can",
            can_interface(),
            "no CAN interface in /sys/class/net",
            "no Allegro hand can be connected; simulation needs none (try: modprobe peak_usb or gs_usb)",
        ),
        optional(
            "real time",
            real_time(),
            "not permitted to this user",
            "a robot is safe but may stop on a busy machine; simulation and twin need none (in /etc/security/limits.conf: \
             `USER - rtprio 60` and `USER - memlock unlimited`, then log in again)",
        ),
        optional(
            "python",
            program("python3"),
            "not on the PATH",
            "only `make setup` and the checks against other libraries need it",
        ),
        optional(
            "policies",
            policies(),
            "not here, not beside the program, not in the source tree",
            "`etude play` needs a run of the song under runs/, or --policy",
        ),
    ]
}

/// What a thread that controls a robot is given.
fn real_time() -> Option<String> {
    let memory = if Priority::of_this_thread(Rank::Guard).ok()?.locks_memory() {
        "locked"
    } else {
        "not locked (limit memlock)"
    };
    Some(format!("priority {} for the robot's controller, memory {memory}", Rank::Controller as i32))
}

/// Where the policies are that come with Étude, as `etude play` looks for them.
fn policies() -> Option<String> {
    let id = etude_music::repertoire::ids().next()?;
    shipped_policy(id)?.parent().map(|folder| folder.display().to_string())
}

/// Where the MuJoCo library in this process was loaded from, as the kernel reports.
fn loaded_library() -> String {
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap_or_default();
    let path = maps.split_whitespace().find(|word| word.contains("libmujoco"));
    path.unwrap_or("an unknown place").to_string()
}

#[cfg(target_arch = "x86_64")]
fn cpu_features() -> String {
    let known = [
        ("avx2", std::arch::is_x86_feature_detected!("avx2")),
        ("fma", std::arch::is_x86_feature_detected!("fma")),
        ("avx512f", std::arch::is_x86_feature_detected!("avx512f")),
        ("avx512bf16", std::arch::is_x86_feature_detected!("avx512bf16")),
    ];
    let found: Vec<&str> = known.iter().filter(|(_, there)| *there).map(|(name, _)| *name).collect();
    if found.is_empty() { "baseline x86-64 only: learning will be slow".to_string() } else { found.join(" ") }
}

#[cfg(not(target_arch = "x86_64"))]
fn cpu_features() -> String {
    "the baseline of this architecture".to_string()
}

fn program(name: &str) -> Option<String> {
    find(std::env::split_paths(&std::env::var_os("PATH")?), name)
}

fn library(name: &str) -> Option<String> {
    let ours = format!("/usr/lib/{}-linux-gnu", std::env::consts::ARCH);
    find([&ours, "/usr/lib64", "/usr/lib", "/lib"].map(PathBuf::from).into_iter(), name)
}

/// The path of the first file with this name in `folders`.
fn find(mut folders: impl Iterator<Item = PathBuf>, name: &str) -> Option<String> {
    let found = folders.find(|folder| folder.join(name).is_file())?;
    Some(found.join(name).display().to_string())
}

fn can_interface() -> Option<String> {
    let mut names: Vec<String> = std::fs::read_dir("/sys/class/net")
        .ok()?
        .flatten()
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .filter(|name| name.starts_with("can") || name.starts_with("vcan") || name.starts_with("slcan"))
        .collect();
    names.sort();
    (!names.is_empty()).then(|| names.join(" "))
}
