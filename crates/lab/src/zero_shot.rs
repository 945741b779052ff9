//! What the hand cannot play of a piece, and the zero-shot scores of the sight-reader, from its
//! plan.

use etude_music::metrics::frame_scores;
use etude_music::{KeySet, Song};
use etude_task::{Piece, TaskConfig};
use serde::Serialize;

use crate::config::resolve;
use crate::song_planner::SongPlanner;

/// Name of the policy for pieces without one of their own: `policies/sight-reader.safetensors`, and
/// runs in `runs/sight-reader__…`.
pub const SIGHT_READER: &str = "sight-reader";

/// Time around each onset in which the keys are not those that are due, s. Measured with the
/// shipped sight-reader on validation melodies by `scripts/sight_prediction.py`.
const LOST_AT_AN_ONSET_SECS: f64 = 0.004;

/// What the sight-reader is predicted to score on a piece.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ZeroShot {
    /// Notes of the song that are played.
    pub notes_right: usize,
    /// F1 by control step.
    pub f1: f64,
}

/// What the shipped sight-reader will score on `song`, which `task` plans as `piece`: all that its
/// own plan plays, less what is lost at each onset. None if `task` has no fingering.
pub fn predict_zero_shot(
    song: &Song,
    task: &TaskConfig,
    piece: &Piece,
    planner: &mut SongPlanner<'_>,
) -> Option<ZeroShot> {
    let change_steps = resolve(SIGHT_READER, None, &[]).ok()?.task.change_steps;
    let piece = if task.change_steps == change_steps {
        piece.clone()
    } else {
        planner.plan(song, &TaskConfig { change_steps, ..task.clone() }).ok()?
    };
    let limits = piece.fingering()?.unplayed();
    let frames = piece.frames();
    let new = |keys: &[KeySet]| keys[1].iter().any(|key| !keys[0].contains(key));
    let onsets = frames.windows(2).filter(|keys| new(keys)).count();
    let secs = frames.len() as f64 / etude_music::CONTROL_HZ;
    let planned = frame_scores(frames, &piece.planned()).f1;
    Some(ZeroShot {
        notes_right: limits.total_notes.saturating_sub(limits.omitted().count() + limits.merged_notes),
        f1: (planned - LOST_AT_AN_ONSET_SECS * onsets as f64 / secs).max(0.0),
    })
}

/// Another arrangement of a song, and how much of it the hand plays.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Arrangement {
    /// Factor for the duration.
    pub stretch: f64,
    /// Whether it is the upper voice alone.
    pub melody: bool,
    /// Its notes.
    pub notes: usize,
    /// Of these, the notes that the hand leaves out.
    pub left_out: usize,
}

/// Of each arrangement that is tried: whether it is the upper voice alone, and the factor for the
/// duration. The nearest to the song is first.
const ARRANGEMENTS: [(bool, f64); 5] = [(false, 1.5), (false, 2.0), (true, 1.0), (true, 1.5), (true, 2.0)];

/// A slower arrangement of `song`, or its upper voice alone, if the hand leaves out notes of
/// `piece`, as `task` plans the song: the first of which it plays all notes, or else that of which
/// it leaves out the smallest share, if that is less than of the song.
pub fn easier(
    song: &Song,
    task: &TaskConfig,
    piece: &Piece,
    planner: &mut SongPlanner<'_>,
) -> Option<Arrangement> {
    let skipped = |piece: &Piece| Some(piece.fingering()?.unplayed().omitted().count());
    let now =
        Arrangement { stretch: 1.0, melody: false, notes: song.notes().len(), left_out: skipped(piece)? };
    let share = |it: &Arrangement| it.left_out as f64 / it.notes.max(1) as f64;
    let mut best = now;
    for (melody, stretch) in ARRANGEMENTS {
        if best.left_out == 0 {
            break;
        }
        let Ok(arranged) = song.stretch(stretch) else { continue };
        let arranged = if melody { arranged.upper_voice() } else { arranged };
        let Some(left_out) = planner.plan(&arranged, task).ok().and_then(|piece| skipped(&piece)) else {
            continue;
        };
        let this = Arrangement { stretch, melody, notes: arranged.notes().len(), left_out };
        if share(&this) < share(&best) {
            best = this;
        }
    }
    (best != now).then_some(best)
}

/// What the hand cannot play of `song` in the world of `task`, in a line: how many notes a
/// fingering leaves out, and why. A song beyond the keyboard has no fingering, and no line.
///
/// # Errors
/// If the task is not sound.
pub fn cannot_be_played(
    song: &Song,
    task: &TaskConfig,
    planner: &mut SongPlanner<'_>,
) -> anyhow::Result<Vec<String>> {
    if song.check_range().is_err() {
        return Ok(Vec::new());
    }
    let piece = planner.plan(song, &TaskConfig { fingering: true, ..task.clone() })?;
    Ok(piece.fingering().and_then(|fingering| fingering.unplayed().omissions()).into_iter().collect())
}
