//! Writing a recording: messages become JSON on the calling thread, and a separate thread writes
//! the file, so that a slow disk does not delay a robot.
//!
//! After each chunk comes an end without an index, which the next chunk replaces
//! (`terminated_file`). So other readers of MCAP open the file too when the program was killed,
//! also in the middle of a write.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread::JoinHandle;

use mcap::records::MessageHeader;
use mcap::write::NoSeek;

use crate::error::RecordingError;
use crate::messages::{Header, Message, topics};
use crate::recording::SCHEMA;
use crate::terminated_file::{Disk, RECORD_HEADER, TerminatedFile, begin_file, filler, restore};

/// Time of a performance after which a chunk is written even if it is small, s.
const FLUSH_SECS: f64 = 1.0;
/// Size at which a chunk is written: less than a second of a robot.
const CHUNK_BYTES: u64 = 64 * 1024;
/// Largest number of messages that wait for the disk, about two minutes of a robot. When the queue
/// is full, [`RecordingWriter::write`] blocks: a robot's controller does not call it, but the
/// thread that works beside it.
const MAX_QUEUED: usize = 65_536;

/// Opcode of the records that fill a page up. Readers skip records whose opcodes they do not know.
const FILLER: u8 = 0x80;
type McapFile = mcap::Writer<NoSeek<Pending>>;

/// What the MCAP writer has written and the file does not yet have: it is not at the end of a
/// record after each of its writes.
#[derive(Clone, Default)]
struct Pending(Arc<Mutex<Vec<u8>>>);

