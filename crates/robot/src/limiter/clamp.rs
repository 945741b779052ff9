//! Why a set-point is not where it was asked to be.

/// Which limit kept a set-point from its target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clamp {
    /// It is NaN; the last target is kept.
    NotANumber,
    /// It lies outside the position range.
    Position,
    /// It would take too high a speed.
    Velocity,
    /// It would take too high an acceleration.
    Acceleration,
    /// It would take too high a jerk.
    Jerk,
    /// From there the axis could not stop within the limits.
    Stopping,
    /// From there the axis could not stop before the target, which may stand still from now on.
    Passing,
    /// The arm has not followed: the set-point of the rail waits for it.
    Ahead,
    /// A finger among the keys would be dragged as far as the stop of its roll joint.
    Dragging,
}

impl Clamp {
    /// Its name in recordings.
    pub fn name(self) -> &'static str {
        match self {
            Self::NotANumber => "not-a-number",
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Acceleration => "acceleration",
            Self::Jerk => "jerk",
            Self::Stopping => "stopping",
            Self::Passing => "passing",
            Self::Ahead => "ahead",
            Self::Dragging => "dragging",
        }
    }
}
