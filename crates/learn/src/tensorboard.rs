//! TensorBoard event files: a record is a length, a masked CRC-32C of it, a small protobuf message,
//! and a masked CRC of that. Format: tensorflow/core/lib/io/record_writer.h and
//! tensorflow/core/util/event.proto.

use std::{
    fs::{File, OpenOptions},
    io::{Seek, SeekFrom, Write},
    path::{Path, PathBuf},
};

use prost::Message as _;

use crate::files::FileError;

#[derive(Clone, PartialEq, prost::Message)]
struct Event {
    /// Seconds since 1970.
    #[prost(double, optional, tag = "1")]
    wall_time: Option<f64>,
    #[prost(int64, optional, tag = "2")]
    step: Option<i64>,
    #[prost(string, optional, tag = "3")]
    file_version: Option<String>,
    #[prost(message, optional, tag = "5")]
    summary: Option<Summary>,
}

#[derive(Clone, PartialEq, prost::Message)]
struct Summary {
    #[prost(message, repeated, tag = "1")]
    value: Vec<Scalar>,
}

#[derive(Clone, PartialEq, prost::Message)]
struct Scalar {
    #[prost(string, optional, tag = "1")]
    tag: Option<String>,
    #[prost(float, optional, tag = "2")]
    simple_value: Option<f32>,
}

/// An event file that is being appended to.
pub(crate) struct EventFile {
    path: PathBuf,
    file: File,
    len: u64,
}

impl EventFile {
    /// Opens the file, of which the first `keep` bytes belong to the checkpoint. The file is not
    /// changed before [`cut_back`](Self::cut_back).
    pub(crate) fn open(path: &Path, keep: u64) -> Result<Self, FileError> {
        let io = |error| FileError::io("write", path)(error);
        let file = OpenOptions::new().create(true).truncate(false).write(true).open(path).map_err(io)?;
        let len = file.metadata().map_err(io)?.len().min(keep);
        Ok(Self { path: path.to_owned(), file, len })
    }

    /// Truncates the file to the kept bytes; an empty file gets its version record with `wall_time`
    /// (seconds since 1970).
    pub(crate) fn cut_back(&mut self, wall_time: f64) -> Result<(), FileError> {
        let io = |error| FileError::io("write", &self.path)(error);
        self.file.set_len(self.len).map_err(io)?;
        self.file.seek(SeekFrom::Start(self.len)).map_err(io)?;
        if self.len == 0 {
            let version = "brain.Event:2".to_string();
            self.append(&Event { file_version: Some(version), ..Event::at(wall_time, 0) })?;
        }
        Ok(())
    }

    /// Appends one event with any number of named values.
    pub(crate) fn scalars(
        &mut self,
        wall_time: f64,
        step: u64,
        values: &[(String, f64)],
    ) -> Result<(), FileError> {
        let value = values
            .iter()
            .map(|(tag, value)| Scalar { tag: Some(tag.clone()), simple_value: Some(*value as f32) });
        let summary = Summary { value: value.collect() };
        self.append(&Event { summary: Some(summary), ..Event::at(wall_time, step) })
    }

    /// Bytes written so far.
    pub(crate) fn len(&self) -> u64 {
        self.len
    }

    /// Syncs all records to the disk.
    pub(crate) fn sync(&self) -> Result<(), FileError> {
        self.file.sync_data().map_err(FileError::io("sync", &self.path))
    }

    fn append(&mut self, event: &Event) -> Result<(), FileError> {
        let record = record(&event.encode_to_vec());
        self.file.write_all(&record).map_err(FileError::io("write", &self.path))?;
        self.len += record.len() as u64;
        Ok(())
    }
}

impl Event {
    fn at(wall_time: f64, step: u64) -> Self {
        Self { wall_time: Some(wall_time), step: Some(step as i64), ..Self::default() }
    }
}

/// CRC-32C, rotated and offset as the format requires.
fn masked_crc(bytes: &[u8]) -> u32 {
    crc32c::crc32c(bytes).rotate_right(15).wrapping_add(0xa282_ead8)
}

fn record(message: &[u8]) -> Vec<u8> {
    let len = (message.len() as u64).to_le_bytes();
    let mut record = Vec::with_capacity(message.len() + 16);
    record.extend_from_slice(&len);
    record.extend_from_slice(&masked_crc(&len).to_le_bytes());
    record.extend_from_slice(message);
    record.extend_from_slice(&masked_crc(message).to_le_bytes());
    record
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The messages of a file, with both checksums of each record verified.
    fn messages(mut bytes: &[u8]) -> Vec<Vec<u8>> {
        let mut out = Vec::new();
        while !bytes.is_empty() {
            let (len, rest) = bytes.split_at(8);
            assert_eq!(rest[..4], masked_crc(len).to_le_bytes());
            let len = u64::from_le_bytes(len.try_into().unwrap()) as usize;
            let message = &rest[4..4 + len];
            assert_eq!(rest[4 + len..8 + len], masked_crc(message).to_le_bytes());
            out.push(message.to_vec());
            bytes = &rest[8 + len..];
        }
        out
    }

    #[test]
    fn crc_matches_the_published_check_value() {
        // CRC-32C of "123456789" is e3069283 (RFC 3720, appendix B.4 has others).
        assert_eq!(crc32c::crc32c(b"123456789"), 0xe306_9283);
        assert_eq!(masked_crc(b"123456789"), 0xe306_9283u32.rotate_right(15).wrapping_add(0xa282_ead8));
    }

    #[test]
    fn records_hold_what_was_logged_and_truncate_cleanly() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("events.out.tfevents.test");
        let values = vec![("eval/f1".to_owned(), 0.5), ("losses/critic".to_owned(), 2.0)];
        let mut events = EventFile::open(&path, 0).unwrap();
        events.cut_back(1.0).unwrap();
        events.scalars(2.0, 300, &values).unwrap();
        let keep = events.len();
        events.scalars(3.0, 600, &values).unwrap();
        drop(events);
        assert_eq!(messages(&std::fs::read(&path).unwrap()).len(), 3);
        let mut events = EventFile::open(&path, keep).unwrap();
        assert_eq!(messages(&std::fs::read(&path).unwrap()).len(), 3);
        events.cut_back(9.0).unwrap();
        events.scalars(4.0, 601, &values[..1]).unwrap();
        events.sync().unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(bytes.len() as u64, events.len());
        let messages = messages(&bytes);
        assert_eq!(messages.len(), 3);
        assert!(messages[0].ends_with(b"brain.Event:2"));
        let mut expected = vec![9];
        expected.extend_from_slice(&4.0f64.to_le_bytes());
        expected.extend_from_slice(&[0x10, 0xd9, 0x04]); // step 601
        expected.extend_from_slice(&[0x2a, 16, 0x0a, 14, 0x0a, 7]);
        expected.extend_from_slice(b"eval/f1");
        expected.push(0x15);
        expected.extend_from_slice(&0.5f32.to_le_bytes());
        assert_eq!(messages[2], expected);
    }
}
