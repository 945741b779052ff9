//! Which finger plays which key, and where the rail is: dynamic programming over the song.
//!
//! A state is what sounds in one control step: a key or none for each finger, and a rail position
//! from which the fingers reach their keys. The cost is the number of control steps of notes that
//! are lost, which is close to what F1 measures: a skipped note costs all its steps, a rail or
//! finger that is too slow costs the end of the note before. A skipped note also costs its onset,
//! so that a melody is not left out for one long note below it, and so does a note of which too
//! little is left to be struck. Additional costs prefer the upper voice, fingers that no neighbour
//! blocks, unturned fingers and short movements.

use etude_music::key_is_black;
use etude_stage::FINGERS;
use etude_stage::geometry::HALF_WIDTH;

use super::hand_reach::{HandReach, LATERAL_REACH_M, TURN_FIRST_M};
use super::rail_model::RailModel;
use super::strokes::{Onset, Stroke, Strokes};
use super::unplayed_notes::{UnplayedNote, UnplayedNotes, UnplayedReason};

/// Smallest distance of two neighbouring fingers that press at once, m: the width of a finger's
/// links.
const MIN_SEPARATION_M: f64 = 0.021;
/// Silent control steps that a finger needs between a white key and a black one: up, across the
/// edge, down.
const BLACK_CHANGE_STEPS: usize = 6;
/// Rail positions tried for one choice of fingers.
const RAIL_CHOICES: usize = 9;
/// States kept at each onset.
const BEAM: usize = 96;
/// Keys considered at one onset: many more than fingers, so that fingers can reach some of them
/// together.
const MAX_KEYS: usize = 10;
/// Cost of an onset that is skipped, in control steps.
const ONSET_COST: f64 = 4.0;
/// Further cost of skipping the highest note of those that begin together, in control steps: the
/// melody is mostly there.
const UPPER_COST: f64 = 0.5;
/// Shortest note that a finger can strike if it has to move on at once, in control steps.
const MIN_NOTE_STEPS: usize = 2;
/// Cost of a finger turned to the end of its lateral reach, in control steps.
const TURN_COST: f64 = 0.1;
/// Cost of a strike by a finger that a neighbour blocks, in control steps. The scripted baseline
/// strikes such a note a step late, policies on time: so it costs a little less than a note that
/// ends a step early.
const BLOCKED_COST: f64 = 0.95;
/// Cost of a metre of rail, in control steps.
const TRAVEL_COST: f64 = 3.0;

/// The stroke that each finger plays.
type FingerStrokes = [Option<usize>; FINGERS];

/// A state: what the hand plays at one onset, and where it is.
#[derive(Clone, Debug)]
pub(super) struct OnsetState {
    pub hand: FingerStrokes,
    /// The rail, m.
    pub rail: f64,
    /// Rail positions from which the fingers reach their keys, m.
    pub rail_interval: [f64; 2],
    cost: f64,
}

/// A state with the cost of everything up to it, and the index of the state before it.
type Reached = (OnsetState, f64, usize);

/// What it takes to get from one state to the next.
struct Transition {
    /// Control steps of silence that the rail needs before the next strikes.
    rail_steps: usize,
    /// How far the rail moves in them, m.
    travel: f64,
    /// Control steps of silence that each finger needs to change keys.
    finger_steps: [usize; FINGERS],
    cost: f64,
}

/// The song, and the models of hand and rail.
pub(super) struct FingeringPlanner<'a> {
    reach: &'a HandReach,
    pub rail: &'a RailModel,
    strokes: &'a [Stroke],
    pub onsets: Vec<Onset>,
    /// Notes of the song.
    written: usize,
    /// Silent control steps that a finger needs between two different keys of one colour.
    change_steps: usize,
}

impl<'a> FingeringPlanner<'a> {
    pub(super) fn new(
        reach: &'a HandReach,
        rail: &'a RailModel,
        strokes: &'a Strokes,
        change_steps: usize,
    ) -> Self {
        let onsets = strokes.onsets();
        Self { reach, rail, strokes: &strokes.strokes, onsets, written: strokes.notes, change_steps }
    }

    /// Lateral position of a stroke's key, m.
    fn lateral(&self, stroke: usize) -> f64 {
        self.reach.over(self.strokes[stroke].key)[1]
    }

