//! From the argument of a command to a song: a name of the repertoire, or a file.

use std::path::Path;

use crate::error::SongError;
use crate::midi::MidiFile;
use crate::repertoire;
use crate::song::Song;
use crate::spelling::did_you_mean;

/// The song of this name: a built-in id, or the path of a MIDI file, which is played from its first
/// note on.
///
/// A name of the repertoire wins over a file of the same name; write `./name` for the file.
///
/// # Errors
/// If there is neither; ids that look like the name are suggested. If the file cannot be read or
/// used.
pub fn resolve(name_or_path: &str) -> Result<Song, SongError> {
    match repertoire::get(name_or_path) {
        Some(song) => Ok(song),
        None => Ok(resolve_file(name_or_path)?.song.without_initial_silence()),
    }
}

/// The same as it is written, with what is to be said of a file.
///
/// # Errors
/// As [`resolve`].
pub fn resolve_file(name_or_path: &str) -> Result<MidiFile, SongError> {
    if let Some(song) = repertoire::get(name_or_path) {
        return Ok(MidiFile { song, remarks: Vec::new() });
    }
    let path = Path::new(name_or_path);
    if path.components().count() > 1 || is_named_midi(path) || path.is_file() {
        return MidiFile::load(path);
    }
    let similar = did_you_mean(name_or_path, repertoire::ids());
    Err(SongError::Unknown { name: name_or_path.to_owned(), similar })
}

/// Whether a file has the name of a MIDI file.
pub fn is_named_midi(path: &Path) -> bool {
    path.extension().is_some_and(|end| end.eq_ignore_ascii_case("mid") || end.eq_ignore_ascii_case("midi"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_miss_suggests_what_was_meant() {
        let message = |name: &str| resolve(name).unwrap_err().to_string();
        assert_eq!(
            message("twinckle"),
            "there is no song called \"twinckle\" (did you mean twinkle?); `etude songs` lists the built-in ones, or \
             give the path of a .mid file"
        );
        assert!(message("Happy Birthday!").contains("did you mean happy-birthday?"));
        assert!(message("scale").contains("did you mean c-major-scale, d-major-scale?"));
        assert!(message("für-elise").contains("\"für-elise\"; `etude songs`"));
        assert!(message("").contains("\"\"; `etude songs`"));
        assert!(matches!(resolve("no/such.mid"), Err(SongError::Read { .. })));
        assert!(matches!(resolve("nosuch.MID"), Err(SongError::Read { .. })));
    }
}
