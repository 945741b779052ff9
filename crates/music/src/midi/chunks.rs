//! The chunks of a MIDI file: a header and tracks, each with its length in front.
//!
//! They are not read by `midly`, which accepts chunks that are longer than the file, and fails on
//! one value of the time division.

use super::events::{Event, Events};
use super::remark::Remark;
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
    pub remarks: Vec<Remark>,
}

const CHUNK_HEAD: usize = 8;
const HEADER_BODY: usize = 6;
const TRACK: &[u8; 4] = b"MTrk";
/// An end-of-track event without its time.
const END_OF_TRACK: &[u8] = &[0xFF, 0x2F, 0];
/// Bytes that MacBinary puts in front of a file.
const MAC_BINARY: usize = 128;

/// Splits the file into chunks. Unknown chunks are skipped, and other bytes after the last track
/// are ignored. A length that is a little wrong is corrected by the track's own end.
pub(super) fn split(file: &[u8]) -> Result<Chunks<'_>, MidiError> {
    if file.is_empty() {
        return Err(MidiError("the file is empty; export the song again as a Standard MIDI File".into()));
    }
    let Some(start) = start(file) else {
        let hint = hint(file);
        return Err(MidiError(format!(
            "this is not a Standard MIDI File (it does not begin with `MThd`); {hint}"
        )));
    };
    let cut_short = |what: &str, offset: usize| {
        MidiError(format!("the file is truncated: {what} at byte {offset}; copy or export it again"))
    };
    let (_, header, after_header) =
        chunk(&file[start..]).ok_or(cut_short("the header is incomplete", file.len()))?;
    let [f0, f1, n0, n1, d0, d1] =
        *header.first_chunk::<HEADER_BODY>().ok_or(cut_short("the header is too short", file.len()))?;
    let (format, announced) = (u16::from_be_bytes([f0, f1]), u16::from_be_bytes([n0, n1]));
    // One pattern is one song.
    if format > 2 || (format == 2 && announced != 1) {
        return Err(MidiError(format!(
            "MIDI format {format} is not supported; export the song as format 0 or 1 (one song, played together), \
             format 2 holds loose patterns"
        )));
    }
    let division = division([d0, d1])?;
    let (mut tracks, mut remarks) = (Vec::new(), Vec::new());
    let mut rest = after_header;
    while !rest.is_empty() {
        let offset = file.len() - rest.len();
        let number = tracks.len() + 1;
        let is_extra = number > usize::from(announced);
        let announced_body = chunk(rest);
        let ends_well = |body: &[u8], after: &[u8]| {
            is_chunk_or_end(after)
                || is_extra
                || number == usize::from(announced) && body.ends_with(END_OF_TRACK)
        };
        let whole = announced_body.filter(|(kind, body, after)| *kind != TRACK || ends_well(body, after));
        let (kind, body, after) =
            match whole.or_else(|| corrected(rest, number, &mut remarks)).or(announced_body) {
                Some(found) => found,
                None if is_extra => break,
                None => return Err(cut_short("a track is incomplete", offset)),
            };
        if kind == TRACK {
            tracks.push(TrackChunk { offset: offset + CHUNK_HEAD, body });
        }
        rest = after;
    }
    let found = tracks.len();
    if found == 0 && announced > 0 {
        return Err(MidiError(format!(
            "the header announces {announced} tracks but none is there; copy or export the file again"
        )));
    }
    if found < usize::from(announced) {
        remarks.push(Remark::MissingTracks { announced: usize::from(announced), found });
    }
    Ok(Chunks { division, tracks, remarks })
}

/// Where the MIDI file begins: it may lie in a RIFF container (RMID), or behind the head that old
/// Macintoshes put in front (MacBinary).
fn start(file: &[u8]) -> Option<usize> {
    const HEAD: &[u8] = b"MThd";
    // `RIFF`, length, `RMID`, `data`, length.
    let in_riff = file.starts_with(b"RIFF") && file.get(8..16) == Some(b"RMIDdata");
    let at = match file.first()? {
        _ if in_riff => 20,
        0 => MAC_BINARY,
        _ => 0,
    };
    file.get(at..)?.starts_with(HEAD).then_some(at)
}

type Chunk<'a> = (&'a [u8; 4], &'a [u8], &'a [u8]);

/// Kind, body and remainder, if the bytes hold a whole chunk.
fn chunk(bytes: &[u8]) -> Option<Chunk<'_>> {
    let (kind, rest) = bytes.split_first_chunk::<4>()?;
    let (length, rest) = rest.split_first_chunk::<4>()?;
    let length = usize::try_from(u32::from_be_bytes(*length)).ok()?;
    let (body, after) = rest.split_at_checked(length)?;
    Some((kind, body, after))
}

fn is_chunk_or_end(bytes: &[u8]) -> bool {
    let kind = bytes.first_chunk::<4>();
    bytes.is_empty()
        || kind.is_some_and(|kind| kind.iter().all(|byte| byte.is_ascii_graphic() || *byte == b' '))
}

/// A track whose length is wrong, up to its end-of-track event, if a track or the end of the file
/// follows there.
fn corrected<'a>(bytes: &'a [u8], number: usize, remarks: &mut Vec<Remark>) -> Option<Chunk<'a>> {
    let (kind, rest) = bytes.split_first_chunk::<4>()?;
    let (length, rest) = rest.split_first_chunk::<4>()?;
    let mut events = Events::new(rest);
    while !matches!(events.next()?.ok()?, (_, Event::EndOfTrack)) {}
    let (body, after) = rest.split_at(rest.len() - events.unread().len());
    let ends = body.ends_with(END_OF_TRACK) && (after.is_empty() || after.starts_with(TRACK));
    if kind != TRACK || !ends {
        return None;
    }
    let announced = u32::from_be_bytes(*length);
    remarks.push(Remark::WrongLength { track: number, announced: u64::from(announced), found: body.len() });
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
            "it is a RIFF container without a MIDI file inside, probably audio: notes have to be transcribed to MIDI first"
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
