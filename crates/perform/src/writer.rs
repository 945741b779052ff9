//! Writing a recording: messages become JSON on the calling thread, and a separate thread writes the file, so that a slow disk
//! does not delay a robot.
//!
//! The file is whole at any moment: after each chunk comes an end without an index, which the next chunk replaces. So other readers
//! of MCAP open it too when the program was killed.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread::JoinHandle;

use mcap::records::MessageHeader;
use mcap::write::NoSeek;

use crate::messages::{Header, Message, topics};
use crate::recording::{RecordingError, SCHEMA};

/// Time of a performance after which a chunk is written even if it is small, s.
const FLUSH_SECS: f64 = 1.0;
/// Size at which a chunk is written: less than a second of a robot.
const CHUNK_BYTES: u64 = 64 * 1024;
/// The end of a file without an index: the record that ends the data (opcode 15, without a checksum), the footer (opcode 2), which
/// names no index, and the magic bytes.
pub(crate) const UNINDEXED_END: [u8; 50] = {
    let mut end = [0; 50];
    (end[0], end[1]) = (15, 4);
    (end[13], end[14]) = (2, 20);
    let mut index = 0;
    while index < mcap::MAGIC.len() {
        end[42 + index] = mcap::MAGIC[index];
        index += 1;
    }
    end
};
/// Most messages that wait for the disk, about two minutes of a robot. When the queue is full, [`RecordingWriter::write`] blocks: a robot's
/// controller does not call it, but the thread that works beside it.
const WAITING: usize = 65_536;

type McapFile = mcap::Writer<NoSeek<Pending>>;

/// What the MCAP writer has written and the file does not yet have: it is not at the end of a record after each of its writes.
#[derive(Clone, Default)]
struct Pending(Arc<Mutex<Vec<u8>>>);

