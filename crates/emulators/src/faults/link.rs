//! One direction of any link: what the kinds of links have in common.

use std::time::Duration;

use super::plan::Dice;

/// One direction of a link on which things go wrong. `T` is what is on its way.
#[derive(Clone, Debug)]
pub struct FaultyLink<T> {
    pub(super) dice: Dice,
    pub(super) on_the_way: T,
}

impl<T> FaultyLink<T> {
    /// Whether the link holds at this time; while it does not, a transport should report its loss.
    pub fn is_connected(&self, now: Duration) -> bool {
        self.dice.is_connected(now)
    }
}
