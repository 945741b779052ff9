//! Cuts a stream of bytes into frames that announce their size, independent of how the bytes are
//! split.

/// The beginning of a frame whose rest has not come yet.
#[derive(Debug, Default)]
pub(super) struct Framing {
    buffer: Vec<u8>,
    skipped: u64,
}

impl Framing {
    /// The next frame. Takes bytes off the front of `bytes` as it needs them: call it again until
    /// it returns `None`.
    ///
    /// `size` reads the size of a frame from its first `header` bytes, or returns `None` if no
    /// frame begins so; `read` reads a whole frame. Where either returns `None`, a byte is skipped.
    pub fn next<T>(
        &mut self,
        bytes: &mut &[u8],
        header: usize,
        size: impl Fn(&[u8]) -> Option<usize>,
        read: impl Fn(&[u8]) -> Option<T>,
    ) -> Option<T> {
        loop {
            let size = if self.buffer.len() < header { Some(header) } else { size(&self.buffer) };
            if let Some(size) = size {
                let taken = size.saturating_sub(self.buffer.len()).min(bytes.len());
                let (now, later) = bytes.split_at(taken);
                self.buffer.extend_from_slice(now);
                *bytes = later;
                let frame = self.buffer.get(..size)?;
                if size == header {
                    continue;
                }
                if let Some(found) = read(frame) {
                    self.buffer.drain(..size);
                    return Some(found);
                }
            }
            self.buffer.remove(0);
            self.skipped += 1;
        }
    }

    /// Bytes that belonged to no frame. A TCP stream loses nothing: anything but 0 means that the
    /// other side uses another protocol.
    pub fn skipped(&self) -> u64 {
        self.skipped
    }

    #[cfg(test)]
    pub fn buffered(&self) -> usize {
        self.buffer.len()
    }
}
