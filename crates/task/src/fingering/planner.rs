//! Which finger plays which key, and where the rail is: dynamic programming over the song.
//!
//! A state is what sounds at one moment: a key or none for each finger, and a rail position from which the fingers reach their keys.
//! The cost is the number of control steps of notes that are lost, which is close to what F1 measures: a skipped note costs all its
//! steps, a rail or finger that is too slow costs the end of the note before. A skipped note also costs its onset, so that a melody is
//! not left out for one long note below it, and so does a note of which too little is left to be struck. Additional costs prefer the upper voice, fingers that no neighbour bars, unturned fingers
//! and short movements.

use etude_music::key_is_black;
use etude_stage::FINGERS;
use etude_stage::geometry::HALF_WIDTH;

use super::comb::{ASIDE_M, Comb, PLAY_M};
use super::limits::{Limit, LimitKind, Limits};
use super::rail::Rail;
use super::strokes::{Slice, Stroke};

/// Least distance of two neighbouring fingers that press at once, m: the width of a finger's links.
const SEPARATION_M: f64 = 0.021;
/// Silent control steps that a finger needs at least between a white key and a black one: up, across the edge, down.
const BLACK_CHANGE_STEPS: usize = 6;
/// Rail positions tried for one choice of fingers.
const RAIL_CHOICES: usize = 9;
/// States kept at each moment.
const BEAM: usize = 96;
/// Keys considered at one moment: many more than fingers, so that fingers can reach some of them together.
const MOST_KEYS: usize = 10;
/// Cost of an onset that is skipped, in control steps.
const ONSET_COST: f64 = 4.0;
/// Further cost of skipping the highest note of those that begin together, in control steps: the melody is mostly there.
const UPPER_COST: f64 = 0.5;
/// Shortest note that a finger that has to hurry on can strike, in control steps.
const SHORTEST_STEPS: usize = 2;
/// Cost of a finger turned to the end of its play, in control steps.
const TURN_COST: f64 = 0.1;
/// Cost of a strike by a finger whose way is barred by a neighbour, in control steps. The scripted baseline strikes such a note a step
/// late, policies on time: so it costs a little less than a note that ends a step early.
const BARRED_COST: f64 = 0.95;
/// Cost of a metre of rail, in control steps.
const TRAVEL_COST: f64 = 3.0;

/// A state: what the hand plays at one moment, and where it is.
#[derive(Clone, Debug)]
pub(crate) struct Place {
    /// The stroke that each finger plays.
    pub hand: [Option<usize>; FINGERS],
    /// The rail, m.
    pub rail: f64,
    /// Rail positions from which the fingers reach their keys, m.
    pub tube: [f64; 2],
    cost: f64,
}

/// What it takes to get from one place to the next.
pub(crate) struct Change {
    /// Control steps of silence that the rail needs before the next strikes.
    pub rail_steps: usize,
    /// How far the rail moves in them, m.
    pub travel: f64,
    /// Control steps of silence that each finger needs to change keys.
    pub finger_steps: [usize; FINGERS],
    cost: f64,
}

/// The song, and the models of hand and rail.
pub(crate) struct Planner<'a> {
    pub comb: &'a Comb,
    pub rail: &'a Rail,
    pub strokes: &'a [Stroke],
    pub slices: &'a [Slice],
    /// Silent control steps that a finger needs between two different keys of one colour.
    pub change_steps: usize,
}

