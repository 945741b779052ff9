//! A file of MCAP that is whole at any moment: it always has an end, also when the program is
//! killed in the middle of a write.

use std::fs::File;
use std::io::{Seek as _, Write as _};
use std::path::Path;

use atomic_write_file::AtomicWriteFile;

use crate::error::RecordingError;

/// The end of a file without an index: the record that ends the data (opcode 15, without a
/// checksum), the footer (opcode 2), which names no index, and the magic bytes.
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
/// Smallest page of a file's cache, bytes.
pub(crate) const PAGE: usize = 4096;
/// Opcode and length of a record, bytes.
pub(crate) const RECORD_HEADER: usize = 9;

/// Where a recording is written to.
pub(crate) trait Disk {
    fn write_all_at(&mut self, bytes: &[u8], offset: u64) -> std::io::Result<()>;
    fn set_len(&mut self, len: u64) -> std::io::Result<()>;
}

impl Disk for File {
    fn write_all_at(&mut self, bytes: &[u8], offset: u64) -> std::io::Result<()> {
        std::os::unix::fs::FileExt::write_all_at(self, bytes, offset)
    }

    fn set_len(&mut self, len: u64) -> std::io::Result<()> {
        // A device such as /dev/full has no length.
        if self.metadata()?.is_file() { File::set_len(self, len) } else { Ok(()) }
    }
}

/// A file that has an end at any moment. A write can be killed where a page of the file begins, but
/// not within a page. So the records are written behind the old end, with the new end first, and
/// the bytes that replace the old end come last: until then readers stop at the old end.
pub(crate) struct TerminatedFile<D> {
    pub(crate) disk: D,
    /// Where the end begins; it lies within one page. 0 if nothing is written yet.
    pub(crate) len: u64,
}

impl<D: Disk> TerminatedFile<D> {
    /// Writes whole records in the place of the end, with a new end behind them, for which
    /// [`filler`] has made room.
    pub(crate) fn add(&mut self, records: &[u8]) -> std::io::Result<()> {
        if records.is_empty() {
            return Ok(());
        }
        self.replace_end(records, self.len + records.len() as u64)?;
        self.len += records.len() as u64;
        Ok(())
    }

    /// Writes the last records, which have an end of their own.
    pub(crate) fn complete(&mut self, records: &[u8]) -> std::io::Result<()> {
        let len = self.len + records.len() as u64;
        // This end is cut off again. At the beginning of a page it fits.
        self.replace_end(records, len.next_multiple_of(PAGE as u64))?;
        self.disk.set_len(len)
    }

    /// Writes `records` in the place of the end and another end at `end`. If that fails, for
    /// example because the disk is full, the old end stays.
    fn replace_end(&mut self, records: &[u8], end: u64) -> std::io::Result<()> {
        let split = if self.len == 0 { 0 } else { UNINDEXED_END.len().min(records.len()) };
        let (first, rest) = records.split_at(split);
        let mut write = || {
            self.disk.write_all_at(&UNINDEXED_END, end)?;
            self.disk.write_all_at(rest, self.len + split as u64)?;
            self.disk.write_all_at(first, self.len)
        };
        let written = write();
        if written.is_err() && self.len > 0 {
            // If this fails too, the first error says why.
            let _ = self.disk.set_len(self.len + UNINDEXED_END.len() as u64);
        }
        written
    }
}

/// Bytes to add to a file of `len` bytes so that an end fits into the page there.
pub(crate) fn filler(len: usize) -> usize {
    let left = PAGE - len % PAGE;
    if left >= UNINDEXED_END.len() { 0 } else { left.max(RECORD_HEADER) }
}

/// Writes `file` under its name again if its folder was removed meanwhile.
pub(crate) fn restore(path: &Path, mut file: &File) -> std::io::Result<()> {
    if path.exists() {
        return Ok(());
    }
    path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
    file.rewind()?;
    std::io::copy(&mut file, &mut File::create(path)?).map(|_| ())
}

/// A new file with these records and an end. Under its name there is never a file without an end.
pub(crate) fn begin_file(path: &Path, records: &[u8]) -> Result<TerminatedFile<File>, RecordingError> {
    let open = |source| RecordingError::Open { path: path.to_path_buf(), source };
    let fail = |source: std::io::Error| RecordingError::Write {
        path: path.to_path_buf(),
        message: source.to_string(),
    };
    // A device such as /dev/full is not replaced by a file.
    let is_device = path.exists() && !path.is_file();
    if !is_device {
        let mut whole = AtomicWriteFile::open(path).map_err(open)?;
        let written = whole.write_all(records).and_then(|()| whole.write_all(&UNINDEXED_END));
        written.and_then(|()| whole.commit()).map_err(fail)?;
    }
    let disk = File::options().read(true).write(true).open(path).map_err(open)?;
    let mut file = TerminatedFile { disk, len: if is_device { 0 } else { records.len() as u64 } };
    if is_device {
        file.add(records).map_err(fail)?;
    }
    Ok(file)
}
