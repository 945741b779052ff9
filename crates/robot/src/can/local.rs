//! A bus inside one process: a frame sent at one endpoint reaches all others, in order, at once.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::{CanError, CanFrame, CanTransport};

/// A receiver that has not looked for so many frames (over a second of a hand's traffic) loses the next ones.
const QUEUE: usize = 4096;

/// One slot an endpoint; those of endpoints that are gone are used again.
type Slots = Arc<Mutex<Vec<Option<Queue>>>>;

#[derive(Debug, Default)]
struct Queue {
    frames: VecDeque<CanFrame>,
    lost: u64,
}

/// The bus.
#[derive(Clone, Debug, Default)]
pub struct LocalBus(Slots);

/// One place on a [`LocalBus`]; leaves the bus when dropped.
#[derive(Debug)]
pub struct LocalEndpoint {
    slots: Slots,
    mine: usize,
}

impl LocalBus {
    /// A bus with nobody on it.
    pub fn new() -> Self {
        Self::default()
    }

    /// One more place on the bus.
    pub fn endpoint(&self) -> LocalEndpoint {
        let mut slots = lock(&self.0);
        let free = slots.iter().position(Option::is_none);
        let mine = free.unwrap_or(slots.len());
        match slots.get_mut(mine) {
            Some(slot) => *slot = Some(Queue::default()),
            None => slots.push(Some(Queue::default())),
        }
        LocalEndpoint { slots: Arc::clone(&self.0), mine }
    }
}

impl LocalEndpoint {
    /// Frames lost because nobody received here for too long.
    pub fn lost(&self) -> u64 {
        lock(&self.slots).get(self.mine).and_then(Option::as_ref).map_or(0, |queue| queue.lost)
    }
}

impl CanTransport for LocalEndpoint {
    fn send(&mut self, frame: CanFrame) -> Result<(), CanError> {
        for (place, queue) in lock(&self.slots).iter_mut().enumerate() {
            let Some(queue) = queue.as_mut().filter(|_| place != self.mine) else { continue };
            if queue.frames.len() < QUEUE {
                queue.frames.push_back(frame);
            } else {
                queue.lost += 1;
            }
        }
        Ok(())
    }

    fn receive(&mut self) -> Result<Option<CanFrame>, CanError> {
        let mut slots = lock(&self.slots);
        Ok(slots.get_mut(self.mine).and_then(Option::as_mut).and_then(|queue| queue.frames.pop_front()))
    }
}

impl Drop for LocalEndpoint {
    fn drop(&mut self) {
        if let Some(slot) = lock(&self.slots).get_mut(self.mine) {
            *slot = None;
        }
    }
}

/// No holder of the lock can leave a queue half changed, so a panic elsewhere is no reason to stop.
fn lock(slots: &Slots) -> MutexGuard<'_, Vec<Option<Queue>>> {
    slots.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_frame_reaches_all_others_in_order() {
        let bus = LocalBus::new();
        let (mut a, mut b, mut c) = (bus.endpoint(), bus.endpoint(), bus.endpoint());
        let frame = |id| CanFrame::new(id, &[1, 2]).unwrap();
        a.send(frame(1)).unwrap();
        b.send(frame(2)).unwrap();
        assert_eq!((c.receive().unwrap(), c.receive().unwrap()), (Some(frame(1)), Some(frame(2))));
        assert_eq!((a.receive().unwrap(), a.receive().unwrap()), (Some(frame(2)), None));
        drop(b);
        let mut d = bus.endpoint();
        assert_eq!(d.receive().unwrap(), None, "a new endpoint does not inherit the frames of one that left");
        for _ in 0..QUEUE + 5 {
            a.send(frame(3)).unwrap();
        }
        assert_eq!((d.lost(), a.lost()), (5, 0));
        assert_eq!(std::iter::from_fn(|| d.receive().unwrap()).count(), QUEUE);
    }
}
