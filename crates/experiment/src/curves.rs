//! Curves: the evaluations of a training, or the points of a fit.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::Write as _;
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
    file: File,
    path: PathBuf,
    seen: Vec<(String, u64, f64)>,
    /// Replays of the passes that are over.
    before: u64,
    pub points: Vec<Values>,
}

impl FitCurve {
    pub fn open(path: &Path) -> anyhow::Result<Self> {
        let text = match std::fs::read_to_string(path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
            read => read.map_err(|error| file_error(path, &error))?,
        };
        // The last line may be incomplete: only complete lines are kept.
        let whole: Vec<_> = text.lines().map_while(|line| serde_json::from_str(line).ok()).collect();
        let lines: String = text.lines().take(whole.len()).map(|line| line.to_string() + "\n").collect();
        write_file(path, &lines)?;
        let file = OpenOptions::new().append(true).open(path).map_err(|error| file_error(path, &error))?;
        let path = path.to_path_buf();
        let mut curve = Self { file, path, seen: Vec::new(), before: 0, points: Vec::new() };
        whole.into_iter().for_each(|point| curve.take(point));
        Ok(curve)
    }

    pub fn add(&mut self, at: &Progress) -> anyhow::Result<()> {
        let point = (at.pass.name().to_string(), at.replays, at.rms);
        if !at.rms.is_finite() || self.seen.contains(&point) {
            return Ok(());
        }
        let text = serde_json::to_string(&point)? + "\n";
        self.take(point);
        self.file.write_all(text.as_bytes()).map_err(|error| file_error(&self.path, &error))
    }

    /// Each pass counts its replays from 0; the curve counts all.
    fn take(&mut self, point: (String, u64, f64)) {
        if let Some((pass, replays, _)) = self.seen.last()
            && (*pass != point.0 || *replays > point.1)
        {
            self.before += replays;
        }
        let replays = ("replays".to_string(), (self.before + point.1) as f64);
        self.points.push(BTreeMap::from([replays, ("rms".to_string(), point.2)]));
        self.seen.push(point);
    }
}
