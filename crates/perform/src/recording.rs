//! Recordings: every control step and key event of a performance, as an MCAP file.
//!
//! | topic | message | when |
//! |---|---|---|
//! | `/header` | [`Header`] | once, first |
//! | `/step` | [`StepMessage`] | at the end of every control step |
//! | `/key` | [`KeyMessage`] | at the physics step in which a key is struck or released |
//!
//! Messages are JSON with a JSON schema. Log times are nanoseconds since the start of the performance. The file is
//! written front to back, so a recording that was cut short can be read as far as it goes.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use mcap::records::MessageHeader;
use serde::{Deserialize, Serialize};

/// Version of the messages below.
const SCHEMA: u32 = 1;

/// What was played, by whom, on what.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Version of the messages.
    pub schema: u32,
    /// Title of the song.
    pub song: String,
    /// Who played: a policy file or `scripted`.
    pub player: String,
    /// Which rig: `simulation`, `twin`, or the name of a robot.
    pub rig: String,
    /// Control steps per second.
    pub control_hz: f64,
    /// Names of the joints, in the order of every list below.
    pub joints: Vec<String>,
    /// MIDI numbers of the keys due at each control step.
    pub due: Vec<Vec<u8>>,
    /// The resolved configuration.
    pub config: serde_json::Value,
}

/// One control step, as it stood at its end. Rad and N·m; the rail in m and N.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StepMessage {
    /// Index of the step.
    pub step: u64,
    /// Joint targets that were sent.
    pub targets: Vec<f64>,
    /// Joint positions as the encoders read them.
    pub positions: Vec<f64>,
    /// Joint velocities.
    pub velocities: Vec<f64>,
    /// Torques of the last physics step.
    pub torques: Vec<f64>,
    /// Fingertips, `[x, y, z]` each, m.
    pub fingertips: Vec<[f64; 3]>,
    /// MIDI numbers of the keys that sound.
    pub pressed: Vec<u8>,
}

/// A key was struck or released.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct KeyMessage {
    /// Time since the start, s.
    pub secs: f64,
    /// MIDI number.
    pub pitch: u8,
    /// MIDI velocity; 0 is a release.
    pub velocity: u8,
}

/// A recording could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file cannot be created, opened or read.
    #[error("cannot open the recording {path}: {source}")]
    Open {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Writing failed, for example because the disk is full.
    #[error("cannot write the recording {path}: {message}; what was written until then can be read")]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        message: String,
    },
    /// The file is no recording of ours.
    #[error("{path} is not a recording of Étude: {message}")]
    Format {
        /// The file.
        path: PathBuf,
        /// Why.
        message: String,
    },
}

/// Writes a recording front to back.
pub struct RecordingWriter {
    path: PathBuf,
    writer: mcap::Writer<BufWriter<File>>,
    step: u16,
    key: u16,
    sequence: u32,
}

