//! Writing a recording: messages become JSON on the calling thread, and a separate thread writes the file, so that a slow disk
//! does not delay a robot.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, OnceLock};
use std::thread::JoinHandle;

use mcap::records::MessageHeader;

use crate::messages::{Header, Message, topics};
use crate::recording::{RecordingError, SCHEMA};

/// Time between two flushes of the file to the operating system, s.
const FLUSH_SECS: f64 = 1.0;
/// Most messages that wait for the disk, about two minutes of a robot. When the queue is full, [`RecordingWriter::write`] blocks.
const WAITING: usize = 65_536;

type McapFile = mcap::Writer<BufWriter<File>>;

/// One message on its way to the file.
struct Line {
    header: MessageHeader,
    text: Vec<u8>,
    flush: bool,
}

/// Writes a recording front to back.
pub struct RecordingWriter {
    path: PathBuf,
    channels: Vec<(&'static str, u16)>,
    sequence: u32,
    flushed_secs: f64,
    /// `None` once the file is complete.
    lines: Option<SyncSender<Line>>,
    thread: Option<JoinHandle<()>>,
    failed: Arc<OnceLock<String>>,
}

impl RecordingWriter {
    /// Creates the file and writes its header.
    ///
    /// # Errors
    /// If the file cannot be created or written.
    pub fn create(path: &Path, header: &Header) -> Result<Self, RecordingError> {
        let file =
            File::create(path).map_err(|source| RecordingError::Open { path: path.to_path_buf(), source })?;
        let fail = |message: String| RecordingError::Write { path: path.to_path_buf(), message };
        let options = mcap::WriteOptions::new()
            .compression(None)
            .profile("")
            .library(concat!("etude ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(64 * 1024));
        let open = || -> mcap::McapResult<(McapFile, Vec<(&'static str, u16)>)> {
            let mut writer = options.create(BufWriter::new(file))?;
            let mut channels = Vec::new();
            for (topic, name, schema) in topics() {
                let schema =
                    writer.add_schema(name, "jsonschema", schema.to_value().to_string().as_bytes())?;
                channels.push((topic, writer.add_channel(schema, topic, "json", &BTreeMap::new())?));
            }
            Ok((writer, channels))
        };
        let (writer, channels) = open().map_err(|error| fail(cause(&error)))?;
        let failed = Arc::new(OnceLock::new());
        let (lines, waiting) = sync_channel(WAITING);
        let told = Arc::clone(&failed);
        let thread = std::thread::Builder::new()
            .name("recording".to_string())
            .spawn(move || {
                if let Err(error) = write_lines(writer, &waiting) {
                    // Only this thread sets it while it runs.
                    let _ = told.set(cause(&error));
                }
            })
            .map_err(|error| fail(error.to_string()))?;
        let mut recording = Self {
            path: path.to_path_buf(),
            channels,
            sequence: 0,
            flushed_secs: 0.0,
            lines: Some(lines),
            thread: Some(thread),
            failed,
        };
        recording.write(0.0, &Header { schema: SCHEMA, ..header.clone() })?;
        Ok(recording)
    }

    /// Messages written so far.
    pub fn messages(&self) -> u64 {
        u64::from(self.sequence)
    }

    /// Completes the file.
    ///
    /// # Errors
    /// If writing fails, or failed before.
    pub fn finish(mut self) -> Result<(), RecordingError> {
        self.complete();
        self.failed.get().map_or(Ok(()), |message| Err(self.fail(message)))
    }

    /// Waits until everything is written to the file.
    fn complete(&mut self) {
        self.lines = None;
        if let Some(Err(_)) = self.thread.take().map(JoinHandle::join) {
            let _ = self.failed.set("the thread that writes it has died".to_string());
        }
    }

    /// Adds a message at `secs` since the beginning of the performance; times before it count as 0.
    ///
    /// # Errors
    /// If writing fails, or failed before.
    pub fn write<M: Message>(&mut self, secs: f64, message: &M) -> Result<(), RecordingError> {
        self.sequence += 1;
        let channel = self.channels.iter().find(|(topic, _)| *topic == M::TOPIC);
        let channel_id = channel.expect("every kind of message has a channel").1;
        let nanos = (secs.max(0.0) * 1e9).round() as u64;
        let header =
            MessageHeader { channel_id, sequence: self.sequence, log_time: nanos, publish_time: nanos };
        let text = serde_json::to_vec(message).expect("messages are plain numbers and strings");
        let flush = secs >= self.flushed_secs + FLUSH_SECS;
        if flush {
            self.flushed_secs = secs;
        }
        let sent = self.lines.as_ref().map(|lines| lines.send(Line { header, text, flush }));
        if let Some(Err(_)) = sent {
            // The thread has ended early; its error is set once it is joined.
            self.complete();
        }
        self.failed.get().map_or(Ok(()), |message| Err(self.fail(message)))
    }

    fn fail(&self, message: &str) -> RecordingError {
        RecordingError::Write { path: self.path.clone(), message: message.to_string() }
    }
}

impl Drop for RecordingWriter {
    fn drop(&mut self) {
        self.complete();
    }
}

/// The message of an error; for an input or output error that of the operating system.
fn cause(error: &mcap::McapError) -> String {
    match error {
        mcap::McapError::Io(source) => source.to_string(),
        other => other.to_string(),
    }
}

/// Writes lines until the channel closes, then completes the file.
fn write_lines(mut writer: McapFile, lines: &Receiver<Line>) -> mcap::McapResult<()> {
    for line in lines {
        writer.write_to_known_channel(&line.header, &line.text)?;
        if line.flush {
            writer.flush()?;
        }
    }
    writer.finish().map(|_| ())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::StepMessage;

    /// A full disk is reported by `write`, while there is time to stop, and by `finish`.
    #[test]
    #[cfg(target_os = "linux")]
    fn a_full_disk_is_told_on_the_way() {
        let full = Path::new("/dev/full");
        let message = StepMessage { positions: vec![0.1; 5000], ..StepMessage::default() };
        let error = match RecordingWriter::create(full, &Header::default()) {
            Err(error) => error,
            Ok(mut writer) => (0..1_000_000)
                .find_map(|step| writer.write(f64::from(step), &message).err())
                .expect("it says so before long"),
        };
        assert!(error.to_string().contains("No space left"), "{error}");
        if let Ok(writer) = RecordingWriter::create(full, &Header::default()) {
            assert!(writer.finish().unwrap_err().to_string().contains("No space left"));
        }
    }
}