    /// The best state for each onset. `on_progress` receives the share of them that is done.
    pub(super) fn plan(&self, on_progress: &mut dyn FnMut(f64)) -> Vec<OnsetState> {
        // One layer for each onset.
        let mut layers: Vec<Vec<Reached>> = Vec::with_capacity(self.onsets.len());
        for (index, onset) in self.onsets.iter().enumerate() {
            let states = self.states(onset).into_iter();
            let mut layer: Vec<Reached> = match layers.last() {
                None => states.map(|state| self.opening(onset, state)).collect(),
                Some(before) => states.filter_map(|state| self.best(before, index, state)).collect(),
            };
            layer.sort_by(|a, b| a.1.total_cmp(&b.1));
            layer.truncate(BEAM);
            layers.push(layer);
            on_progress((index + 1) as f64 / self.onsets.len() as f64);
        }
        let mut chosen = 0;
        let mut plan = Vec::with_capacity(layers.len());
        for layer in layers.into_iter().rev() {
            // No layer is empty: the state in which no finger plays can always be reached.
            let Some((state, _, before)) = layer.into_iter().nth(chosen) else { break };
            plan.push(state);
            chosen = before;
        }
        plan.reverse();
        plan
    }

    fn opening(&self, onset: &Onset, state: OnsetState) -> Reached {
        let distance = (state.rail - self.rail.start).abs();
        let late = self.rail.steps_to(distance, distance).saturating_sub(onset.start);
        let cost = state.cost + late as f64 + TRAVEL_COST * distance;
        (state, cost, 0)
    }

    fn best(&self, layer: &[Reached], index: usize, to: OnsetState) -> Option<Reached> {
        let costs = layer.iter().enumerate().filter_map(|(before, (from, cost, _))| {
            self.transition(index - 1, from, &to).map(|transition| (before, cost + transition.cost))
        });
        let (before, cost) = costs.min_by(|a, b| a.1.total_cmp(&b.1))?;
        let cost = cost + to.cost;
        Some((to, cost, before))
    }

    /// All states in which fingers play some of the strokes that sound at `onset`.
    fn states(&self, onset: &Onset) -> Vec<OnsetState> {
        let sounding = &onset.sounding;
        let hands = self.hands(&sounding[..sounding.len().min(MAX_KEYS)]);
        let mut states = Vec::with_capacity(hands.len() * RAIL_CHOICES);
        for hand in hands {
            let interval @ [low, high] = self.rail_interval(&hand);
            if low > high {
                continue;
            }
            let beginning = sounding.iter().filter(|stroke| self.strokes[**stroke].start == onset.start);
            let highest = beginning.clone().max_by_key(|stroke| self.strokes[**stroke].key);
            let skipped: f64 = beginning
                .filter(|stroke| !hand.contains(&Some(**stroke)))
                .map(|stroke| {
                    let Stroke { start, end, .. } = self.strokes[*stroke];
                    (end - start) as f64 + ONSET_COST + if Some(stroke) == highest { UPPER_COST } else { 0.0 }
                })
                .sum();
            for choice in 0..RAIL_CHOICES {
                let rail = low + (high - low) * choice as f64 / (RAIL_CHOICES - 1) as f64;
                let turn = |finger: usize, stroke: usize| {
                    let [low, high] = self.reach.rail_interval(finger, self.strokes[stroke].key);
                    ((rail - (low + high) / 2.0) / LATERAL_REACH_M).powi(2)
                };
                let turned: f64 = hand.iter().enumerate().filter_map(|(f, s)| s.map(|s| turn(f, s))).sum();
                let cost = skipped + TURN_COST * turned;
                states.push(OnsetState { hand, rail, rail_interval: interval, cost });
            }
        }
        states
    }

    /// All choices of strokes for the fingers.
    fn hands(&self, strokes: &[usize]) -> Vec<FingerStrokes> {
        let mut hands = Vec::new();
        self.add_hands(strokes, 0, [None; FINGERS], &mut hands);
        hands
    }

    fn add_hands(
        &self,
        strokes: &[usize],
        finger: usize,
        hand: FingerStrokes,
        found: &mut Vec<FingerStrokes>,
    ) {
        if finger == FINGERS {
            found.push(hand);
            return;
        }
        self.add_hands(strokes, finger + 1, hand, found);
        for stroke in strokes {
            let apart =
                |other: &usize| (self.lateral(*stroke) - self.lateral(*other)).abs() >= MIN_SEPARATION_M;
            if hand.iter().flatten().all(apart) {
                let mut hand = hand;
                hand[finger] = Some(*stroke);
                self.add_hands(strokes, finger + 1, hand, found);
            }
        }
    }

