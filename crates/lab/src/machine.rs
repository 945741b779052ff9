//! This machine: what it is, for tables of measurements.

/// The most memory that this process has held so far, in MiB, if the system reports it (Linux).
pub fn peak_memory_mib() -> Option<f64> {
    let kib = proc_field("/proc/self/status", "VmHWM")?;
    Some(kib.split_whitespace().next()?.parse::<f64>().ok()? / 1024.0)
}

/// Name of the processor, or its architecture where the system does not report it.
pub fn processor() -> String {
    proc_field("/proc/cpuinfo", "model name").unwrap_or_else(|| std::env::consts::ARCH.to_string())
}

/// This machine in one line, for a table of measurements: its processor, cores, memory and load, as
/// far as the system reports them.
pub fn machine() -> String {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let memory = proc_field("/proc/meminfo", "MemTotal")
        .and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok())
        .map_or("unknown memory".to_string(), |kib| format!("{:.0} GiB", kib / (1024.0 * 1024.0)));
    let load = std::fs::read_to_string("/proc/loadavg")
        .ok()
        .and_then(|text| Some(text.split_whitespace().next()?.to_string()))
        .unwrap_or_else(|| "unknown".to_string());
    format!(
        "{}, {cores} cores, {memory}, load {load} at the start; MuJoCo {}, étude {}",
        processor(),
        etude_stage::mujoco_version(),
        env!("CARGO_PKG_VERSION")
    )
}

/// The value of the first line `name: value` of a file of the kernel.
fn proc_field(path: &str, name: &str) -> Option<String> {
    let text = std::fs::read_to_string(path).ok()?;
    let (_, value) =
        text.lines().filter_map(|line| line.split_once(':')).find(|(key, _)| key.trim() == name)?;
    Some(value.trim().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kernel_tells_about_memory_where_it_is_linux() {
        assert_eq!(peak_memory_mib().is_some_and(|mib| mib > 1.0), cfg!(target_os = "linux"));
        assert!(machine().contains("cores"));
    }
}
