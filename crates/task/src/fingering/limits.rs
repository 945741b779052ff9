//! Notes that a fingering does not play as written, and why.

use std::fmt;

use etude_music::{LOWEST_PITCH, pitch_name};

use super::rail::CONTROL_SECS;

/// Why something is not played as written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LimitKind {
    /// More keys at once than fingers: the note is skipped.
    TooManyKeys,
    /// No place of the hand reaches these keys together, or none in time: the note is skipped.
    OutOfReach,
    /// The hand does not get to the note in time, from this key or to it, which is so far away, m: the note is skipped.
    TooFar(usize, f64),
    /// The note ends early because a later one needs its finger or another place of the hand.
    GivenUp,
    /// The note ends early because the rail has to travel this far to the next one, m.
    RailTooSlow(f64),
    /// The note ends early because its finger has to change keys.
    FingerBusy,
}

/// One note that is not played as written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limit {
    /// Why.
    pub kind: LimitKind,
    /// The key (0 is the lowest C).
    pub key: usize,
    /// Control step at which the note should begin.
    pub step: usize,
    /// Control steps of it that are not played.
    pub lost_steps: usize,
}

/// All notes that are not played as written, in order of time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Limits {
    /// The notes.
    pub notes: Vec<Limit>,
    /// Notes of the song.
    pub total_notes: usize,
    /// Notes that begin too soon after one of the same key to be struck again: the two are one stroke.
    pub merged_notes: usize,
    /// Notes struck again by the same finger right after a gap too short to lift it clear of the key.
    pub quick_restrikes: usize,
}

impl Limits {
    /// Notes that are not played at all.
    pub fn skipped(&self) -> impl Iterator<Item = &Limit> {
        let skips =
            |kind| matches!(kind, LimitKind::TooManyKeys | LimitKind::OutOfReach | LimitKind::TooFar(..));
        self.notes.iter().filter(move |note| skips(note.kind))
    }

    /// How many notes are skipped, and why, in words; none if all are played.
    pub fn left_out(&self) -> Option<String> {
        let count = |is_so: fn(&Limit) -> bool| self.skipped().filter(|note| is_so(note)).count();
        let reasons = [
            (count(Limit::is_leap), "because the hand cannot be there in time"),
            (
                count(|note| note.kind == LimitKind::TooManyKeys),
                "because more keys sound at once than there are fingers",
            ),
            (
                count(|note| note.kind == LimitKind::OutOfReach),
                "because the fingers do not reach them with the keys around them",
            ),
        ];
        let reasons: Vec<String> = reasons
            .into_iter()
            .filter(|(notes, _)| *notes > 0)
            .map(|(notes, why)| format!("{notes} {why}"))
            .collect();
        let (skipped, all) = (self.skipped().count(), self.total_notes);
        (skipped > 0).then(|| format!("the hand leaves out {skipped} of {all} notes: {}", reasons.join(", ")))
    }

    /// Notes that are skipped or end early because the hand has too far to go for the time.
    pub fn leaps(&self) -> impl Iterator<Item = &Limit> {
        self.notes.iter().filter(|note| note.is_leap())
    }

    /// Control steps of notes that are not played.
    pub fn lost_steps(&self) -> usize {
        self.notes.iter().map(|note| note.lost_steps).sum()
    }
}

impl Limit {
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
        matches!(self.kind, LimitKind::TooFar(..) | LimitKind::RailTooSlow(_))
    }

    /// Whether the note is skipped because the fingers are too few for its chord, or do not reach it.
    pub fn is_chord(&self) -> bool {
        matches!(self.kind, LimitKind::TooManyKeys | LimitKind::OutOfReach)
    }

    /// What happens to the note, and why.
    pub fn what(&self) -> String {
        let early = self.lost_steps as f64 * CONTROL_SECS;
        match self.kind {
            LimitKind::TooManyKeys => "is skipped: more keys than fingers".to_string(),
            LimitKind::OutOfReach => "is skipped: out of reach with the keys around it".to_string(),
            LimitKind::TooFar(key, metres) => {
                let other = pitch_name(LOWEST_PITCH + key as u8);
                format!("is skipped: {:.0} mm from {other}, too far for the time", metres * 1e3)
            }
            LimitKind::GivenUp => format!("ends {early:.2} s early: the hand is needed elsewhere"),
            LimitKind::RailTooSlow(travel) => {
                format!("ends {early:.2} s early: the rail needs the time for {:.0} mm", travel * 1e3)
            }
            LimitKind::FingerBusy => format!("ends {early:.2} s early: its finger plays the next key"),
        }
    }
}

impl fmt::Display for Limit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} at {:.2} s {}", self.note(), self.secs(), self.what())
    }
}

impl fmt::Display for Limits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let count = |what: fn(LimitKind) -> bool| self.notes.iter().filter(|n| what(n.kind)).count();
        let parts = [
            (self.skipped().count(), "skipped"),
            (count(|kind| matches!(kind, LimitKind::RailTooSlow(_))), "cut short for the rail"),
            (count(|kind| kind == LimitKind::FingerBusy), "cut short for the finger"),
            (count(|kind| kind == LimitKind::GivenUp), "given up"),
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
