//! Note density: notes per second.

use crate::song::Song;

/// The second of a song in which the most notes begin.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct BusiestSecond {
    /// When it begins: with a note, s.
    pub start_secs: f64,
    /// Notes that begin in it.
    pub notes: usize,
}

impl Song {
    /// Notes per second on average over the song.
    pub fn notes_per_sec(&self) -> f64 {
        self.notes().len() as f64 / self.duration_secs()
    }

    /// The first of the seconds in which the most notes begin; none without notes.
    pub fn busiest_second(&self) -> Option<BusiestSecond> {
        /// Rounding of a time, s.
        const TOLERANCE_SECS: f64 = 1e-6;
        let starts: Vec<f64> = self.notes().iter().map(|note| note.start_secs).collect();
        let seconds = starts.iter().enumerate().map(|(index, &start_secs)| {
            let notes = starts[index..].partition_point(|start| *start < start_secs + 1.0 - TOLERANCE_SECS);
            BusiestSecond { start_secs, notes }
        });
        seconds.reduce(|most, second| if second.notes > most.notes { second } else { most })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::note::Note;

    #[test]
    fn the_busiest_second_begins_with_a_note_and_ends_before_the_next_second() {
        let note = |(start_secs, pitch)| Note { pitch, velocity: 64, start_secs, end_secs: start_secs + 0.2 };
        let notes = [(0.0, 60), (1.0, 60), (2.3, 60), (2.5, 60), (2.5, 64), (3.3, 62), (6.0, 60)];
        let song = Song::new("", notes.map(note).to_vec(), 7.0).unwrap();
        assert_eq!(song.busiest_second(), Some(BusiestSecond { start_secs: 2.3, notes: 3 }));
        assert_eq!(song.notes_per_sec(), 1.0);
    }
}