impl Planner<'_> {
    /// The best place for each slice. Tells what share of them is done.
    pub(crate) fn plan(&self, on_progress: &mut dyn FnMut(f64)) -> Vec<Place> {
        // One layer a slice: the places kept, each with its cost so far and the place before it.
        let mut layers: Vec<Vec<(Place, f64, usize)>> = Vec::with_capacity(self.slices.len());
        for (index, slice) in self.slices.iter().enumerate() {
            let places = self.places(slice);
            let mut layer: Vec<(Place, f64, usize)> = match layers.last() {
                None => places.into_iter().map(|place| self.opening(slice, place)).collect(),
                Some(before) => {
                    let reached = places.into_iter().filter_map(|place| self.best(before, index, place));
                    reached.collect()
                }
            };
            layer.sort_by(|a, b| a.1.total_cmp(&b.1));
            layer.truncate(BEAM);
            layers.push(layer);
            on_progress((index + 1) as f64 / self.slices.len() as f64);
        }
        let mut chosen = 0;
        let mut plan = Vec::with_capacity(layers.len());
        for layer in layers.into_iter().rev() {
            // No layer is empty: the state in which no finger plays can always be reached.
            let Some((place, _, before)) = layer.into_iter().nth(chosen) else { break };
            plan.push(place);
            chosen = before;
        }
        plan.reverse();
        plan
    }

    fn opening(&self, slice: &Slice, place: Place) -> (Place, f64, usize) {
        let way = (place.rail - self.rail.start).abs();
        let late = self.rail.steps_to(way, way).saturating_sub(slice.start);
        let cost = place.cost + late as f64 + TRAVEL_COST * way;
        (place, cost, 0)
    }

    fn best(&self, layer: &[(Place, f64, usize)], index: usize, to: Place) -> Option<(Place, f64, usize)> {
        let costs = layer.iter().enumerate().filter_map(|(before, (from, cost, _))| {
            self.change(index - 1, from, &to).map(|change| (before, cost + change.cost))
        });
        let (before, cost) = costs.min_by(|a, b| a.1.total_cmp(&b.1))?;
        let cost = cost + to.cost;
        Some((to, cost, before))
    }

    /// Every way to play some of the strokes that sound in `slice`.
    fn places(&self, slice: &Slice) -> Vec<Place> {
        let mut hands = Vec::new();
        let keys = &slice.sounding[..slice.sounding.len().min(MOST_KEYS)];
        self.hands(keys, 0, [None; FINGERS], &mut hands);
        let mut places = Vec::with_capacity(hands.len() * RAIL_CHOICES);
        for hand in hands {
            let tube = self.tube(&hand);
            if tube[0] > tube[1] {
                continue;
            }
            let fresh = slice.sounding.iter().filter(|stroke| self.strokes[**stroke].start == slice.start);
            let highest = fresh.clone().max_by_key(|stroke| self.strokes[**stroke].key);
            let skipped = fresh.filter(|stroke| !hand.contains(&Some(**stroke)));
            let skipped: f64 = skipped
                .map(|stroke| {
                    let Stroke { start, end, .. } = self.strokes[*stroke];
                    (end - start) as f64 + ONSET_COST + if Some(stroke) == highest { UPPER_COST } else { 0.0 }
                })
                .sum();
            for choice in 0..RAIL_CHOICES {
                let rail = tube[0] + (tube[1] - tube[0]) * choice as f64 / (RAIL_CHOICES - 1) as f64;
                let turn = |finger: usize, stroke: usize| {
                    let [low, high] = self.comb.tube(finger, self.strokes[stroke].key);
                    ((rail - (low + high) / 2.0) / PLAY_M).powi(2)
                };
                let turned: f64 = hand.iter().enumerate().filter_map(|(f, s)| s.map(|s| turn(f, s))).sum();
                places.push(Place { hand, rail, tube, cost: skipped + TURN_COST * turned });
            }
        }
        places
    }

    fn hands(
        &self,
        keys: &[usize],
        finger: usize,
        hand: [Option<usize>; FINGERS],
        found: &mut Vec<[Option<usize>; FINGERS]>,
    ) {
        if finger == FINGERS {
            found.push(hand);
            return;
        }
        self.hands(keys, finger + 1, hand, found);
        for stroke in keys {
            let key = self.strokes[*stroke].key;
            let apart = |other: usize| {
                let [from, to] = [key, self.strokes[other].key].map(|key| self.comb.over(key)[1]);
                (from - to).abs() >= SEPARATION_M
            };
            if hand.iter().flatten().all(|other| apart(*other)) {
                let mut hand = hand;
                hand[finger] = Some(*stroke);
                self.hands(keys, finger + 1, hand, found);
            }
        }
    }

    fn tube(&self, hand: &[Option<usize>; FINGERS]) -> [f64; 2] {
        let tubes = hand.iter().enumerate().filter_map(|(finger, stroke)| {
            stroke.map(|stroke| self.comb.tube(finger, self.strokes[stroke].key))
        });
        tubes.fold([-HALF_WIDTH, HALF_WIDTH], |tube, [low, high]| [tube[0].max(low), tube[1].min(high)])
    }

    /// What it takes to get from a place at slice `index` to one at the next; `None` if a held note would change fingers or a note
    /// would begin late.
    pub(crate) fn change(&self, index: usize, from: &Place, to: &Place) -> Option<Change> {
        let step = self.slices[index + 1].start;
        let kept = |finger: usize| to.hand[finger].is_some() && to.hand[finger] == from.hand[finger];
        let held = |stroke: usize| self.strokes[stroke].start < step;
        if (0..FINGERS).any(|f| to.hand[f].is_some_and(held) && !kept(f)) {
            return None;
        }
        let ending = || (0..FINGERS).filter(|f| !kept(*f)).filter_map(|f| from.hand[f].map(|s| (f, s)));
        let released = |stroke: usize| self.strokes[stroke].end.min(step);
        let given_up: usize = ending().map(|(_, s)| self.strokes[s].end.saturating_sub(step)).sum();

        let waiting = to.rail.clamp(from.tube[0], from.tube[1]);
        let travel = (to.rail - waiting).abs();
        let needed = (to.tube[0] - waiting).max(waiting - to.tube[1]).max(0.0);
        let last = ending().map(|(_, stroke)| released(stroke)).max();
        let head_start = self.rail.lead_steps + last.map_or(step - self.slices[index].start, |_| 0);
        let rail_steps = self.rail.steps_to(travel, needed).saturating_sub(head_start);

        let mut finger_steps = [0; FINGERS];
        for (finger, stroke) in ending() {
            let next = to.hand[finger].map(|next| self.strokes[next].key);
            if next.is_some_and(|next| next != self.strokes[stroke].key) {
                let black = [next, Some(self.strokes[stroke].key)]
                    .into_iter()
                    .flatten()
                    .filter(|key| key_is_black(*key));
                let crosses = black.count() == 1;
                finger_steps[finger] =
                    if crosses { BLACK_CHANGE_STEPS.max(self.change_steps) } else { self.change_steps };
            }
            // The finger must move away before a neighbour comes down right beside it.
            let y = self.comb.over(self.strokes[stroke].key)[1];
            let near = |other: usize| {
                let key = self.strokes[other].key;
                (self.comb.over(key)[1] - y).abs() < SEPARATION_M
            };
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
                let late = lost > 0 && left < SHORTEST_STEPS;
                // As much as the most that a skipped note costs, so that skipping is never worse.
                lost as f64 + if late { ONSET_COST + UPPER_COST } else { 0.0 }
            })
            .sum();
        // Whether a neighbour that plays bars a finger's way to its next key (`ASIDE_M`).
        let barred = |finger: usize| {
            let Some(next) = to.hand[finger].filter(|_| !kept(finger)) else { return false };
            let place = self.comb.over(self.strokes[next].key);
            (0..FINGERS).filter(|other| other.abs_diff(finger) == 1).any(|other| {
                let Some(stroke) = from.hand[other].filter(|stroke| released(*stroke) == step) else {
                    return false;
                };
                let theirs = self.comb.over(self.strokes[stroke].key)[1];
                (self.comb.beside(finger, place, other, theirs) - place[1]).abs() > ASIDE_M
            })
        };
        let barred = (0..FINGERS).filter(|finger| barred(*finger)).count();
        let cost =
            lost + given_up as f64 + BARRED_COST * barred as f64 + TRAVEL_COST * (to.rail - from.rail).abs();
        Some(Change { rail_steps, travel, finger_steps, cost })
    }

    /// Why a stroke of a slice is played by no finger, where others are as `played`.
    pub(crate) fn why_skipped(&self, stroke: &Stroke, slice: &Slice, played: &[Played]) -> LimitKind {
        let all = slice.sounding.len();
        if all > FINGERS {
            return LimitKind::TooManyKeys;
        }
        let mut hands = Vec::new();
        self.hands(&slice.sounding, 0, [None; FINGERS], &mut hands);
        let together = hands.iter().any(|hand| {
            let tube = self.tube(hand);
            hand.iter().flatten().count() == all && tube[0] <= tube[1]
        });
        let nearest = played.iter().min_by_key(|note| note.start.abs_diff(stroke.start));
        match nearest.filter(|note| together && note.key != stroke.key) {
            None => LimitKind::OutOfReach,
            Some(note) => {
                let [from, to] = [note.key, stroke.key].map(|key| self.comb.over(key)[1]);
                LimitKind::TooFar(note.key, (from - to).abs())
            }
        }
    }
}

