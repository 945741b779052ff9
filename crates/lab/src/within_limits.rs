//! Whether a song can be played within the limits of a rig that were lowered, and how much slower
//! it can. The player plays it in a simulation whose joints keep the rig's limits.

use std::sync::atomic::AtomicBool;

use etude_music::metrics::note_scores;
use etude_music::{MAX_LATENCY_COMPENSATION_SECS, Note, Song};
use etude_perform::{SimRig, perform, within_limits};
use etude_robot::rig_file::LimitsConfig;
use etude_task::{Piece, TaskError};

use crate::choose_player::sight_reader;
use crate::loaded_player::LoadedPlayer;
use crate::song_planner::SongPlanner;

/// Factors for the duration that are tried, in this order.
const FACTORS: [f64; 6] = [1.25, 1.5, 2.0, 2.5, 3.0, 4.0];
/// Share of the notes that must be right for a song to count as playable.
const PLAYABLE: f64 = 0.9;

/// A song that is too fast for a rig.
#[derive(Clone, Debug, PartialEq)]
pub struct TooFast {
    /// Notes that are right in simulation within the rig's limits.
    pub notes_right: usize,
    /// Notes of the song.
    pub notes_due: usize,
    /// The limits that are lower than the default, each as `name = value (default)`.
    pub lowered: Vec<String>,
    /// What helps.
    pub remedy: Remedy,
}

/// What makes a song playable within the limits of a rig, and the notes that are right then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Remedy {
    /// The smallest factor for the duration.
    Slower(f64, usize),
    /// The default limits of the fingers or of the rail: a press takes as long at any tempo.
    Raise(&'static str, usize),
    /// Nothing of this.
    Nothing,
}

/// Whether `song` is too fast for a rig with these limits: more than a tenth of the notes that
/// `player` plays in simulation are lost there. `is_named` says that the same player plays a
/// slower song too; otherwise that is the sight-reader.
///
/// # Errors
/// If the player's task is not sound.
pub fn too_fast(
    song: &Song,
    player: &LoadedPlayer,
    is_named: bool,
    limits: &LimitsConfig,
    planner: &mut SongPlanner<'_>,
) -> anyhow::Result<Option<TooFast>> {
    let lowered = lowered(limits);
    if lowered.is_empty() {
        return Ok(None);
    }
    let piece = planner.plan(song, &player.config.task)?;
    let notes_right = notes_right(player, &piece, limits, planner)?;
    if enough(notes_right, self::notes_right(player, &piece, &LimitsConfig::default(), planner)?) {
        return Ok(None);
    }
    let remedy = remedy(song, player, is_named, &piece, limits, planner)?;
    Ok(Some(TooFast { notes_right, notes_due: piece.notes().len(), lowered, remedy }))
}

fn remedy(
    song: &Song,
    player: &LoadedPlayer,
    is_named: bool,
    piece: &Piece,
    limits: &LimitsConfig,
    planner: &mut SongPlanner<'_>,
) -> anyhow::Result<Remedy> {
    let reader = if is_named { None } else { sight_reader()? };
    let slow_player = reader.as_ref().unwrap_or(player);
    for factor in FACTORS {
        let Ok(slow) = planner.plan(&song.stretch(factor)?, &slow_player.config.task) else { break };
        let right = notes_right(slow_player, &slow, limits, planner)?;
        if enough(right, slow.notes().len()) {
            return Ok(Remedy::Slower(factor, right));
        }
    }
    let default = LimitsConfig::default();
    let LimitsConfig { rail_velocity, rail_acceleration, rail_jerk, .. } = *limits;
    let fast_fingers = LimitsConfig { rail_velocity, rail_acceleration, rail_jerk, ..default.clone() };
    let LimitsConfig { finger_velocity, finger_acceleration, finger_jerk, .. } = *limits;
    let fast_rail = LimitsConfig { finger_velocity, finger_acceleration, finger_jerk, ..default };
    for (group, limits) in [("finger", fast_fingers), ("rail", fast_rail)] {
        let right = notes_right(player, piece, &limits, planner)?;
        if enough(right, piece.notes().len()) {
            return Ok(Remedy::Raise(group, right));
        }
    }
    Ok(Remedy::Nothing)
}

