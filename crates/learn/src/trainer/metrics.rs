//! Metrics in two files: `metrics.jsonl`, one flat JSON object a line, and the same as TensorBoard
//! events.

use std::{
    fs::{self, File, OpenOptions},
    io::{Seek, SeekFrom, Write},
    path::{Path, PathBuf},
    time::{SystemTime, UNIX_EPOCH},
};

use crate::{files::FileError, tensorboard::EventFile};

const METRICS: &str = "metrics.jsonl";
const EVENTS: &str = "events.out.tfevents.etude";
/// The value from which a resumed training continues its elapsed time.
pub(crate) const ELAPSED: &str = "perf/elapsed_secs";

/// Lengths of the files at a checkpoint. Both numbers are the same in every run of one training
/// although the rows hold times: lines are counted instead of bytes, and event records with the
/// same names have the same length.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Mark {
    pub rows: u64,
    pub event_bytes: u64,
}

/// Both files, open for appending.
pub(crate) struct Metrics {
    path: PathBuf,
    file: File,
    /// Bytes of the rows that stay when the file is cut back.
    kept: u64,
    rows: u64,
    events: EventFile,
}

impl Metrics {
    /// Opens the files in `folder` to append after `mark`. They are not changed before
    /// [`cut_back`](Self::cut_back). Also returns the elapsed seconds in the last kept row, or 0.
    pub(crate) fn open(folder: &Path, mark: Mark) -> Result<(Self, f64), FileError> {
        let path = folder.join(METRICS);
        let io = |error| FileError::io("write", &path)(error);
        let text = match fs::read(&path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Vec::new(),
            Err(error) => return Err(FileError::io("read", &path)(error)),
        };
        let kept: Vec<&[u8]> = (text.split_inclusive(|&byte| byte == b'\n'))
            .filter(|line| line.ends_with(b"\n"))
            .take(usize::try_from(mark.rows).unwrap_or(usize::MAX))
            .collect();
        let elapsed = (kept.iter().rev())
            .filter_map(|line| serde_json::from_slice::<serde_json::Value>(line).ok()?.get(ELAPSED)?.as_f64())
            .next();
        let file = OpenOptions::new().create(true).truncate(false).write(true).open(&path).map_err(io)?;
        let events = EventFile::open(&folder.join(EVENTS), mark.event_bytes)?;
        let (rows, kept) = (kept.len() as u64, kept.iter().map(|line| line.len() as u64).sum());
        Ok((Self { path, file, kept, rows, events }, elapsed.unwrap_or(0.0)))
    }

    /// Removes the rows after the mark, when it is certain that they will be written again.
    pub(crate) fn cut_back(&mut self) -> Result<(), FileError> {
        let io = |error| FileError::io("write", &self.path)(error);
        self.file.set_len(self.kept).map_err(io)?;
        self.file.seek(SeekFrom::Start(self.kept)).map_err(io)?;
        self.events.cut_back(wall_time())
    }

    /// Appends one row to both files.
    pub(crate) fn write(&mut self, step: u64, values: &[(String, f64)]) -> Result<(), FileError> {
        let mut line = format!("{{\"step\":{step}");
        for (name, value) in values {
            // This escapes the name; a value that is not finite becomes null, as JSON cannot
            // express it.
            let (name, value) = (serde_json::json!(name), serde_json::json!(value));
            line.push_str(&format!(",{name}:{value}"));
        }
        line.push_str("}\n");
        self.file.write_all(line.as_bytes()).map_err(FileError::io("write", &self.path))?;
        self.rows += 1;
        self.events.scalars(wall_time(), step, values)
    }

    /// Syncs all rows to the disk and returns the lengths of the files.
    pub(crate) fn mark(&self) -> Result<Mark, FileError> {
        self.file.sync_data().map_err(FileError::io("sync", &self.path))?;
        self.events.sync()?;
        Ok(Mark { rows: self.rows, event_bytes: self.events.len() })
    }
}

/// Seconds since 1970. Goes into TensorBoard's records only.
fn wall_time() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |elapsed| elapsed.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_cut_back_to_the_mark_and_half_lines_dropped() {
        let folder = tempfile::tempdir().unwrap();
        let row = |value| vec![("losses/critic".to_owned(), value), (ELAPSED.to_owned(), value * 10.0)];
        let (mut metrics, elapsed) = Metrics::open(folder.path(), Mark::default()).unwrap();
        assert_eq!(elapsed, 0.0);
        metrics.cut_back().unwrap();
        metrics.write(100, &row(1.0)).unwrap();
        let mark = metrics.mark().unwrap();
        metrics.write(200, &row(f64::NAN)).unwrap();
        metrics.file.write_all(b"{\"half").unwrap();
        drop(metrics);
        let (mut metrics, elapsed) = Metrics::open(folder.path(), mark).unwrap();
        assert_eq!(elapsed, 10.0);
        assert!(fs::read_to_string(folder.path().join(METRICS)).unwrap().ends_with("{\"half"));
        metrics.cut_back().unwrap();
        assert_eq!(metrics.mark().unwrap(), mark);
        metrics.write(300, &row(3.5)).unwrap();
        let text = fs::read_to_string(folder.path().join(METRICS)).unwrap();
        let expected = "{\"step\":100,\"losses/critic\":1.0,\"perf/elapsed_secs\":10.0}\n\
                        {\"step\":300,\"losses/critic\":3.5,\"perf/elapsed_secs\":35.0}\n";
        assert_eq!(text, expected);
    }
}
