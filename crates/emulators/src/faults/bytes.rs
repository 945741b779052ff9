//! A bad serial line, or a slow TCP connection.
//!
//! Bytes never overtake each other. On a serial line single bytes get lost (`loss`) and pieces lose
//! their end (`truncate`); a TCP connection has neither, it only becomes slow or is cut.

use std::{collections::VecDeque, time::Duration};

use super::plan::{Dice, FaultPlan, FaultPlanError, Link};

/// Bytes on their way at most; later ones are lost.
const MAX_BYTES: usize = 1 << 20;

/// One direction of a byte stream on which things go wrong.
#[derive(Clone, Debug)]
pub struct FaultyBytes {
    dice: Dice,
    /// Bytes, each with its arrival.
    on_the_way: VecDeque<(Duration, u8)>,
}

impl FaultyBytes {
    /// A stream with these faults.
    ///
    /// # Errors
    /// If the plan is not valid, or duplicates or reorders: a stream of bytes does neither.
    pub fn new(plan: &FaultPlan) -> Result<Self, FaultPlanError> {
        Ok(Self { dice: Dice::new(plan, Link::Bytes)?, on_the_way: VecDeque::new() })
    }

    /// Whether the link holds at this time; while it does not, a transport should report its loss.
    pub fn is_connected(&self, now: Duration) -> bool {
        self.dice.is_connected(now)
    }

    /// Sends a piece of bytes; those that are not lost arrive together.
    pub fn push(&mut self, now: Duration, piece: &[u8]) {
        if piece.is_empty() {
            return;
        }
        let fate = self.dice.throw(now);
        if self.dice.is_cut(now, fate.due) {
            return;
        }
        let kept = fate.kept.map_or(piece.len(), |part| (part * piece.len() as f64) as usize);
        for (place, &byte) in piece.iter().enumerate() {
            // One draw a byte, whatever becomes of it.
            let lost = self.dice.loses_byte() || place >= kept;
            if !lost && self.on_the_way.len() < MAX_BYTES {
                self.on_the_way.push_back((fate.due, byte));
            }
        }
    }

    /// Appends the bytes that have arrived by `now`.
    pub fn pop(&mut self, now: Duration, out: &mut Vec<u8>) {
        while let Some((_, byte)) = self.on_the_way.pop_front_if(|(due, _)| *due <= now) {
            out.push(byte);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const STEP: Duration = Duration::from_millis(1);

    /// Pushes one piece a step and pops whatever is due; the bytes that arrived, with their steps.
    fn run(plan: &FaultPlan, pieces: &[Vec<u8>]) -> Vec<(u8, u32)> {
        let mut line = FaultyBytes::new(plan).unwrap();
        let mut arrived = Vec::new();
        let mut out = Vec::new();
        for step in 0..pieces.len() as u32 + 2000 {
            if let Some(piece) = pieces.get(step as usize) {
                line.push(STEP * step, piece);
            }
            out.clear();
            line.pop(STEP * step, &mut out);
            arrived.extend(out.iter().map(|&byte| (byte, step)));
        }
        arrived
    }

    fn is_subsequence(part: &[u8], whole: &[u8]) -> bool {
        let mut rest = whole.iter();
        part.iter().all(|byte| rest.any(|other| other == byte))
    }

    fn any_plan() -> impl Strategy<Value = FaultPlan> {
        let rate = || prop_oneof![Just(0.0), 0.0..=1.0];
        let cut = prop_oneof![Just(None), (0.0..0.1, 0.0..0.1).prop_map(Some)];
        (0.0..0.05, 0.0..0.05, rate(), rate(), cut, any::<u64>()).prop_map(
            |(delay_secs, jitter_secs, loss, truncate, cut, seed)| FaultPlan {
                delay_secs,
                jitter_secs,
                loss,
                truncate,
                disconnect_at_secs: cut.map(|cut| cut.0),
                disconnect_for_secs: cut.map(|cut| cut.1),
                seed,
                ..FaultPlan::default()
            },
        )
    }

    fn pieces() -> impl Strategy<Value = Vec<Vec<u8>>> {
        prop::collection::vec(prop::collection::vec(any::<u8>(), 0..20), 0..150)
    }

    proptest! {
        #[test]
        fn nothing_is_invented(plan in any_plan(), pieces in pieces()) {
            let arrived: Vec<u8> = run(&plan, &pieces).into_iter().map(|(byte, _)| byte).collect();
            prop_assert!(is_subsequence(&arrived, &pieces.concat()));
        }

        #[test]
        fn a_slow_connection_keeps_every_byte_and_its_order(
            delay_secs in 0.0..0.05, jitter_secs in 0.0..0.05, seed: u64, pieces in pieces(),
        ) {
            let plan = FaultPlan { delay_secs, jitter_secs, seed, ..FaultPlan::default() };
            let arrived = run(&plan, &pieces);
            let sent: Vec<(u8, u32)> = (0..)
                .zip(&pieces)
                .flat_map(|(step, piece)| piece.iter().map(move |&byte| (byte, step)))
                .collect();
            prop_assert_eq!(arrived.len(), sent.len());
            for (&(byte, at), &(sent, from)) in arrived.iter().zip(&sent) {
                prop_assert_eq!(byte, sent);
                let took = f64::from(at - from) * STEP.as_secs_f64();
                let latest = delay_secs + jitter_secs + STEP.as_secs_f64();
                prop_assert!(took >= delay_secs - 1e-9 && took <= latest + 1e-9, "{took}");
            }
        }

        #[test]
        fn the_same_plan_gives_the_same_result(plan in any_plan(), pieces in pieces()) {
            prop_assert_eq!(run(&plan, &pieces), run(&plan, &pieces));
        }
    }

    #[test]
    fn a_truncated_piece_loses_its_end_only() {
        let plan = FaultPlan { truncate: 1.0, seed: 2, ..FaultPlan::default() };
        let mut line = FaultyBytes::new(&plan).unwrap();
        let piece: Vec<u8> = (0..100).collect();
        let mut lengths = Vec::new();
        for _ in 0..50 {
            let mut out = Vec::new();
            line.push(Duration::ZERO, &piece);
            line.pop(Duration::ZERO, &mut out);
            assert!(piece.starts_with(&out) && out.len() < piece.len());
            lengths.push(out.len());
        }
        assert!(lengths.iter().min() < Some(&20) && lengths.iter().max() > Some(&80), "{lengths:?}");
    }

    #[test]
    fn it_is_bounded() {
        let mut line = FaultyBytes::new(&FaultPlan { delay_secs: 1.0, ..FaultPlan::default() }).unwrap();
        for _ in 0..=MAX_BYTES / 1000 {
            line.push(Duration::ZERO, &[0; 1000]);
        }
        let mut out = Vec::new();
        line.pop(Duration::from_secs(1), &mut out);
        assert_eq!(out.len(), MAX_BYTES);
    }
}