impl RecordingWriter {
    /// Creates the file and writes its header.
    ///
    /// # Errors
    /// If the file cannot be created or written.
    pub fn create(path: &Path, header: &Header) -> Result<Self, RecordingError> {
        let file =
            File::create(path).map_err(|source| RecordingError::Open { path: path.to_path_buf(), source })?;
        let fail = |error: mcap::McapError| RecordingError::Write {
            path: path.to_path_buf(),
            message: error.to_string(),
        };
        let options = mcap::WriteOptions::new()
            .compression(None)
            .profile("")
            .library(concat!("etude ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(64 * 1024));
        let mut writer = options.create(BufWriter::new(file)).map_err(fail)?;
        let mut channel = |topic: &str, name: &str| {
            let schema = writer.add_schema(name, "jsonschema", br#"{"type":"object"}"#)?;
            writer.add_channel(schema, topic, "json", &BTreeMap::new())
        };
        let ids = (|| {
            Ok::<_, mcap::McapError>([
                channel("/header", "etude.Header")?,
                channel("/step", "etude.Step")?,
                channel("/key", "etude.Key")?,
            ])
        })();
        let [head, step, key] = ids.map_err(fail)?;
        let mut recording = Self { path: path.to_path_buf(), writer, step, key, sequence: 0 };
        recording.write(head, 0.0, &Header { schema: SCHEMA, ..header.clone() })?;
        Ok(recording)
    }

    /// Adds the control step that ended at `secs`.
    ///
    /// # Errors
    /// If writing fails.
    pub fn step(&mut self, secs: f64, message: &StepMessage) -> Result<(), RecordingError> {
        self.write(self.step, secs, message)
    }

    /// Adds a key event.
    ///
    /// # Errors
    /// If writing fails.
    pub fn key(&mut self, message: &KeyMessage) -> Result<(), RecordingError> {
        self.write(self.key, message.secs, message)
    }

    /// Completes the file.
    ///
    /// # Errors
    /// If writing fails.
    pub fn finish(mut self) -> Result<(), RecordingError> {
        let finished = self.writer.finish();
        finished.map(|_| ()).map_err(|error| self.fail(&error))
    }

    fn write(&mut self, channel_id: u16, secs: f64, message: &impl Serialize) -> Result<(), RecordingError> {
        self.sequence += 1;
        let nanos = (secs * 1e9).round() as u64;
        let header =
            MessageHeader { channel_id, sequence: self.sequence, log_time: nanos, publish_time: nanos };
        // Plain numbers and strings: writing them as JSON cannot fail.
        let text = serde_json::to_vec(message).unwrap_or_default();
        let written = self.writer.write_to_known_channel(&header, &text);
        written.map_err(|error| self.fail(&error))
    }

    fn fail(&self, error: &mcap::McapError) -> RecordingError {
        RecordingError::Write { path: self.path.clone(), message: error.to_string() }
    }
}

/// A recording read back.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// What was played.
    pub header: Header,
    /// Every control step.
    pub steps: Vec<StepMessage>,
    /// Every key event.
    pub keys: Vec<KeyMessage>,
    /// Whether the file ends as it should; `false` for one that was cut short or damaged.
    pub complete: bool,
}

impl Recording {
    /// Reads a recording; a damaged or unfinished one as far as it goes.
    ///
    /// # Errors
    /// If the file cannot be read, or not even its header is there.
    pub fn read(path: &Path) -> Result<Self, RecordingError> {
        let bytes = std::fs::read(path)
            .map_err(|source| RecordingError::Open { path: path.to_path_buf(), source })?;
        Self::from_bytes(&bytes)
            .map_err(|message| RecordingError::Format { path: path.to_path_buf(), message })
    }

    /// Reads the bytes of a recording. `Err` says what is wrong with them.
    ///
    /// # Errors
    /// If not even the header can be read.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        let mut recording = Self { complete: true, ..Self::default() };
        // mcap 0.26.0 subtracts sizes that it has not checked: with overflow checks on, a damaged chunk panics there.
        let read = std::panic::AssertUnwindSafe(|| recording.take(bytes));
        match std::panic::catch_unwind(read) {
            Ok(taken) => taken?,
            Err(_) => recording.complete = false,
        }
        recording.complete &= bytes.ends_with(mcap::MAGIC);
        match recording.header.schema {
            SCHEMA => Ok(recording),
            0 => Err("it has no header".to_string()),
            other => Err(format!("its messages are version {other}, and this Étude reads {SCHEMA}")),
        }
    }

    /// Takes over message after message until the end or the first damage.
    fn take(&mut self, bytes: &[u8]) -> Result<(), String> {
        let options = mcap::read::Options::IgnoreEndMagic.into();
        let stream = mcap::MessageStream::new_with_options(bytes, options).map_err(|e| e.to_string())?;
        for message in stream {
            let Ok(message) = message else {
                self.complete = false;
                break;
            };
            let data: &[u8] = &message.data;
            let taken = match message.channel.topic.as_str() {
                "/header" => serde_json::from_slice(data).map(|header| self.header = header),
                "/step" => serde_json::from_slice(data).map(|step| self.steps.push(step)),
                "/key" => serde_json::from_slice(data).map(|key| self.keys.push(key)),
                _ => Ok(()),
            };
            taken.map_err(|error| format!("a message on {} is damaged: {error}", message.channel.topic))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sample() -> (Recording, Vec<u8>) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r.mcap");
        let header = Header {
            schema: SCHEMA,
            song: "A <song>".to_string(),
            joints: vec!["rail".to_string()],
            due: vec![vec![60], vec![]],
            ..Header::default()
        };
        let mut writer = RecordingWriter::create(&path, &header).unwrap();
        let mut steps = Vec::new();
        for step in 0..400 {
            let message = StepMessage {
                step,
                targets: vec![0.1 * step as f64],
                pressed: vec![60],
                ..Default::default()
            };
            writer.step(step as f64 * 0.05, &message).unwrap();
            steps.push(message);
        }
        let key = KeyMessage { secs: 0.125, pitch: 60, velocity: 90 };
        writer.key(&key).unwrap();
        writer.finish().unwrap();
        let recording = Recording { header, steps, keys: vec![key], complete: true };
        assert_eq!(Recording::read(&path).unwrap(), recording);
        (recording, std::fs::read(&path).unwrap())
    }

    #[test]
    fn a_recording_that_was_cut_short_is_read_as_far_as_it_goes() {
        let (whole, bytes) = sample();
        let half = Recording::from_bytes(&bytes[..bytes.len() / 2]).unwrap();
        assert!(!half.complete && !half.steps.is_empty());
        assert_eq!(half.steps[..], whole.steps[..half.steps.len()]);
        assert!(Recording::from_bytes(&bytes[..20]).is_err());
        assert!(Recording::from_bytes(b"MThd").is_err());
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 48, ..Default::default() })]
        #[test]
        fn damage_never_panics(at in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..20)) {
            let (_, mut bytes) = sample();
            for (index, value) in at {
                let index = index.index(bytes.len());
                bytes[index] = value;
            }
            let _ = Recording::from_bytes(&bytes);
        }
    }
}
