//! The player of a song for which no policy was named.

use anyhow::Context as _;
use etude_music::Song;
use etude_perform::shell_word;

use crate::loaded_player::{LoadedPlayer, load_policy_file};
use crate::play::scores_in_simulation;
use crate::policy_files::{RUNS, policies, shipped_policy};
use crate::song_planner::SongPlanner;
use crate::zero_shot::{SIGHT_READER, predict_zero_shot};

/// The best sight-reader of those that were evaluated on the same pieces as the one that comes with
/// Étude: scores on others do not compare.
///
/// # Errors
/// If there are some, and none can be used.
pub(crate) fn sight_reader() -> anyhow::Result<Option<LoadedPlayer>> {
    // Another generator of melodies has other notes under the same configuration.
    let evaluated_on = |player: &LoadedPlayer| (player.config.corpus.clone(), player.claimed_due);
    let shipped = shipped_policy(SIGHT_READER).and_then(|path| load_policy_file(&path).ok());
    let shipped = shipped.as_ref().map(evaluated_on);
    best_of(SIGHT_READER, |player| shipped.as_ref().is_none_or(|shipped| *shipped == evaluated_on(player)))
}

/// The policy for the song `slug` with the highest mean of F1 and onset F1, of those that `fit` and
/// were evaluated. One by the articulated rule comes before all others, because scores do not
/// compare between rules. Of equally good policies, one of a run comes before the shipped one.
///
/// # Errors
/// If there are some, and none can be used.
fn best_of(slug: &str, fit: impl Fn(&LoadedPlayer) -> bool) -> anyhow::Result<Option<LoadedPlayer>> {
    // One damaged file must not keep the others from playing.
    let (mut players, mut errors) = (Vec::new(), Vec::new());
    for path in policies(slug) {
        match load_policy_file(&path) {
            // A training that was stopped before its first evaluation has a policy that has learned
            // nothing.
            Ok(player) if player.claimed_f1.is_none() || !fit(&player) => {}
            Ok(player) => players.push(player),
            Err(error) => errors.push(error),
        }
    }
    let rank =
        |player: &LoadedPlayer| (player.config.task.key_schedule.rule, player.claimed_overall.unwrap_or(0.0));
    players.sort_by(|a, b| {
        let ((rule_a, score_a), (rule_b, score_b)) = (rank(a), rank(b));
        rule_b.cmp(&rule_a).then(score_b.total_cmp(&score_a))
    });
    match players.into_iter().next() {
        None => errors.into_iter().next().map_or(Ok(None), Err),
        found => Ok(found),
    }
}

/// The player of a song for which no policy was named.
pub struct Chosen {
    /// The player.
    pub player: LoadedPlayer,
    /// The best policy that has learned the song, if the sight-reader will play it better.
    pub passed_over: Option<LoadedPlayer>,
}

/// The player of `song`, which was `asked` for and has this short form, if no policy is named: the
/// best of its policies that have learned these notes, or else the sight-reader. If that policy
/// misses notes and the sight-reader is predicted to play more, the sight-reader plays the song in
/// simulation, and is chosen if it plays more notes right with a higher F1. A policy that has
/// learned loud and soft may have a slightly lower F1.
///
/// # Errors
/// If there is none, or none can be used.
pub fn choose_player(
    asked: &str,
    slug: &str,
    song: &Song,
    planner: &mut SongPlanner<'_>,
) -> anyhow::Result<Chosen> {
    let own = best_of(slug, |player| player.has_learned(song))?;
    let chosen = match own {
        None => sight_reader()?.map(|player| Chosen { player, passed_over: None }),
        Some(own) => Some(match better_sight_reader(&own, song, planner) {
            Some(player) => Chosen { player, passed_over: Some(own) },
            None => Chosen { player: own, passed_over: None },
        }),
    };
    chosen.with_context(|| {
        format!(
            "there is no policy for `{asked}` yet: `etude train {}` makes one, or name one with --policy (looked in \
             policies/ and {RUNS})",
            shell_word(asked)
        )
    })
}

/// Added to the F1 of a policy that plays loud and soft, which the sight-reader does not.
const VELOCITY_BONUS: f64 = 0.05;

/// The sight-reader, if in simulation it plays more notes of `song` right than `own` has, and with
/// a higher F1.
fn better_sight_reader(
    own: &LoadedPlayer,
    song: &Song,
    planner: &mut SongPlanner<'_>,
) -> Option<LoadedPlayer> {
    let bonus = if own.config.task.velocities { VELOCITY_BONUS } else { 0.0 };
    let notes = own.claimed_notes.filter(|notes| *notes < song.notes().len() as f64)?;
    let f1 = own.claimed_f1? + bonus;
    let reader = sight_reader().ok()??;
    let task = &reader.config.task;
    let piece = planner.plan(song, task).ok()?;
    // The prediction is often too high, seldom too low, and needs no simulation.
    let predicted = predict_zero_shot(song, task, &piece, planner)?;
    if notes >= predicted.notes_right as f64 || f1 >= predicted.f1 {
        return None;
    }
    let played = scores_in_simulation(&reader, &piece, planner).ok()?;
    (notes < played.note.matched as f64 && f1 < played.frame.f1).then_some(reader)
}

#[cfg(test)]
mod tests {
    use etude_music::repertoire;

    use super::*;

    /// The prediction for chords without silence is too high. What counts is what the sight-reader
    /// plays.
    #[test]
    fn a_policy_is_passed_over_for_what_the_sight_reader_plays_and_not_for_what_is_predicted() {
        let song = repertoire::get("chord-progression").unwrap();
        let reader = sight_reader().unwrap().unwrap();
        let mut planner = SongPlanner::default();
        let piece = planner.plan(&song, &reader.config.task).unwrap();
        let played = scores_in_simulation(&reader, &piece, &mut planner).unwrap();
        let predicted = predict_zero_shot(&song, &reader.config.task, &piece, &mut planner).unwrap();
        assert!(predicted.notes_right > played.note.matched && predicted.f1 > played.frame.f1 - 0.005);
        let mut own = load_policy_file(&shipped_policy("chord-progression").unwrap()).unwrap();
        let mut is_passed_over = |own: &mut LoadedPlayer, notes: usize, f1: f64| {
            (own.claimed_notes, own.claimed_f1) = (Some(notes as f64), Some(f1));
            better_sight_reader(own, &song, &mut planner).is_some()
        };
        let (notes, f1) = (played.note.matched, played.frame.f1);
        assert!(is_passed_over(&mut own, notes - 1, f1 - 0.01));
        assert!(!is_passed_over(&mut own, notes, f1 - 0.01), "as many notes");
        assert!(!is_passed_over(&mut own, notes - 1, f1 + 0.001), "a higher F1");
        own.config.task.velocities = true;
        assert!(!is_passed_over(&mut own, notes - 1, f1 - 0.01), "loud and soft are worth more");
    }
}
