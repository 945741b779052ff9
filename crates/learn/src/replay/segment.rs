//! Segments: immutable files with transitions `[begin, end)`, so that a checkpoint writes only new
//! transitions.
//!
//! Bytes, little endian: `ETUDEREP`, then five `u64` (real columns, binary columns, action length,
//! begin, end), then for each transition its values (`f32`), words (`u64`) and flags (`u8`), then
//! the CRC-32C of all before (`u32`).

use super::Replay;

const MAGIC: &[u8; 8] = b"ETUDEREP";
const HEADER: usize = 8 + 5 * 8;
const CHECKSUM: usize = 4;

/// Transitions `[begin, end)` of a training.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Segment {
    pub begin: u64,
    pub end: u64,
}

impl Segment {
    pub(crate) fn file_name(&self) -> String {
        format!("{:012}-{:012}.replay", self.begin, self.end)
    }
}

impl Replay {
    fn record_len(&self) -> usize {
        4 * self.value_stride() + 8 * 2 * self.layout.words() + 1
    }

    fn header(&self, segment: Segment) -> [u8; HEADER] {
        let mut header = [0; HEADER];
        header[..8].copy_from_slice(MAGIC);
        let (real, binary) = (self.layout.real as u64, self.layout.binary as u64);
        let fields = [real, binary, self.action_len as u64, segment.begin, segment.end];
        for (bytes, field) in header[8..].chunks_exact_mut(8).zip(fields) {
            bytes.copy_from_slice(&field.to_le_bytes());
        }
        header
    }

    /// Encodes a segment, all of whose transitions must still be in the buffer.
    pub(crate) fn encode(&self, segment: Segment) -> Vec<u8> {
        assert!(self.oldest() <= segment.begin && segment.begin <= segment.end && segment.end <= self.total);
        let count = (segment.end - segment.begin) as usize;
        let mut bytes = Vec::with_capacity(HEADER + count * self.record_len() + CHECKSUM);
        bytes.extend_from_slice(&self.header(segment));
        let (stride, words) = (self.value_stride(), 2 * self.layout.words());
        for number in segment.begin..segment.end {
            let slot = self.slot(number);
            for value in &self.values[slot * stride..(slot + 1) * stride] {
                bytes.extend_from_slice(&value.to_le_bytes());
            }
            for word in &self.words[slot * words..(slot + 1) * words] {
                bytes.extend_from_slice(&word.to_le_bytes());
            }
            bytes.push(self.flags[slot]);
        }
        let checksum = crc32c::crc32c(&bytes);
        bytes.extend_from_slice(&checksum.to_le_bytes());
        bytes
    }

    /// Starts the numbering of an empty buffer at `first`.
    pub(crate) fn start_at(&mut self, first: u64) {
        self.total = first;
    }

    /// Appends the transitions of an encoded segment. After an error nothing has changed. `Err`
    /// completes "the replay segment …".
    pub(crate) fn decode(&mut self, segment: Segment, bytes: &[u8]) -> Result<(), String> {
        if segment.begin != self.total || segment.end < segment.begin {
            return Err("does not follow the transitions before it".to_owned());
        }
        let expected = usize::try_from(segment.end - segment.begin)
            .ok()
            .and_then(|count| count.checked_mul(self.record_len()))
            .and_then(|records| records.checked_add(HEADER + CHECKSUM))
            .unwrap_or(usize::MAX);
        if bytes.len() != expected {
            return Err(format!("has the wrong length: {} bytes instead of {expected}", bytes.len()));
        }
        let (contents, checksum) = bytes.split_at(bytes.len() - CHECKSUM);
        if contents[..HEADER] != self.header(segment) {
            return Err("is not a replay segment of this training (its header differs)".to_owned());
        }
        if crc32c::crc32c(contents).to_le_bytes() != checksum {
            return Err("is damaged: its checksum does not match its contents".to_owned());
        }
        let (stride, words) = (self.value_stride(), 2 * self.layout.words());
        let records = || contents[HEADER..].chunks_exact(4 * stride + 8 * words + 1);
        let floats = |record: &[u8]| {
            record[..4 * stride].as_chunks::<4>().0.iter().all(|b| f32::from_le_bytes(*b).is_finite())
        };
        if !records().all(floats) {
            return Err("holds a value that is not a finite number".to_owned());
        }
        for record in records() {
            let slot = self.slot(self.total);
            let (values, rest) = record.split_at(4 * stride);
            for (to, from) in self.values[slot * stride..].iter_mut().zip(values.as_chunks::<4>().0) {
                *to = f32::from_le_bytes(*from);
            }
            for (to, from) in self.words[slot * words..].iter_mut().zip(rest[..8 * words].as_chunks::<8>().0)
            {
                *to = u64::from_le_bytes(*from);
            }
            self.flags[slot] = rest[8 * words];
            self.total += 1;
        }
        Ok(())
    }
}