impl Pending {
    /// No code panics while it holds the lock.
    fn take(&self) -> Vec<u8> {
        std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Write for Pending {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// A file that always has an end.
struct Ended {
    file: File,
    /// Where the end begins.
    len: u64,
}

impl Ended {
    /// Writes whole records in the place of the end, with a new end behind them. If the disk is full, the old end is put back.
    fn add(&mut self, mut records: Vec<u8>) -> std::io::Result<()> {
        if records.is_empty() {
            return Ok(());
        }
        let len = records.len();
        records.extend(UNINDEXED_END);
        self.written(&records)?;
        self.len += len as u64;
        Ok(())
    }

    /// Writes `bytes` in the place of the end.
    fn written(&self, bytes: &[u8]) -> std::io::Result<()> {
        let written = self.file.write_all_at(bytes, self.len);
        if written.is_err() && self.len > 0 {
            // What is cut off first makes room for the end. If this fails too, the first error says why.
            let _ = self.file.set_len(self.len);
            let _ = self.file.write_all_at(&UNINDEXED_END, self.len);
        }
        written
    }

    /// Writes the last records, which have an end of their own.
    fn complete(&mut self, records: &[u8]) -> std::io::Result<()> {
        self.written(records)?;
        // A device such as /dev/full has no length.
        let len = self.len + records.len() as u64;
        if self.file.metadata()?.is_file() { self.file.set_len(len) } else { Ok(()) }
    }
}

/// One message on its way to the file.
struct Line {
    header: MessageHeader,
    text: Vec<u8>,
    flush: bool,
}

/// Writes a recording.
pub struct RecordingWriter {
    path: PathBuf,
    channels: Vec<(&'static str, u16)>,
    sequence: u32,
    /// Time on the robot's clock at which the performance began, s.
    pub(crate) begun_secs: f64,
    /// Times of the performance and of the robot's clock when a chunk was written last.
    flushed_secs: [f64; 2],
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
        let fail = |message: String| RecordingError::Write { path: path.to_path_buf(), message };
        let options = mcap::WriteOptions::new()
            .compression(None)
            .profile("")
            .library(concat!("etude ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true);
        let pending = Pending::default();
        let open = || -> mcap::McapResult<(McapFile, Vec<(&'static str, u16)>)> {
            let mut writer = options.create(NoSeek::new(pending.clone()))?;
            let mut channels = Vec::new();
            for (topic, name, schema) in topics() {
                let schema =
                    writer.add_schema(name, "jsonschema", schema.to_value().to_string().as_bytes())?;
                channels.push((topic, writer.add_channel(schema, topic, "json", &BTreeMap::new())?));
            }
            Ok((writer, channels))
        };
        let (writer, channels) = open().map_err(|error| fail(cause(&error)))?;
        let file =
            File::create(path).map_err(|source| RecordingError::Open { path: path.to_path_buf(), source })?;
        let mut file = Ended { file, len: 0 };
        file.add(pending.take()).map_err(|error| fail(error.to_string()))?;
        let failed = Arc::new(OnceLock::new());
        let (lines, waiting) = sync_channel(WAITING);
        let told = Arc::clone(&failed);
        let thread = std::thread::Builder::new()
            .name("recording".to_string())
            .spawn(move || {
                if let Err(error) = write_lines(writer, &pending, file, &waiting) {
                    // Only this thread sets it while it runs.
                    let _ = told.set(cause(&error));
                }
            })
            .map_err(|error| fail(error.to_string()))?;
        let mut recording = Self {
            path: path.to_path_buf(),
            channels,
            sequence: 0,
            begun_secs: 0.0,
            flushed_secs: [0.0; 2],
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
        self.write_measured(secs, secs, message)
    }

    /// The same for what a device measured at `device_secs` of the robot's clock, which also counts before the performance: the publish
    /// time of the message.
    ///
    /// # Errors
    /// If writing fails, or failed before.
    pub fn write_measured<M: Message>(
        &mut self,
        secs: f64,
        device_secs: f64,
        message: &M,
    ) -> Result<(), RecordingError> {
        self.sequence += 1;
        let channel = self.channels.iter().find(|(topic, _)| *topic == M::TOPIC);
        let channel_id = channel.expect("every kind of message has a channel").1;
        let [log_time, publish_time] = [secs, device_secs].map(|secs| (secs.max(0.0) * 1e9).round() as u64);
        let header = MessageHeader { channel_id, sequence: self.sequence, log_time, publish_time };
        let text = serde_json::to_vec(message).expect("messages are plain numbers and strings");
        // Not by the wall clock: the same performance gives the same file.
        let times = [secs, device_secs];
        let due = times.iter().zip(self.flushed_secs).any(|(now, flushed)| *now >= flushed + FLUSH_SECS);
        let flush = M::TOPIC == Header::TOPIC || due;
        if flush {
            self.flushed_secs = std::array::from_fn(|clock| times[clock].max(self.flushed_secs[clock]));
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
fn write_lines(
    mut writer: McapFile,
    pending: &Pending,
    mut file: Ended,
    lines: &Receiver<Line>,
) -> mcap::McapResult<()> {
    for line in lines {
        writer.write_to_known_channel(&line.header, &line.text)?;
        if line.flush {
            writer.flush()?;
        }
        file.add(pending.take())?;
    }
    writer.finish()?;
    Ok(file.complete(&pending.take())?)
}

#[cfg(test)]
impl RecordingWriter {
    /// A writer whose disk hangs. The function frees it, and ends when the writer does.
    pub(crate) fn stuck() -> (Self, impl FnOnce() + Send) {
        let (lines, waiting) = sync_channel(1);
        let writer = Self {
            path: PathBuf::new(),
            channels: topics().into_iter().zip(1..).map(|((topic, ..), id)| (topic, id)).collect(),
            sequence: 0,
            begun_secs: 0.0,
            flushed_secs: [0.0; 2],
            lines: Some(lines),
            thread: None,
            failed: Arc::default(),
        };
        (writer, move || waiting.iter().for_each(drop))
    }
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
