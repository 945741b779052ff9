//! A writer of a test.

use super::*;

impl RecordingWriter {
    /// A writer whose disk hangs. The function frees it, and ends when the writer does.
    pub(crate) fn stuck() -> (Self, impl FnOnce() + Send) {
        let (lines, waiting) = sync_channel(1);
        let writer = Self {
            path: PathBuf::new(),
            channels: topics().into_iter().zip(1..).map(|((topic, ..), id)| (topic, id)).collect(),
            sequence: 0,
            begun_secs: 0.0,
            latency_compensation_secs: 0.0,
            flushed_secs: [0.0; 2],
            lines: Some(lines),
            thread: None,
            failed: Arc::default(),
        };
        (writer, move || waiting.iter().for_each(drop))
    }
}
