//! Whether a song can be played within the limits of a rig that were lowered, and how much slower
//! it can. The player plays it in a simulation whose joints keep the rig's limits.

use std::sync::atomic::AtomicBool;

use etude_music::metrics::note_scores;
use etude_music::{MAX_LATENCY_COMPENSATION_SECS, Note, Song};
use etude_perform::{SimRig, limits_for, perform, within_limits};
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
    let lowered = lowered(limits, &learned_limits(player)?);
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

/// The limits of a rig whose rail is slower than by default because a policy has learned with such
/// a rail, each as `name = value`, if this rig's rail is quicker than that.
///
/// # Errors
/// If the player's task is not sound.
pub fn slower_rail(player: &LoadedPlayer, limits: &LimitsConfig) -> anyhow::Result<Vec<String>> {
    let learned = learned_limits(player)?;
    let default = by_name(&LimitsConfig::default());
    let limits = by_name(limits).into_iter().zip(by_name(&learned)).zip(default);
    let quicker = limits.filter(|(((name, limit), (_, learned)), (_, default))| {
        name.starts_with("rail") && learned < default && *limit > 1.01 * learned
    });
    Ok(quicker.map(|((_, (name, learned)), _)| format!("limits.{name} = {learned}")).collect())
}

/// The limits of a rig that is as quick as the simulator in which `player` has learned.
fn learned_limits(player: &LoadedPlayer) -> anyhow::Result<LimitsConfig> {
    Ok(limits_for(&player.config.task.params().map_err(TaskError::from)?))
}

fn by_name(limits: &LimitsConfig) -> [(&'static str, f64); 6] {
    [
        ("finger_velocity", limits.finger_velocity),
        ("finger_acceleration", limits.finger_acceleration),
        ("finger_jerk", limits.finger_jerk),
        ("rail_velocity", limits.rail_velocity),
        ("rail_acceleration", limits.rail_acceleration),
        ("rail_jerk", limits.rail_jerk),
    ]
}

/// The limits of set-points that are lower than the default, and than those that were `learned`
/// with.
fn lowered(limits: &LimitsConfig, learned: &LimitsConfig) -> Vec<String> {
    let default = by_name(&LimitsConfig::default());
    let limits = by_name(limits).into_iter().zip(by_name(learned)).zip(default);
    let lower = limits
        .filter(|(((_, limit), (_, learned)), (_, default))| limit < default && *limit < 0.99 * learned);
    lower
        .map(|(((name, limit), _), (_, default))| format!("limits.{name} = {limit} ({default} by default)"))
        .collect()
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

    /// A policy that has learned with a slow rail needs a slow one, and is not held back by it.
    #[test]
    fn a_rig_as_slow_as_the_simulator_is_not_too_slow_and_a_quicker_one_is_named() {
        let song = repertoire::get("twinkle").unwrap();
        let mut player = load_policy_file(&shipped_policy("twinkle").unwrap()).unwrap();
        assert_eq!(slower_rail(&player, &LimitsConfig::default()).unwrap(), [""; 0]);
        player.config.task.physics.insert("joint.rail.velocity_limit".to_string(), 0.05);
        let slow = learned_limits(&player).unwrap();
        assert_eq!(too_fast(&song, &player, true, &slow, &mut SongPlanner::default()).unwrap(), None);
        assert_eq!(slower_rail(&player, &slow).unwrap(), [""; 0]);
        let named = slower_rail(&player, &LimitsConfig::default()).unwrap();
        assert_eq!(named, ["limits.rail_velocity = 0.053"]);
    }

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
