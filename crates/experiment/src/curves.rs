//! Curves: the evaluations of a training, or the points of a fit.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use etude_identify::Progress;
use etude_perform::write_file;

use crate::outcome::{Values, file_error};

/// The evaluations in a run's metrics: `step` and scores of each, and the seconds until then.
pub(crate) fn evaluations(path: &Path) -> anyhow::Result<(Vec<Values>, Vec<f64>)> {
    let text = std::fs::read_to_string(path).map_err(|error| file_error(path, &error))?;
    let (mut points, mut secs, mut elapsed) = (Vec::new(), Vec::new(), 0.0);
    for line in text.lines() {
        let Ok(row) = serde_json::from_str::<Values>(line) else { continue };
        elapsed = row.get("perf/elapsed_secs").copied().unwrap_or(elapsed);
        let scores =
            row.iter().filter_map(|(key, value)| Some((key.strip_prefix("eval/")?.to_string(), *value)));
        let mut point: Values = scores.collect();
        if point.is_empty() {
            continue;
        }
        point.insert("step".to_string(), row.get("step").copied().unwrap_or(0.0));
        points.push(point);
        secs.push(elapsed);
    }
    Ok((points, secs))
}

/// The curve of a fit, stored while it runs. A resumed fit repeats its last evaluations exactly; a
/// point that is stored already is not added again.
pub(crate) struct FitCurve {
    path: PathBuf,
    /// Of each point the pass, its replays, and the residuals.
    stored: Vec<(String, u64, f64)>,
}

impl FitCurve {
    pub fn open(path: &Path) -> anyhow::Result<Self> {
        let stored = match std::fs::read(path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Vec::new(),
            read => serde_json::from_slice(&read.map_err(|error| file_error(path, &error))?)?,
        };
        Ok(Self { path: path.to_path_buf(), stored })
    }

    pub fn add(&mut self, at: &Progress) -> anyhow::Result<()> {
        let point = (at.pass.name().to_string(), at.replays, at.rms);
        if at.rms.is_finite() && !self.stored.contains(&point) {
            self.stored.push(point);
            write_file(&self.path, &serde_json::to_string(&self.stored)?)?;
        }
        Ok(())
    }

    /// The points: each pass counts its replays from 0, the curve counts all.
    pub fn points(&self) -> Vec<Values> {
        let (mut before, mut last) = (0, ("", 0));
        let mut points = Vec::new();
        for (pass, replays, rms) in &self.stored {
            if last.0 != pass || last.1 > *replays {
                before += last.1;
            }
            last = (pass, *replays);
            let replays = ("replays".to_string(), (before + replays) as f64);
            points.push(BTreeMap::from([replays, ("rms".to_string(), *rms)]));
        }
        points
    }
}