fn enough(right: usize, of: usize) -> bool {
    right as f64 >= PLAYABLE * of as f64
}

/// The limits of set-points that are lower than the default.
fn lowered(limits: &LimitsConfig) -> Vec<String> {
    let default = LimitsConfig::default();
    let limits = [
        ("finger_velocity", limits.finger_velocity, default.finger_velocity),
        ("finger_acceleration", limits.finger_acceleration, default.finger_acceleration),
        ("finger_jerk", limits.finger_jerk, default.finger_jerk),
        ("rail_velocity", limits.rail_velocity, default.rail_velocity),
        ("rail_acceleration", limits.rail_acceleration, default.rail_acceleration),
        ("rail_jerk", limits.rail_jerk, default.rail_jerk),
    ];
    let lower = limits.into_iter().filter(|(_, limit, default)| limit < default);
    lower.map(|(name, limit, default)| format!("limits.{name} = {limit} ({default} by default)")).collect()
}

/// Notes that are right in a simulation within these limits, as if the commands had been sent
/// earlier by what all notes are late.
fn notes_right(
    player: &LoadedPlayer,
    piece: &Piece,
    limits: &LimitsConfig,
    planner: &mut SongPlanner<'_>,
) -> anyhow::Result<usize> {
    let task = &player.config.task;
    let params = within_limits(task.params().map_err(TaskError::from)?, limits);
    let mut rig = SimRig::in_world(task, piece, &params)?;
    let mut piece_player = player.for_piece(task, piece, planner.on_progress())?;
    let played = perform(&mut rig, &mut piece_player, task, piece, None, &AtomicBool::new(false))?.notes();
    let lag_secs = note_scores(piece.notes(), &played).lag_secs.unwrap_or(0.0);
    let lag_secs = lag_secs.clamp(0.0, MAX_LATENCY_COMPENSATION_SECS);
    let earlier = |note: &Note| {
        let [start_secs, end_secs] = [note.start_secs, note.end_secs].map(|secs| secs - lag_secs);
        Note { start_secs, end_secs, ..*note }
    };
    let early: Vec<Note> = played.iter().map(earlier).collect();
    Ok(note_scores(piece.notes(), &early).matched)
}

#[cfg(test)]
mod tests {
    use etude_music::repertoire;

    use super::*;
    use crate::loaded_player::load_policy_file;
    use crate::policy_files::shipped_policy;

    #[test]
    fn a_song_is_too_fast_for_lowered_limits_until_it_is_slow_enough() {
        let song = repertoire::get("twinkle").unwrap();
        let twinkle = load_policy_file(&shipped_policy("twinkle").unwrap()).unwrap();
        let mut planner = SongPlanner::default();
        let mut found =
            |limits: &LimitsConfig| too_fast(&song, &twinkle, false, limits, &mut planner).unwrap();
        assert_eq!(found(&LimitsConfig::default()), None);
        let slow = LimitsConfig { rail_velocity: 0.05, ..LimitsConfig::default() };
        let rail = found(&slow).unwrap();
        assert_eq!((rail.notes_due, rail.lowered.len()), (14, 1));
        assert!(rail.notes_right < 13 && rail.lowered[0].contains("rail_velocity = 0.05"), "{rail:?}");
        assert!(
            matches!(rail.remedy, Remedy::Slower(factor, right) if factor > 1.0 && right >= 13),
            "{rail:?}"
        );
        // However slow the song, a press takes as long.
        let fingers = found(&LimitsConfig { finger_velocity: 1.3, ..LimitsConfig::default() }).unwrap();
        assert!(matches!(fingers.remedy, Remedy::Raise("finger", 13..)), "{fingers:?}");
        let stuck = LimitsConfig { rail_velocity: 0.001, finger_velocity: 0.1, ..LimitsConfig::default() };
        assert_eq!(found(&stuck).unwrap().remedy, Remedy::Nothing);
    }
}
