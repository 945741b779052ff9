//! Notes that a fingering does not play as written, and why.

use std::fmt;

use etude_music::{LOWEST_PITCH, pitch_name};

use super::rail_model::CONTROL_SECS;

/// Why something is not played as written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum UnplayedReason {
    /// More keys at once than fingers: the note is omitted.
    TooManyKeys,
    /// No position of the hand reaches these keys together, or none in time: the note is omitted.
    OutOfReach,
    /// The hand does not get to the note in time, from this key or to it, which is so far away, m:
    /// the note is omitted.
    TooFar(usize, f64),
    /// The note is shortened because a later one needs its finger or another position of the hand.
    HandNeeded,
    /// The note is shortened because the rail has to travel this far to the next one, m.
    RailTooSlow(f64),
    /// The note is shortened because its finger has to change keys.
    FingerBusy,
}

impl UnplayedReason {
    /// Whether the note is omitted.
    fn omits(self) -> bool {
        matches!(self, Self::TooManyKeys | Self::OutOfReach | Self::TooFar(..))
    }
}

/// One note that is not played as written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnplayedNote {
    /// Why.
    pub reason: UnplayedReason,
    /// The key (0 is the lowest C).
    pub key: usize,
    /// Control step at which the note should begin.
    pub step: usize,
    /// Control steps of it that are not played.
    pub lost_steps: usize,
}

/// All notes that are not played as written, in order of time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct UnplayedNotes {
    /// The notes.
    pub notes: Vec<UnplayedNote>,
    /// Notes of the song.
    pub total_notes: usize,
    /// Notes that begin too soon after one of the same key to be struck again: the two are one
    /// stroke.
    pub merged_notes: usize,
    /// Notes struck again by the same finger right after a gap too short to lift it clear of the
    /// key.
    pub quick_restrikes: usize,
}

impl UnplayedNotes {
    /// Notes that are not played at all.
    pub fn omitted(&self) -> impl Iterator<Item = &UnplayedNote> {
        self.notes.iter().filter(|note| note.reason.omits())
    }

    /// How many notes are omitted, and why, in words; none if all are played.
    pub fn omissions(&self) -> Option<String> {
        let count = |is_so: fn(&UnplayedNote) -> bool| self.omitted().filter(|note| is_so(note)).count();
        let reasons = [
            (count(UnplayedNote::is_leap), "because the hand cannot be there in time"),
            (
                count(|note| note.reason == UnplayedReason::TooManyKeys),
                "because more keys sound at once than there are fingers",
            ),
            (
                count(|note| note.reason == UnplayedReason::OutOfReach),
                "because the fingers do not reach them with the keys around them",
            ),
        ];
        let reasons = reasons.into_iter().filter(|(notes, _)| *notes > 0);
        let reasons: Vec<String> = reasons.map(|(notes, why)| format!("{notes} {why}")).collect();
        let (omitted, all) = (self.omitted().count(), self.total_notes);
        (omitted > 0).then(|| format!("the hand omits {omitted} of {all} notes: {}", reasons.join(", ")))
    }

    /// Notes that are omitted or shortened because the hand has too far to go for the time.
    pub fn leaps(&self) -> impl Iterator<Item = &UnplayedNote> {
        self.notes.iter().filter(|note| note.is_leap())
    }

    /// Control steps of notes that are not played.
    pub fn lost_steps(&self) -> usize {
        self.notes.iter().map(|note| note.lost_steps).sum()
    }
}

impl UnplayedNote {
    /// The name of the note.
    pub fn note(&self) -> String {
        pitch_name(LOWEST_PITCH + self.key as u8)
    }

    /// Time at which the note should begin, with the initial silence, s.
    pub fn secs(&self) -> f64 {
        self.step as f64 * CONTROL_SECS
    }

    /// Whether the hand has too far to go for the time.
    pub fn is_leap(&self) -> bool {
        matches!(self.reason, UnplayedReason::TooFar(..) | UnplayedReason::RailTooSlow(_))
    }

    /// Whether the note is omitted because the fingers are too few for its chord, or do not reach
    /// it.
    pub fn is_chord(&self) -> bool {
        matches!(self.reason, UnplayedReason::TooManyKeys | UnplayedReason::OutOfReach)
    }

    /// What happens to the note, and why.
    pub fn what(&self) -> String {
        let early = self.lost_steps as f64 * CONTROL_SECS;
        match self.reason {
            UnplayedReason::TooManyKeys => "is omitted: more keys than fingers".to_string(),
            UnplayedReason::OutOfReach => "is omitted: out of reach with the keys around it".to_string(),
            UnplayedReason::TooFar(key, metres) => {
                let other = pitch_name(LOWEST_PITCH + key as u8);
                format!("is omitted: {:.0} mm from {other}, too far for the time", metres * 1e3)
            }
            UnplayedReason::HandNeeded => format!("is {early:.2} s shorter: a later note needs the hand"),
            UnplayedReason::RailTooSlow(travel) => {
                format!("is {early:.2} s shorter: the rail needs the time for {:.0} mm", travel * 1e3)
            }
            UnplayedReason::FingerBusy => format!("is {early:.2} s shorter: its finger plays the next key"),
        }
    }
}

impl fmt::Display for UnplayedNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} at {:.2} s {}", self.note(), self.secs(), self.what())
    }
}

impl fmt::Display for UnplayedNotes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let count = |what: fn(UnplayedReason) -> bool| self.notes.iter().filter(|n| what(n.reason)).count();
        let parts = [
            (count(UnplayedReason::omits), "omitted"),
            (count(|reason| matches!(reason, UnplayedReason::RailTooSlow(_))), "shortened for the rail"),
            (count(|reason| reason == UnplayedReason::FingerBusy), "shortened for the finger"),
            (count(|reason| reason == UnplayedReason::HandNeeded), "shortened for a later note"),
            (self.merged_notes, "too soon after one of the same key"),
            (self.quick_restrikes, "struck again at once"),
        ];
        write!(f, "{} note{}", self.total_notes, if self.total_notes == 1 { "" } else { "s" })?;
        for (count, what) in parts.into_iter().filter(|(count, _)| *count > 0) {
            write!(f, ", {count} {what}")?;
        }
        if self.lost_steps() > 0 {
            write!(f, " ({:.2} s of notes lost)", self.lost_steps() as f64 * CONTROL_SECS)?;
        }
        Ok(())
    }
}