/// A note as it will be played.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Played {
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
    pub cut: Option<LimitKind>,
    pub(crate) stroke: usize,
}

/// Every note that the plan plays, in order of their start; each ends when its finger must move on.
pub(crate) fn played(planner: &Planner<'_>, plan: &[Place]) -> Vec<Played> {
    let mut notes: Vec<Played> = Vec::new();
    for (index, (slice, place)) in planner.slices.iter().zip(plan).enumerate() {
        for (finger, stroke) in place.hand.iter().enumerate() {
            let Some(stroke) = *stroke else { continue };
            let Stroke { key, start, end, velocity } = planner.strokes[stroke];
            if start == slice.start {
                notes.push(Played { finger, key, start, end, velocity, cut: None, stroke });
            }
        }
        let Some(next) = plan.get(index + 1) else { break };
        let Some(change) = planner.change(index, place, next) else { continue };
        let step = planner.slices[index + 1].start;
        for (finger, stroke) in place.hand.iter().enumerate() {
            if stroke.is_none() || *stroke == next.hand[finger] {
                continue;
            }
            let Some(note) = notes.iter_mut().rfind(|note| Some(note.stroke) == *stroke) else { continue };
            let needed = change.rail_steps.max(change.finger_steps[finger]);
            let kind = match needed {
                0 => LimitKind::GivenUp,
                _ if change.rail_steps >= change.finger_steps[finger] => {
                    LimitKind::RailTooSlow(change.travel)
                }
                _ => LimitKind::FingerBusy,
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

/// Lists the notes that are not played as written, of `written` notes.
pub(crate) fn limits(planner: &Planner<'_>, played: &[Played], written: usize) -> Limits {
    // Keys that are due without a note are made by tests only.
    let total_notes = written.max(planner.strokes.len());
    let merged_notes = total_notes - planner.strokes.len();
    let mut limits = Limits { total_notes, merged_notes, ..Limits::default() };
    for (index, stroke) in planner.strokes.iter().enumerate() {
        let note = played.iter().find(|note| note.stroke == index);
        let slice = planner.slices.iter().find(|slice| slice.start == stroke.start);
        let kind = match note {
            Some(note) => note.cut,
            None => slice.map(|slice| planner.why_skipped(stroke, slice, played)),
        };
        if let Some(kind) = kind {
            let lost_steps = stroke.end - note.map_or(stroke.start, |note| note.end);
            limits.notes.push(Limit { kind, key: stroke.key, step: stroke.start, lost_steps });
        }
    }
    limits.quick_restrikes = played
        .iter()
        .filter(|note| {
            let again = |other: &&Played| other.finger == note.finger && other.end + 1 == note.start;
            played.iter().find(again).is_some_and(|before| before.key == note.key)
        })
        .count();
    limits
}
