//! The fingering of a song: which finger plays which key, and where the hand is.
//!
//! It is planned for the whole song in advance: strokes from the frames (`strokes`), then fingers and places of the rail by dynamic
//! programming (`planner`, with the models `comb` of the fingers and `rail` of the rail). The scripted baseline plays it; a policy can
//! be shown it ([`TaskConfig::fingering`](crate::TaskConfig::fingering)).

pub(crate) mod comb;
mod limits;
pub(crate) mod planner;
mod poses;
pub(crate) mod rail;
mod strokes;

use etude_stage::{FINGERS, PHYSICS_STEPS, PhysicalParams, StageConfig};

use crate::Piece;
use comb::Comb;
use planner::{Place, Planner};
use rail::Rail;
use strokes::Slice;

pub use limits::{Limit, LimitKind, Limits};
pub use planner::Played;
pub use poses::{Fingers, Poses};

/// Control steps before the beginning of a note from which its key is the goal of its finger: half a second, enough for every
/// move of the fingers and most of the rail.
pub const AHEAD_STEPS: usize = 10;

/// The key at which a finger should be in one control step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// The key (0 is the lowest C).
    pub key: usize,
    /// Place `[x, y]` for the centre of the fingertip, m.
    pub over: [f64; 2],
    /// Control steps until the note begins; 0 while it sounds.
    pub wait_steps: usize,
    /// Control steps since the note began; 0 before.
    pub age_steps: usize,
    /// MIDI velocity of the note.
    pub velocity: u8,
}

impl Goal {
    /// Whether the note begins in this step.
    pub fn begins(&self) -> bool {
        self.wait_steps == 0 && self.age_steps == 0
    }
}

/// The goal of each finger in one control step, if it has one.
pub type Goals = [Option<Goal>; FINGERS];

/// The fingering of a song.
#[derive(Clone, Debug, PartialEq)]
pub struct Fingering {
    notes: Vec<Played>,
    rail: Vec<f64>,
    goals: Vec<Goals>,
    limits: Limits,
    poses: Option<Poses>,
    rail_range: f64,
}

impl Fingering {
    /// Plans `piece` for this stage with these physical numbers and this number of silent control steps in which a finger changes keys.
    /// `tell` receives the share that is planned, 0 to 1: a long piece takes time.
    pub fn plan(
        stage: &StageConfig,
        params: &PhysicalParams,
        change_steps: usize,
        piece: &Piece,
        on_progress: &mut dyn FnMut(f64),
    ) -> Self {
        let strokes = strokes::strokes(piece.frames(), piece.notes(), piece.latency_compensation_secs());
        let slices = strokes::slices(&strokes);
        let comb = Comb::new(stage.side, params);
        let rail = Rail::new(stage, params);
        let planner = Planner { comb: &comb, rail: &rail, strokes: &strokes, slices: &slices, change_steps };
        let places = planner.plan(on_progress);
        let notes = planner::played(&planner, &places);
        let limits = planner::limits(&planner, &notes, piece.notes().len());
        let rail = rail_places(rail.lead_steps, &slices, &places, &notes, piece.steps());
        let goals = goals(&comb, &notes, piece.steps());
        Self { notes, rail, goals, limits, poses: None, rail_range: 0.0 }
    }

    /// The same with targets of the rail so far from its planned place, m.
    #[must_use]
    pub fn within(self, rail_range: f64) -> Self {
        Self { rail_range, ..self }
    }

    /// How far the target of the rail may be from its planned place, m.
    pub fn rail_range(&self) -> f64 {
        self.rail_range
    }

    /// The same fingering, whose actions mean targets of finger joints at most `range` (rad) from the pose that holds the fingertips over
    /// their goals.
    pub(crate) fn around_poses(self, stage: &StageConfig, params: &PhysicalParams, range: f64) -> Self {
        // Where the rail really is at the end of each control step: it is slower than the fingers.
        let rail = Rail::new(stage, params);
        let path: Vec<f64> =
            rail.follow(rail.start, &self.rail).into_iter().step_by(PHYSICS_STEPS).skip(1).collect();
        let angles = poses::over_goals(&Comb::new(stage.side, params), params, &self.goals, &path);
        Self { poses: Some(Poses { range, angles }), ..self }
    }

    /// The poses around which the targets of the fingers are, if they are around poses.
    pub fn poses(&self) -> Option<&Poses> {
        self.poses.as_ref()
    }

    /// The notes as the fingers play them, in order of their beginning.
    pub fn notes(&self) -> &[Played] {
        &self.notes
    }

    /// Target of the rail in each control step, m.
    pub fn rail(&self) -> &[f64] {
        &self.rail
    }

    /// Target of the rail in control step `step`; after the end, that of the last, m.
    pub fn rail_at(&self, step: usize) -> f64 {
        self.rail.get(step).or(self.rail.last()).copied().unwrap_or(0.0)
    }

    /// The goals of the fingers in control step `step`; none after the end.
    pub fn goals(&self, step: usize) -> Goals {
        self.goals.get(step).copied().unwrap_or_default()
    }

    /// The notes that are not played as written.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }
}

/// Target of the rail at each of `steps` control steps, m. The rail leaves as early as the keys that are held allow, `lead_steps`
/// before the release.
fn rail_places(
    lead_steps: usize,
    slices: &[Slice],
    places: &[Place],
    notes: &[Played],
    steps: usize,
) -> Vec<f64> {
    let Some(first) = places.first() else { return vec![0.0; steps] };
    let mut targets = vec![first.rail; steps];
    for (index, place) in places.iter().enumerate() {
        let Some(next) = places.get(index + 1) else { break };
        let (start, end) = (slices[index].start, slices[index + 1].start);
        let ending = notes.iter().filter(|note| {
            place.hand.contains(&Some(note.stroke)) && !next.hand.contains(&Some(note.stroke))
        });
        let released = ending.map(|note| note.end).max().unwrap_or(start);
        let leave = released.saturating_sub(lead_steps).max(start);
        let waiting = next.rail.clamp(place.tube[0], place.tube[1]);
        targets[start.min(steps)..leave.min(steps)].fill(waiting);
        targets[leave.min(steps)..].fill(next.rail);
        debug_assert!(leave <= end);
    }
    targets
}

/// A finger's goal is the key that it plays or, from [`AHEAD_STEPS`] before, the next one.
fn goals(comb: &Comb, notes: &[Played], steps: usize) -> Vec<Goals> {
    let mut goals = vec![Goals::default(); steps];
    for note in notes {
        let first = note.start.saturating_sub(AHEAD_STEPS);
        for (step, goals) in goals.iter_mut().enumerate().take(note.end).skip(first) {
            let wait_steps = note.start.saturating_sub(step);
            let goal = &mut goals[note.finger];
            if goal.is_none_or(|goal| goal.wait_steps > wait_steps) {
                let (key, velocity) = (note.key, note.velocity);
                let age_steps = step.saturating_sub(note.start);
                *goal = Some(Goal { key, over: comb.over(key), wait_steps, age_steps, velocity });
            }
        }
    }
    goals
}
