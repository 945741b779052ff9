//! Counts of right and wrong notes.

use etude_learn::Score;
use etude_music::metrics::NoteScores;

/// How many notes are right, for people to read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoteCounts {
    /// Notes of the song that were played in time.
    pub right: usize,
    /// Notes of the song.
    pub due: usize,
    /// Strokes that play no note of the song.
    pub wrong: usize,
}

impl NoteCounts {
    /// Those of an evaluation; none of runs that have not counted notes.
    pub fn of_evaluation(scores: &[Score]) -> Option<Self> {
        let count = |name: &str| {
            Some(scores.iter().find(|score| score.name == name)?.value).map(|value| value as usize)
        };
        let (right, missed, wrong) = (count("notes_right")?, count("notes_missed")?, count("notes_wrong")?);
        Some(Self { right, due: right + missed, wrong })
    }
}

impl From<&NoteScores> for NoteCounts {
    fn from(scores: &NoteScores) -> Self {
        Self { right: scores.matched, due: scores.matched + scores.missed, wrong: scores.wrong }
    }
}

impl std::fmt::Display for NoteCounts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} of {} notes right, {} wrong", self.right, self.due, self.wrong)
    }
}
