//! Samples to a WAV file: 16 bits, mono.

use std::io::{self, BufWriter, Seek, Write};
use std::path::Path;

use atomic_write_file::AtomicWriteFile;
use hound::{SampleFormat, WavSpec, WavWriter};

use super::error::SoundError;
use super::samples::SAMPLE_RATE_HZ;

const SPEC: WavSpec = WavSpec {
    channels: 1,
    sample_rate: SAMPLE_RATE_HZ,
    bits_per_sample: 16,
    sample_format: SampleFormat::Int,
};

/// Writes samples from −1 to 1, mono at [`SAMPLE_RATE_HZ`]; louder ones are clipped. The file is
/// replaced only when the new contents are complete.
///
/// # Errors
/// If the file cannot be written; an older file of that name is untouched then.
pub fn write_wav(path: impl AsRef<Path>, samples: &[f32]) -> Result<(), SoundError> {
    let path = path.as_ref();
    let write = || {
        let mut file = AtomicWriteFile::open(path)?;
        encode(samples, BufWriter::new(&mut file))?;
        file.commit()
    };
    write().map_err(|source| SoundError::Write { path: path.into(), source })
}

fn encode(samples: &[f32], out: impl Write + Seek) -> io::Result<()> {
    let as_io = |error| match error {
        hound::Error::IoError(error) => error,
        other => io::Error::other(other),
    };
    let mut wav = WavWriter::new(out, SPEC).map_err(as_io)?;
    for sample in samples {
        // `as` saturates, and converts NaN to 0.
        wav.write_sample((sample * f32::from(i16::MAX)).round() as i16).map_err(as_io)?;
    }
    wav.finalize().map_err(as_io)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_can_be_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tone.wav");
        write_wav(&path, &[0.0, 0.5, -1.0, 2.0, -2.0, f32::NAN]).unwrap();
        let mut wav = hound::WavReader::open(&path).unwrap();
        assert_eq!(wav.spec(), SPEC);
        let samples: Vec<i16> = wav.samples().map(Result::unwrap).collect();
        assert_eq!(samples, [0, 16384, -32767, 32767, -32768, 0]);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_place_that_cannot_be_written_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let error = write_wav(folder.path().join("no/such/folder.wav"), &[0.0]).unwrap_err().to_string();
        assert!(error.contains("folder.wav") && error.contains("create the folder first"), "{error}");
    }

    /// A disk with room for some bytes.
    struct SmallDisk(io::Cursor<Vec<u8>>, usize);

    impl Write for SmallDisk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if self.0.position() as usize + bytes.len() > self.1 {
                return Err(io::ErrorKind::StorageFull.into());
            }
            self.0.write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            self.0.flush()
        }
    }

    impl Seek for SmallDisk {
        fn seek(&mut self, to: io::SeekFrom) -> io::Result<u64> {
            self.0.seek(to)
        }
    }

    #[test]
    fn a_full_disk_is_an_error_wherever_it_strikes() {
        for room in [0, 20, 44, 100, 2043] {
            let error = encode(&[0.25; 1000], SmallDisk(io::Cursor::default(), room)).unwrap_err();
            assert_eq!(error.kind(), io::ErrorKind::StorageFull, "{room}");
            assert!(super::super::write_hint(&error).contains("free some space"));
        }
        encode(&[0.25; 1000], SmallDisk(io::Cursor::default(), 2044)).unwrap();
    }
}
