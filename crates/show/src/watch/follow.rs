//! A file that grows while it is read: what is new since the last time, in whole lines.

use std::fs::File;
use std::io::{ErrorKind, Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

/// So many of the last bytes are compared before reading on. A line of a training's log is shorter,
/// and says when it was written, so another file does not have the same bytes at the same place.
const TAIL: usize = 1024;
/// Longer lines are dropped, for example the zeros that a crash leaves, so that they do not fill
/// the memory.
const MAX_LINE_BYTES: usize = 1 << 20;

/// A file and how far it has been read.
pub(super) struct Follower {
    path: PathBuf,
    offset: u64,
    tail: Vec<u8>,
    lines: Lines,
}

/// The result of one read.
pub(super) struct Piece {
    /// The file is another one, or was truncated: what was read before is not valid.
    pub restarted: bool,
    /// More is there already.
    pub more: bool,
    /// The new lines that are whole.
    pub lines: Vec<Vec<u8>>,
}

impl Follower {
    pub fn new(path: PathBuf) -> Self {
        Self { path, offset: 0, tail: Vec::new(), lines: Lines::default() }
    }

    /// Reads at most `most` bytes. A file that is not there is an empty one.
    pub fn read(&mut self, most: usize) -> std::io::Result<Piece> {
        let known = self.tail.len();
        let mut bytes = bytes_at(&self.path, self.offset - known as u64, known + most)?;
        let restarted = !bytes.starts_with(&self.tail);
        if restarted {
            *self = Self::new(std::mem::take(&mut self.path));
            bytes = bytes_at(&self.path, 0, most)?;
        } else {
            bytes.drain(..known);
        }
        self.offset += bytes.len() as u64;
        self.tail.extend(&bytes[bytes.len().saturating_sub(TAIL)..]);
        self.tail.drain(..self.tail.len().saturating_sub(TAIL));
        Ok(Piece { restarted, more: bytes.len() == most, lines: self.lines.take(&bytes) })
    }
}

fn bytes_at(path: &Path, offset: u64, most: usize) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut file = match File::open(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(bytes),
        opened => opened?,
    };
    file.seek(SeekFrom::Start(offset))?;
    file.take(most as u64).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Joins pieces to lines; an incomplete line is kept for the next piece.
#[derive(Default)]
pub(super) struct Lines {
    begun: Vec<u8>,
}

impl Lines {
    /// The lines that `bytes` complete, without their ends.
    pub fn take(&mut self, bytes: &[u8]) -> Vec<Vec<u8>> {
        let mut whole = Vec::new();
        for part in bytes.split_inclusive(|&byte| byte == b'\n') {
            self.begun.extend(part);
            if self.begun.ends_with(b"\n") {
                self.begun.pop();
                whole.push(std::mem::take(&mut self.begun));
            } else if self.begun.len() > MAX_LINE_BYTES {
                self.begun.clear();
            }
        }
        whole
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use proptest::prelude::*;

    use super::*;

    fn texts(piece: &Piece) -> Vec<&str> {
        piece.lines.iter().map(|line| std::str::from_utf8(line).unwrap()).collect()
    }

    #[test]
    fn only_what_is_new_and_whole_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log");
        let mut follower = Follower::new(path.clone());
        assert!(follower.read(99).unwrap().lines.is_empty(), "it is not there yet");
        let mut file = File::create(&path).unwrap();
        file.write_all(b"one\ntwo\nthr").unwrap();
        assert_eq!(texts(&follower.read(99).unwrap()), ["one", "two"]);
        assert!(follower.read(99).unwrap().lines.is_empty());
        file.write_all(b"ee\nfour\n").unwrap();
        let piece = follower.read(3).unwrap();
        assert!(piece.more && texts(&piece) == ["three"]);
        let piece = follower.read(99).unwrap();
        assert!(!piece.more && texts(&piece) == ["four"]);
    }

    #[test]
    fn a_file_that_begins_anew_is_read_anew() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log");
        let mut follower = Follower::new(path.clone());
        // Cut back; replaced by a longer one; taken away; there again.
        for (text, expected) in
            [("one\ntwo\n", vec!["one", "two"]), ("one\n", vec!["one"]), ("uno\ndue\n", vec!["uno", "due"])]
        {
            std::fs::write(&path, text).unwrap();
            assert_eq!(texts(&follower.read(99).unwrap()), expected);
        }
        std::fs::remove_file(&path).unwrap();
        assert!(follower.read(99).unwrap().restarted);
        std::fs::write(&path, "three\n").unwrap();
        assert_eq!(texts(&follower.read(99).unwrap()), ["three"]);
    }

    #[test]
    fn an_endless_line_does_not_fill_the_memory() {
        let mut lines = Lines::default();
        for _ in 0..10 {
            assert!(lines.take(&vec![0; MAX_LINE_BYTES / 2]).is_empty());
        }
        assert!(lines.begun.len() <= MAX_LINE_BYTES);
        assert_eq!(lines.take(b"\nwhole\n").last().unwrap(), b"whole");
    }

    proptest! {
        #[test]
        fn any_cut_gives_the_same_lines(
            text in "([ab]{0,5}\n?){0,40}", most in 1_usize..9, growth in 1_usize..50,
        ) {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("log");
            let mut follower = Follower::new(path.clone());
            let mut found = Vec::new();
            let mut file = File::create(&path).unwrap();
            for bytes in text.as_bytes().chunks(growth) {
                file.write_all(bytes).unwrap();
                loop {
                    let piece = follower.read(most).unwrap();
                    prop_assert!(!piece.restarted);
                    found.extend(piece.lines);
                    if !piece.more {
                        break;
                    }
                }
            }
            let whole = text.rsplit_once('\n').map_or("", |(whole, _)| whole);
            let expected: Vec<_> = whole.split('\n').map(|line| line.as_bytes().to_vec()).collect();
            prop_assert_eq!(found, if text.contains('\n') { expected } else { Vec::new() });
        }
    }
}
