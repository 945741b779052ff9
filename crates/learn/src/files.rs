//! Reading and replacing files, and safetensors files with a JSON header.

use std::{
    collections::HashMap,
    fs::{self, File},
    io::{self, Write},
    path::{Path, PathBuf},
};

use atomic_write_file::AtomicWriteFile;
use safetensors::{Dtype, SafeTensors, tensor::TensorView};
use serde::{Serialize, de::DeserializeOwned};

use crate::tensors::NamedTensor;

/// A file could not be read, written or understood.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The operating system refused.
    #[error("cannot {action} {}: {source}{}", path.display(), hint(source))]
    Io {
        /// "read", "write", …
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The contents are not what they should be.
    #[error("{} cannot be used: {reason}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do about it.
        reason: String,
    },
}

fn hint(source: &io::Error) -> &'static str {
    match source.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            " (make room on the disk; a checkpoint that was there is intact and can be resumed)"
        }
        _ => "",
    }
}

impl FileError {
    pub(crate) fn io(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { action, path, source }
    }

    pub(crate) fn content(path: &Path, reason: impl std::fmt::Display) -> Self {
        Self::Content { path: path.to_owned(), reason: reason.to_string() }
    }
}

/// Replaces the file `path` so that it holds either the old contents or the new ones, also after a
/// power failure.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    let replace = || {
        let mut file = AtomicWriteFile::open(path)?;
        file.write_all(bytes)?;
        file.commit()
    };
    replace().map_err(FileError::io("write", path))?;
    // The parent of a bare name is the empty path.
    sync_folder(path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new(".")))
}

/// Makes renames and removals inside `folder` durable.
pub(crate) fn sync_folder(folder: &Path) -> Result<(), FileError> {
    // Windows has no such call on folders and needs none.
    if cfg!(unix) {
        File::open(folder).and_then(|folder| folder.sync_all()).map_err(FileError::io("sync", folder))
    } else {
        Ok(())
    }
}

pub(crate) fn read(path: &Path) -> Result<Vec<u8>, FileError> {
    fs::read(path).map_err(FileError::io("read", path))
}

/// The only metadata entry of our safetensors files. There is only one because the format's map has
/// no fixed order.
const HEADER_KEY: &str = "etude";

/// A tensor of any type, to be written to a file.
pub(crate) struct RawTensor {
    pub name: String,
    pub dtype: Dtype,
    pub shape: Vec<usize>,
    /// Little endian.
    pub bytes: Vec<u8>,
}

impl From<NamedTensor<'_>> for RawTensor {
    fn from(tensor: NamedTensor<'_>) -> Self {
        let bytes = tensor.values.iter().flat_map(|value| value.to_le_bytes()).collect();
        Self { name: tensor.name, dtype: Dtype::F32, shape: tensor.shape, bytes }
    }
}

/// Last field of the header: the checksum of the rest of it and of all tensors.
const CHECKSUM: &str = ",\"crc32c\":\"";

/// Checksum of a header, and of the names and bytes of tensors in the order of their names.
fn checksum<'a>(header: &str, tensors: impl Iterator<Item = (&'a str, &'a [u8])>) -> String {
    let mut tensors: Vec<_> = tensors.collect();
    tensors.sort_by_key(|(name, _)| *name);
    let sum = tensors.into_iter().fold(crc32c::crc32c(header.as_bytes()), |sum, (name, bytes)| {
        crc32c::crc32c_append(crc32c::crc32c_append(sum, name.as_bytes()), bytes)
    });
    format!("{sum:08x}")
}

/// The bytes of a safetensors file. Same input, same bytes. The header is a structure with fields.
pub(crate) fn encode_tensors(header: &impl Serialize, tensors: &[RawTensor]) -> Result<Vec<u8>, String> {
    let header = serde_json::to_string(header).map_err(|error| error.to_string())?;
    let sum = checksum(&header, tensors.iter().map(|t| (t.name.as_str(), t.bytes.as_slice())));
    let fields = header.strip_suffix('}').ok_or("the header is no structure")?;
    let header = format!("{fields}{CHECKSUM}{sum}\"}}");
    let views = (tensors.iter())
        .map(|t| TensorView::new(t.dtype, t.shape.clone(), &t.bytes).map(|view| (t.name.as_str(), view)))
        .collect::<Result<Vec<_>, _>>()
        .map_err(|error| error.to_string())?;
    safetensors::serialize(views, Some(HashMap::from([(HEADER_KEY.to_owned(), header)])))
        .map_err(|error| error.to_string())
}

