//! Programs of other people that do the same work, run by scripts.

use std::path::Path;
use std::process::Command;

use etude_perform::stats::{quantile, sorted};
use serde_json::Value;

/// A peer: a script, its arguments after the seconds, and the JSON lines that it has printed.
pub(super) struct Peer {
    pub script: &'static str,
    pub arguments: Vec<String>,
    pub lines: Vec<Value>,
}

impl Peer {
    pub fn new(script: &'static str, threads: usize) -> Self {
        Self { script, arguments: vec![threads.to_string()], lines: Vec::new() }
    }

    /// Runs the script once and adds the lines that it prints. `tell` is called before it starts.
    pub fn turn(&mut self, folder: &Path, secs: f64, tell: &mut dyn FnMut(&Path)) -> anyhow::Result<()> {
        let script = folder.join(self.script);
        let advice = "run this in the repository, or name the folder with --peers DIR";
        anyhow::ensure!(script.is_file(), "{} is not there: {advice}", script.display());
        tell(&script);
        let output = Command::new("sh").arg(&script).arg(secs.to_string()).args(&self.arguments).output()?;
        let said = String::from_utf8_lossy(&output.stderr);
        let reason = said.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("it does not say why");
        anyhow::ensure!(output.status.success(), "{}", reason.trim());
        let text = String::from_utf8_lossy(&output.stdout);
        let before = self.lines.len();
        self.lines.extend(text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok()));
        anyhow::ensure!(self.lines.len() > before, "it has printed no figures");
        Ok(())
    }
}

/// The medians of `field` in the lines of `peers`, one for each name in `peer`.
pub(super) fn medians(peers: &[Peer], field: &str) -> Vec<(String, f64)> {
    let mut found: Vec<(String, Vec<f64>)> = Vec::new();
    for line in peers.iter().flat_map(|peer| &peer.lines) {
        let (Some(name), Some(value)) = (line["peer"].as_str(), line[field].as_f64()) else { continue };
        match found.iter_mut().find(|(known, _)| known == name) {
            Some((_, values)) => values.push(value),
            None => found.push((name.to_string(), vec![value])),
        }
    }
    found.into_iter().map(|(name, values)| (name, median(values))).collect()
}

pub(super) fn median(values: Vec<f64>) -> f64 {
    quantile(&sorted(values), 0.5)
}