    fn rail_interval(&self, hand: &FingerStrokes) -> [f64; 2] {
        let intervals = hand.iter().enumerate().filter_map(|(finger, stroke)| {
            stroke.map(|stroke| self.reach.rail_interval(finger, self.strokes[stroke].key))
        });
        intervals.fold([-HALF_WIDTH, HALF_WIDTH], |all, [low, high]| [all[0].max(low), all[1].min(high)])
    }

    /// What it takes to get from a state at onset `index` to one at the next; `None` if a held note
    /// would change fingers or a note would begin late.
    fn transition(&self, index: usize, from: &OnsetState, to: &OnsetState) -> Option<Transition> {
        let step = self.onsets[index + 1].start;
        let kept = |finger: usize| to.hand[finger].is_some() && to.hand[finger] == from.hand[finger];
        let held = |stroke: usize| self.strokes[stroke].start < step;
        if (0..FINGERS).any(|f| to.hand[f].is_some_and(held) && !kept(f)) {
            return None;
        }
        let ending = || (0..FINGERS).filter(|f| !kept(*f)).filter_map(|f| from.hand[f].map(|s| (f, s)));
        let released = |stroke: usize| self.strokes[stroke].end.min(step);
        let cut_off: usize = ending().map(|(_, s)| self.strokes[s].end.saturating_sub(step)).sum();

        let waiting = to.rail.clamp(from.rail_interval[0], from.rail_interval[1]);
        let travel = (to.rail - waiting).abs();
        let needed = (to.rail_interval[0] - waiting).max(waiting - to.rail_interval[1]).max(0.0);
        let last = ending().map(|(_, stroke)| released(stroke)).max();
        let head_start = self.rail.early_steps + last.map_or(step - self.onsets[index].start, |_| 0);
        let rail_steps = self.rail.steps_to(travel, needed).saturating_sub(head_start);

        let mut finger_steps = [0; FINGERS];
        for (finger, stroke) in ending() {
            let key = self.strokes[stroke].key;
            if let Some(next) = to.hand[finger].map(|next| self.strokes[next].key).filter(|next| *next != key)
            {
                let crosses = key_is_black(next) != key_is_black(key);
                finger_steps[finger] =
                    if crosses { BLACK_CHANGE_STEPS.max(self.change_steps) } else { self.change_steps };
            }
            // The finger must move away before a neighbour comes down right beside it.
            let y = self.lateral(stroke);
            let near = |other: usize| (self.lateral(other) - y).abs() < MIN_SEPARATION_M;
            if (0..FINGERS).any(|f| f != finger && !kept(f) && to.hand[f].is_some_and(near)) {
                finger_steps[finger] = finger_steps[finger].max(self.change_steps);
            }
        }
        let lost: f64 = ending()
            .map(|(finger, stroke)| {
                let gap = step - released(stroke);
                let lost = rail_steps.max(finger_steps[finger]).saturating_sub(gap);
                // If too little is left of the note, it or the next strike is missed.
                let left = (released(stroke) - self.strokes[stroke].start).saturating_sub(lost);
                let late = lost > 0 && left < MIN_NOTE_STEPS;
                // As much as the most that a skipped note costs, so that skipping is never worse.
                lost as f64 + if late { ONSET_COST + UPPER_COST } else { 0.0 }
            })
            .sum();
        // Whether a neighbour that plays is in the path of a finger to its next key.
        let blocked = |finger: usize| {
            let Some(next) = to.hand[finger].filter(|_| !kept(finger)) else { return false };
            let over = self.reach.over(self.strokes[next].key);
            (0..FINGERS).filter(|other| other.abs_diff(finger) == 1).any(|other| {
                let Some(stroke) = from.hand[other].filter(|stroke| released(*stroke) == step) else {
                    return false;
                };
                let clear = self.reach.clear_of(finger, over, other, self.lateral(stroke));
                (clear - over[1]).abs() > TURN_FIRST_M
            })
        };
        let blocked = (0..FINGERS).filter(|finger| blocked(*finger)).count();
        let cost =
            lost + cut_off as f64 + BLOCKED_COST * blocked as f64 + TRAVEL_COST * (to.rail - from.rail).abs();
        Some(Transition { rail_steps, travel, finger_steps, cost })
    }