/// A parsed safetensors file.
pub(crate) struct TensorFile<'a> {
    header: String,
    tensors: SafeTensors<'a>,
}

impl<'a> TensorFile<'a> {
    /// `Err` says what is wrong with the bytes.
    pub(crate) fn parse(bytes: &'a [u8]) -> Result<Self, String> {
        let (_, metadata) = SafeTensors::read_metadata(bytes)
            .map_err(|error| format!("it is not a safetensors file, or a damaged one ({error:?})"))?;
        let header = (metadata.metadata().as_ref())
            .and_then(|entries| entries.get(HEADER_KEY))
            .ok_or("it was not written by Étude (its metadata has no entry `etude`)")?
            .clone();
        let tensors =
            SafeTensors::deserialize(bytes).map_err(|error| format!("it is damaged ({error:?})"))?;
        let (fields, sum) = header
            .rsplit_once(CHECKSUM)
            .ok_or("its header has no checksum: it is damaged, or of another version of Étude")?;
        let (header, sum) = (format!("{fields}}}"), sum.trim_end_matches("\"}").to_string());
        let found = tensors.tensors();
        if checksum(&header, found.iter().map(|(name, view)| (name.as_str(), view.data()))) != sum {
            return Err("it is damaged: its checksum is wrong".to_string());
        }
        Ok(Self { header, tensors })
    }

    pub(crate) fn header<T: DeserializeOwned>(&self) -> Result<T, String> {
        serde_json::from_str(&self.header)
            .map_err(|error| format!("its header is damaged or from another version of Étude ({error})"))
    }

    /// Shape and bytes of a tensor of type `dtype`.
    pub(crate) fn bytes(&self, name: &str, dtype: Dtype) -> Option<(Vec<usize>, &[u8])> {
        let view = self.tensors.tensor(name).ok().filter(|view| view.dtype() == dtype)?;
        Some((view.shape().to_vec(), view.data()))
    }

    /// Shape and values of a tensor of `f32`.
    pub(crate) fn floats(&self, name: &str) -> Option<(Vec<usize>, Vec<f32>)> {
        let (shape, bytes) = self.bytes(name, Dtype::F32)?;
        Some((shape, bytes.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        write(&path, b"old").unwrap();
        write(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        // A folder in its place stops the last step, the rename.
        let taken = folder.path().join("taken");
        fs::create_dir(&taken).unwrap();
        let error = write(&taken, b"new").unwrap_err().to_string();
        assert!(error.starts_with("cannot write") && error.contains("taken"), "{error}");
        assert!(write(&folder.path().join("no/file"), b"new").is_err());
    }

    #[derive(Serialize, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Header {
        song: String,
    }

    #[test]
    fn any_changed_byte_of_a_tensor_or_of_the_header_is_noticed() {
        let tensor = |name: &str, bytes: [u8; 4]| RawTensor {
            name: name.into(),
            dtype: Dtype::U8,
            shape: vec![4],
            bytes: bytes.to_vec(),
        };
        // In the file tensors lie in another order than they are given.
        let tensors = [tensor("b", [1, 2, 3, 4]), tensor("a", [5, 6, 7, 8])];
        let whole = encode_tensors(&Header { song: "Twinkle".into() }, &tensors).unwrap();
        let read = |bytes: &[u8]| {
            let file = TensorFile::parse(bytes)?;
            let header: Header = file.header()?;
            Ok::<_, String>((header.song, file.bytes("a", Dtype::U8).unwrap().1.to_vec()))
        };
        assert_eq!(read(&whole).unwrap(), ("Twinkle".to_string(), vec![5, 6, 7, 8]));
        let song = whole.windows(7).position(|window| window == b"Twinkle").unwrap();
        for at in (whole.len() - 8..whole.len()).chain(song..song + 7) {
            let mut damaged = whole.clone();
            damaged[at] ^= 1;
            assert!(read(&damaged).unwrap_err().contains("checksum"), "byte {at}");
        }
        // The header is a string in the JSON of the metadata, so its quotation marks are escaped.
        let field = CHECKSUM.replace('"', "\\\"");
        let at = whole.windows(field.len()).position(|window| window == field.as_bytes()).unwrap();
        let mut without = whole.clone();
        // Eight digits and the closing quotation mark.
        without[at..at + field.len() + 10].fill(b' ');
        assert!(read(&without).unwrap_err().contains("no checksum"));
    }

    #[test]
    fn a_full_disk_is_named_with_what_to_do() {
        let error = FileError::io("write", Path::new("file"))(io::ErrorKind::StorageFull.into());
        assert!(error.to_string().contains("make room on the disk; a checkpoint"), "{error}");
    }
}
