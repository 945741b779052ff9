//! Planning a song for the hand: its fingering takes long for a long song with many chords.

use etude_music::Song;
use etude_task::{Piece, TaskConfig, TaskError};

/// Plans songs, and remembers the last plan: a command plans one song to choose its policy, to warn
/// of what is left out, and to play it.
pub struct SongPlanner<'a> {
    last: Option<(Song, TaskConfig, Piece)>,
    on_progress: Box<dyn FnMut(f64) + 'a>,
}

impl Default for SongPlanner<'_> {
    fn default() -> Self {
        Self::new(|_| {})
    }
}

impl<'a> SongPlanner<'a> {
    /// `on_progress` receives the share that is planned, 0 to 1.
    pub fn new(on_progress: impl FnMut(f64) + 'a) -> Self {
        Self { last: None, on_progress: Box::new(on_progress) }
    }

    /// The plan of `song` for `task`.
    ///
    /// # Errors
    /// As [`Piece::for_task`].
    pub fn plan(&mut self, song: &Song, task: &TaskConfig) -> Result<Piece, TaskError> {
        if let Some((_, _, piece)) = self.last.as_ref().filter(|(of, by, _)| of == song && by == task) {
            return Ok(piece.clone());
        }
        let piece = Piece::for_task_with_progress(song, task, &mut self.on_progress)?;
        self.last = Some((song.clone(), task.clone(), piece.clone()));
        Ok(piece)
    }

    /// For planning that is done elsewhere.
    pub(crate) fn on_progress(&mut self) -> &mut dyn FnMut(f64) {
        &mut self.on_progress
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plan_is_made_again_for_another_song_or_task_alone() {
        let task = crate::resolve(crate::DEFAULT_PRESET, None, &[]).unwrap().task;
        let [twinkle, scale] =
            ["twinkle", "c-major-scale"].map(|id| etude_music::repertoire::get(id).unwrap());
        let slow = TaskConfig { change_steps: task.change_steps + 1, ..task.clone() };
        let calls = std::cell::Cell::new(0);
        let mut planner = SongPlanner::new(|share| {
            assert!((0.0..=1.0).contains(&share));
            calls.set(calls.get() + 1);
        });
        let mut is_planned = |song: &Song, task: &TaskConfig| {
            let before = calls.get();
            let piece = planner.plan(song, task).unwrap();
            let anew = Piece::for_task(song, task).unwrap();
            assert_eq!((piece.frames(), piece.planned()), (anew.frames(), anew.planned()));
            calls.get() > before
        };
        assert!(is_planned(&twinkle, &task) && !is_planned(&twinkle, &task));
        assert!(is_planned(&scale, &task) && is_planned(&scale, &slow) && !is_planned(&scale, &slow));
        assert!(is_planned(&twinkle, &task));
    }
}
