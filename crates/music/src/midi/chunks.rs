//! The chunks of a MIDI file: a header and tracks, each with its length in front.
//!
//! They are not read by `midly`, which accepts chunks that are longer than the file, and fails on
//! one value of the time division.

use crate::error::MidiError;

/// What a tick is.
#[derive(Copy, Clone, Debug, PartialEq)]
pub(super) enum Division {
    /// Ticks in a quarter note; tempo events give its length.
    PerQuarter(u16),
    /// Seconds a tick (SMPTE time code); tempo events mean nothing.
    Seconds(f64),
}

/// The body of one track and where it lies in the file.
pub(super) struct TrackChunk<'a> {
    pub offset: usize,
    pub body: &'a [u8],
}

/// The chunks of a file.
pub(super) struct Chunks<'a> {
    pub division: Division,
    pub tracks: Vec<TrackChunk<'a>>,
}

const CHUNK_HEAD: usize = 8;
const HEADER_BODY: usize = 6;

/// Splits the file into chunks. Unknown chunks are skipped, and other bytes after the last track
/// are ignored.
pub(super) fn split(bytes: &[u8]) -> Result<Chunks<'_>, MidiError> {
    if bytes.is_empty() {
        return Err(MidiError("the file is empty; export the song again as a Standard MIDI File".into()));
    }
    if !bytes.starts_with(b"MThd") {
        let hint = hint(bytes);
        return Err(MidiError(format!(
            "this is not a Standard MIDI File (it does not begin with `MThd`); {hint}"
        )));
    }
    let cut_short = |what: &str, offset: usize| {
        MidiError(format!("the file is truncated: {what} at byte {offset}; copy or export it again"))
    };
    let (_, header, mut rest) = chunk(bytes).ok_or(cut_short("the header is incomplete", bytes.len()))?;
    let [f0, f1, n0, n1, d0, d1] =
        *header.first_chunk::<HEADER_BODY>().ok_or(cut_short("the header is too short", bytes.len()))?;
    let format = u16::from_be_bytes([f0, f1]);
    if format > 1 {
        return Err(MidiError(format!(
            "MIDI format {format} is not supported; export the song as format 0 or 1 (one song, played together), \
             format 2 holds loose patterns"
        )));
    }
    let announced = u16::from_be_bytes([n0, n1]);
    let division = division([d0, d1])?;

    let mut tracks = Vec::new();
    while !rest.is_empty() {
        let offset = bytes.len() - rest.len();
        let Some((kind, body, after)) = chunk(rest) else {
            if tracks.len() >= usize::from(announced) {
                break;
            }
            return Err(cut_short("a track is incomplete", offset));
        };
        if kind == b"MTrk" {
            tracks.push(TrackChunk { offset: offset + CHUNK_HEAD, body });
        }
        rest = after;
    }
    if tracks.len() < usize::from(announced) {
        return Err(MidiError(format!(
            "the header announces {announced} tracks but only {} are there; copy or export the file again",
            tracks.len()
        )));
    }
    Ok(Chunks { division, tracks })
}

/// Kind, body and remainder, if the bytes hold a whole chunk.
fn chunk(bytes: &[u8]) -> Option<(&[u8; 4], &[u8], &[u8])> {
    let (kind, rest) = bytes.split_first_chunk::<4>()?;
    let (length, rest) = rest.split_first_chunk::<4>()?;
    let length = usize::try_from(u32::from_be_bytes(*length)).ok()?;
    let (body, after) = rest.split_at_checked(length)?;
    Some((kind, body, after))
}

fn division([high, low]: [u8; 2]) -> Result<Division, MidiError> {
    let bad = |why: &str| {
        let division = u16::from_be_bytes([high, low]);
        MidiError(format!(
            "the header's time division ({division:#06x}) is invalid: {why}; export the song again"
        ))
    };
    if high < 0x80 {
        return match u16::from_be_bytes([high, low]) {
            0 => Err(bad("a beat of no ticks")),
            ticks => Ok(Division::PerQuarter(ticks)),
        };
    }
    let frames_a_second = match high.wrapping_neg() {
        frames @ (24 | 25 | 30) => f64::from(frames),
        // Drop-frame television time: 30 frames in 1.001 seconds.
        29 => 30.0 / 1.001,
        _ => return Err(bad("a frame rate other than 24, 25, 29 and 30")),
    };
    match low {
        0 => Err(bad("a frame of no ticks")),
        ticks => Ok(Division::Seconds(1.0 / (frames_a_second * f64::from(ticks)))),
    }
}

fn hint(bytes: &[u8]) -> &'static str {
    match bytes {
        [b'R', b'I', b'F', b'F', ..] => {
            "it is a RIFF container (audio, or MIDI inside RMID): export plain MIDI"
        }
        [b'<', ..] | [b'P', b'K', ..] => {
            "it looks like MusicXML or a compressed score: open it in a notation program and export MIDI"
        }
        [b'I', b'D', b'3', ..] | [0xFF, 0xFB, ..] => {
            "it looks like recorded audio: notes have to be transcribed to MIDI first"
        }
        _ => "give the path of a .mid file",
    }
}