    /// Why a stroke of an onset is played by no finger, where others are as `played`.
    fn why_skipped(&self, stroke: &Stroke, onset: &Onset, played: &[PlannedNote]) -> UnplayedReason {
        let all = onset.sounding.len();
        if all > FINGERS {
            return UnplayedReason::TooManyKeys;
        }
        let together = self.hands(&onset.sounding).iter().any(|hand| {
            let [low, high] = self.rail_interval(hand);
            hand.iter().flatten().count() == all && low <= high
        });
        let nearest = played.iter().min_by_key(|note| note.start.abs_diff(stroke.start));
        match nearest.filter(|note| together && note.key != stroke.key) {
            None => UnplayedReason::OutOfReach,
            Some(note) => {
                let [from, to] = [note.key, stroke.key].map(|key| self.reach.over(key)[1]);
                UnplayedReason::TooFar(note.key, (from - to).abs())
            }
        }
    }

    /// Every note that the plan plays, in order of their start; each ends when its finger must move
    /// on.
    pub(super) fn played(&self, plan: &[OnsetState]) -> Vec<PlannedNote> {
        let mut notes: Vec<PlannedNote> = Vec::new();
        for (index, (onset, state)) in self.onsets.iter().zip(plan).enumerate() {
            for (finger, stroke) in state.hand.iter().enumerate() {
                let Some(stroke) = *stroke else { continue };
                let Stroke { key, start, end, velocity } = self.strokes[stroke];
                if start == onset.start {
                    notes.push(PlannedNote { finger, key, start, end, velocity, cut: None, stroke });
                }
            }
            let Some(next) = plan.get(index + 1) else { break };
            let Some(transition) = self.transition(index, state, next) else { continue };
            let Transition { rail_steps, travel, finger_steps, .. } = transition;
            let step = self.onsets[index + 1].start;
            for (finger, stroke) in state.hand.iter().enumerate() {
                if stroke.is_none() || *stroke == next.hand[finger] {
                    continue;
                }
                let Some(note) = notes.iter_mut().rfind(|note| Some(note.stroke) == *stroke) else {
                    continue;
                };
                let needed = rail_steps.max(finger_steps[finger]);
                let kind = match needed {
                    0 => UnplayedReason::HandNeeded,
                    _ if rail_steps >= finger_steps[finger] => UnplayedReason::RailTooSlow(travel),
                    _ => UnplayedReason::FingerBusy,
                };
                let end = note.end.min(step.saturating_sub(needed)).max(note.start + 1);
                if end < note.end {
                    note.end = end;
                    note.cut = Some(kind);
                }
            }
        }
        notes
    }

    /// The notes that are not played as written.
    pub(super) fn unplayed(&self, played: &[PlannedNote]) -> UnplayedNotes {
        // Keys that are due without a note are made by tests only.
        let total_notes = self.written.max(self.strokes.len());
        let merged_notes = total_notes - self.strokes.len();
        let mut unplayed = UnplayedNotes { total_notes, merged_notes, ..UnplayedNotes::default() };
        for (index, stroke) in self.strokes.iter().enumerate() {
            let note = played.iter().find(|note| note.stroke == index);
            let onset = self.onsets.iter().find(|onset| onset.start == stroke.start);
            let reason = match note {
                Some(note) => note.cut,
                None => onset.map(|onset| self.why_skipped(stroke, onset, played)),
            };
            if let Some(reason) = reason {
                let lost_steps = stroke.end - note.map_or(stroke.start, |note| note.end);
                unplayed.notes.push(UnplayedNote { reason, key: stroke.key, step: stroke.start, lost_steps });
            }
        }
        let is_quick_restrike = |note: &&PlannedNote| {
            let ends_before =
                |other: &&PlannedNote| other.finger == note.finger && other.end + 1 == note.start;
            played.iter().find(ends_before).is_some_and(|before| before.key == note.key)
        };
        unplayed.quick_restrikes = played.iter().filter(is_quick_restrike).count();
        unplayed
    }
}

/// A note as it will be played.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannedNote {
    /// The finger that plays it.
    pub finger: usize,
    /// The key (0 is the lowest C).
    pub key: usize,
    /// Control step of its beginning.
    pub start: usize,
    /// Control step after its last.
    pub end: usize,
    /// Its MIDI velocity.
    pub velocity: u8,
    /// Why it ends early, if it does.
    pub cut: Option<UnplayedReason>,
    pub(super) stroke: usize,
}