impl Pending {
    /// No code panics while it holds the lock.
    fn take(&self) -> Vec<u8> {
        std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn is_empty(&self) -> bool {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).is_empty()
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

/// One message on its way to the file.
struct QueuedMessage {
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
    /// [`Header::latency_compensation_secs`].
    pub(crate) latency_compensation_secs: f64,
    /// Times of the performance and of the robot's clock when a chunk was written last.
    flushed_secs: [f64; 2],
    /// `None` once the file is complete.
    lines: Option<SyncSender<QueuedMessage>>,
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
        let pending = Pending::default();
        let (mut writer, channels) = begin(&pending).map_err(|error| fail(cause(&error)))?;
        let records = take_whole(&mut writer, &pending, 0).map_err(|error| fail(cause(&error)))?;
        let mut file = begin_file(path, &records)?;
        let failed = Arc::new(OnceLock::new());
        let (lines, waiting) = sync_channel(MAX_QUEUED);
        let (failure, place) = (Arc::clone(&failed), path.to_path_buf());
        let thread = std::thread::Builder::new()
            .name("recording".to_string())
            .spawn(move || {
                let written = write_lines(writer, &pending, &mut file, &waiting);
                if let Err(error) = written.and_then(|()| Ok(restore(&place, &file.disk)?)) {
                    let _ = failure.set(cause(&error));
                }
            })
            .map_err(|error| fail(error.to_string()))?;
        let mut recording = Self {
            path: path.to_path_buf(),
            channels,
            sequence: 0,
            begun_secs: 0.0,
            latency_compensation_secs: header.latency_compensation_secs,
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
            let _ = self.failed.set("the writing thread has ended unexpectedly".to_string());
        }
    }

    /// Adds a message at `secs` since the beginning of the performance; times before it count as 0.
    ///
    /// # Errors
    /// If writing fails, or failed before.
    pub fn write<M: Message>(&mut self, secs: f64, message: &M) -> Result<(), RecordingError> {
        self.write_measured(secs, secs, message)
    }

    /// The same for what a device measured at `device_secs` of the robot's clock, which also counts
    /// before the performance: the publish time of the message.
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
        let sent = self.lines.as_ref().map(|lines| lines.send(QueuedMessage { header, text, flush }));
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

/// A writer of MCAP with the channels of all messages.
fn begin(pending: &Pending) -> mcap::McapResult<(McapFile, Vec<(&'static str, u16)>)> {
    let options = mcap::WriteOptions::new()
        .compression(None)
        .profile("")
        .library(concat!("etude ", env!("CARGO_PKG_VERSION")))
        .chunk_size(Some(CHUNK_BYTES))
        .disable_seeking(true);
    let mut writer = options.create(NoSeek::new(pending.clone()))?;
    let mut channels = Vec::new();
    for (topic, name, schema) in topics() {
        let schema = writer.add_schema(name, "jsonschema", schema.to_value().to_string().as_bytes())?;
        channels.push((topic, writer.add_channel(schema, topic, "json", &BTreeMap::new())?));
    }
    Ok((writer, channels))
}

/// Writes lines until the channel closes, then completes the file.
fn write_lines<D: Disk>(
    mut writer: McapFile,
    pending: &Pending,
    file: &mut TerminatedFile<D>,
    lines: &Receiver<QueuedMessage>,
) -> mcap::McapResult<()> {
    for line in lines {
        writer.write_to_known_channel(&line.header, &line.text)?;
        if line.flush || !pending.is_empty() {
            add_pending(&mut writer, pending, file)?;
        }
    }
    writer.finish()?;
    Ok(file.complete(&pending.take())?)
}

/// Writes to the file what is pending.
fn add_pending<D: Disk>(
    writer: &mut McapFile,
    pending: &Pending,
    file: &mut TerminatedFile<D>,
) -> mcap::McapResult<()> {
    let records = take_whole(writer, pending, file.len)?;
    Ok(file.add(&records)?)
}

/// What is pending for a file of `len` bytes, and what fills the page up if the end does not fit.
fn take_whole(writer: &mut McapFile, pending: &Pending, len: u64) -> mcap::McapResult<Vec<u8>> {
    writer.flush()?;
    let mut records = pending.take();
    let filler = filler(len as usize + records.len());
    if filler > 0 {
        writer.write_private_record(FILLER, &vec![0; filler - RECORD_HEADER], Default::default())?;
        records.extend(pending.take());
    }
    Ok(records)
}

#[cfg(test)]
mod stuck;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::terminated_file::PAGE;
    use crate::{Recording, StepMessage};

    /// Keeps what a kill could leave: the bytes after each page of each write.
    #[derive(Default)]
    struct Killable {
        bytes: Vec<u8>,
        left: Arc<Mutex<Vec<Vec<u8>>>>,
        /// Bytes that fit on it.
        room: Option<usize>,
    }

    impl Disk for Killable {
        fn write_all_at(&mut self, bytes: &[u8], offset: u64) -> std::io::Result<()> {
            let mut offset = offset as usize;
            let mut bytes = bytes;
            while !bytes.is_empty() {
                let (page, rest) = bytes.split_at(bytes.len().min(PAGE - offset % PAGE));
                if self.room.is_some_and(|room| offset + page.len() > room) {
                    return Err(std::io::ErrorKind::StorageFull.into());
                }
                let end = self.bytes.len().max(offset + page.len());
                self.bytes.resize(end, 0);
                self.bytes[offset..offset + page.len()].copy_from_slice(page);
                self.left.lock().unwrap().push(self.bytes.clone());
                (bytes, offset) = (rest, offset + page.len());
            }
            Ok(())
        }

        fn set_len(&mut self, len: u64) -> std::io::Result<()> {
            self.bytes.resize(len as usize, 0);
            self.left.lock().unwrap().push(self.bytes.clone());
            Ok(())
        }
    }

    /// What a recording leaves on a disk with `room` at each moment of its writing, steps of up to
    /// `longest` positions.
    fn left_behind(room: Option<usize>, longest: usize) -> Vec<Vec<u8>> {
        let disk = Killable { room, ..Killable::default() };
        let left = Arc::clone(&disk.left);
        let mut file = TerminatedFile { disk, len: 0 };
        let pending = Pending::default();
        let (mut writer, channels) = begin(&pending).unwrap();
        add_pending(&mut writer, &pending, &mut file).unwrap();
        let (lines, waiting) = sync_channel(MAX_QUEUED);
        let send = |topic: &str, text: Vec<u8>, sequence| {
            let channel_id = channels.iter().find(|(name, _)| *name == topic).unwrap().1;
            let header = MessageHeader { channel_id, sequence, log_time: 0, publish_time: 0 };
            lines.send(QueuedMessage { header, text, flush: sequence % 2 == 1 }).unwrap();
        };
        let header = Header { schema: SCHEMA, ..Header::default() };
        send(Header::TOPIC, serde_json::to_vec(&header).unwrap(), 1);
        for step in 2..120 {
            let positions = vec![0.1; (step as usize * 379) % longest];
            send(
                StepMessage::TOPIC,
                serde_json::to_vec(&StepMessage { positions, ..StepMessage::default() }).unwrap(),
                step,
            );
        }
        drop(lines);
        let written = write_lines(writer, &pending, &mut file, &waiting);
        assert_eq!(written.is_err(), room.is_some());
        std::mem::take(&mut left.lock().unwrap())
    }

    /// Number of messages in a file that another reader accepts: its footer, its index, and its
    /// records up to the first footer.
    fn read_by_mcap(bytes: &[u8]) -> usize {
        let indexed = mcap::read::footer(bytes).unwrap().summary_start > 0;
        assert_eq!(
            mcap::Summary::read(bytes).unwrap().is_some_and(|summary| summary.stats.is_some()),
            indexed
        );
        let options = mcap::read::Options::IgnoreEndMagic.into();
        mcap::MessageStream::new_with_options(bytes, options).unwrap().map(Result::unwrap).count()
    }

    #[test]
    fn a_file_is_whole_wherever_its_writing_is_killed() {
        for longest in [11, 400, 5000] {
            let left = left_behind(None, longest);
            // The first write begins the file.
            let begun = left.iter().position(|bytes| bytes.starts_with(mcap::MAGIC)).unwrap();
            let counts: Vec<usize> = left[begun + 2..].iter().map(|bytes| read_by_mcap(bytes)).collect();
            assert!(counts.is_sorted() && counts.last() == Some(&119), "{counts:?}");
            assert!(Recording::from_bytes(left.last().unwrap()).unwrap().complete);
        }
    }

    #[test]
    fn a_file_is_whole_when_the_disk_is_full() {
        let whole = left_behind(None, 400).last().unwrap().len();
        for room in (whole / 4..whole).step_by(997) {
            let left = left_behind(Some(room), 400);
            assert!(read_by_mcap(left.last().unwrap()) > 0, "{room}");
            assert!(!Recording::from_bytes(left.last().unwrap()).unwrap().complete);
        }
    }

    /// A full disk is reported by `write`, while there is time to stop, and by `finish`.
    #[test]
    #[cfg(target_os = "linux")]
    fn a_full_disk_is_reported_on_the_way() {
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
