//! Processes that a test ends: found by their parent or by their arguments, ended by their id.

use std::path::Path;
use std::process::Command;

/// Ids of all processes.
fn all() -> impl Iterator<Item = u32> {
    let entries = std::fs::read_dir("/proc").unwrap().flatten();
    entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok())
}

/// A field of the status of a process, counted as in `man proc_pid_stat`: `ID (NAME) STATE PARENT
/// …`.
fn status(id: u32, field: usize) -> Option<i64> {
    let text = std::fs::read_to_string(Path::new("/proc").join(id.to_string()).join("stat")).ok()?;
    text.rsplit_once(')')?.1.split_whitespace().nth(field - 3)?.parse().ok()
}

/// Ids of the processes that the process `parent` has started.
pub fn children_of(parent: u32) -> Vec<u32> {
    all().filter(|id| status(*id, 4) == Some(i64::from(parent))).collect()
}

/// Real-time priority of the main thread of a process, 0 if it has none.
pub fn real_time_priority(id: u32) -> i64 {
    status(id, 40).expect("it runs")
}

/// Whether a process runs; one that has ended and is not waited for does not.
pub fn runs(id: u32) -> bool {
    let text = std::fs::read_to_string(Path::new("/proc").join(id.to_string()).join("stat"));
    text.is_ok_and(|text| text.rsplit_once(')').is_some_and(|(_, rest)| !rest.trim_start().starts_with('Z')))
}

/// Time for which a process has had a processor, s.
pub fn processor_secs(id: u32) -> f64 {
    /// Of the kernel's clock, for programs.
    const TICKS_PER_SEC: f64 = 100.0;
    let ticks = |field| status(id, field).unwrap_or(0) as f64;
    (ticks(14) + ticks(15)) / TICKS_PER_SEC
}

/// Ids of the processes that were started with these arguments in a row.
pub fn with_arguments(arguments: &[&str]) -> Vec<u32> {
    let has_them = |id: &u32| {
        let text = std::fs::read(Path::new("/proc").join(id.to_string()).join("cmdline")).unwrap_or_default();
        let theirs: Vec<&[u8]> = text.split(|byte| *byte == 0).collect();
        theirs
            .windows(arguments.len())
            .any(|row| row.iter().zip(arguments).all(|(one, other)| *one == other.as_bytes()))
    };
    all().filter(has_them).collect()
}

/// Numbers of signals.
pub const HUP: u32 = 1;
pub const INT: u32 = 2;

/// Whether a process handles this signal by itself.
pub fn catches(id: u32, signal: u32) -> bool {
    let text =
        std::fs::read_to_string(Path::new("/proc").join(id.to_string()).join("status")).unwrap_or_default();
    let caught = text.lines().find_map(|line| line.strip_prefix("SigCgt:"));
    caught.is_some_and(|mask| u64::from_str_radix(mask.trim(), 16).unwrap() >> (signal - 1) & 1 == 1)
}

/// Sends a signal, such as `KILL`, to a process.
pub fn signal(id: u32, name: &str) {
    signal_all(&[id], name);
}

/// The same to several, one right after the other.
pub fn signal_all(ids: &[u32], name: &str) {
    let ids: Vec<String> = ids.iter().map(u32::to_string).collect();
    let sent = Command::new("kill").arg(format!("-{name}")).args(&ids).status().unwrap();
    assert!(sent.success(), "{name} to {ids:?}");
}
