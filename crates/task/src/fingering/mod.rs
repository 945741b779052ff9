//! The fingering of a song: which finger plays which key, and where the hand is.
//!
//! It is planned for the whole song in advance: strokes from the frames (`strokes`), then fingers
//! and rail positions by dynamic programming (`planner`, with `hand_reach` for the fingers and
//! `rail_model` for the rail). The scripted baseline plays it; a policy can be shown it
//! ([`TaskConfig::fingering`](crate::TaskConfig::fingering)).

mod goal;
pub(crate) mod hand_reach;
mod planner;
mod poses;
pub(crate) mod rail_model;
mod strokes;
mod unplayed_notes;

use etude_stage::{PHYSICS_STEPS, PhysicalParams, StageConfig};

pub use goal::{AHEAD_STEPS, Goal, Goals};
use hand_reach::HandReach;
pub use planner::PlannedNote;
use planner::{FingeringPlanner, OnsetState};
pub use poses::{FingerAngles, Poses};
use rail_model::RailModel;
pub use strokes::Strokes;
pub use unplayed_notes::{UnplayedNote, UnplayedNotes, UnplayedReason};

/// The fingering of a song.
#[derive(Clone, Debug, PartialEq)]
pub struct Fingering {
    notes: Vec<PlannedNote>,
    rail: Vec<f64>,
    goals: Vec<Goals>,
    unplayed: UnplayedNotes,
    poses: Option<Poses>,
    rail_range: f64,
}

impl Fingering {
    /// Plans `strokes` for this stage with these physical parameters and this number of silent
    /// control steps in which a finger changes keys. `on_progress` receives the share that is
    /// planned, 0 to 1.
    pub fn plan(
        stage: &StageConfig,
        params: &PhysicalParams,
        change_steps: usize,
        strokes: &Strokes,
        on_progress: &mut dyn FnMut(f64),
    ) -> Self {
        let reach = HandReach::new(stage.side, params);
        let rail = RailModel::new(stage, params);
        let planner = FingeringPlanner::new(&reach, &rail, strokes, change_steps);
        let states = planner.plan(on_progress);
        let notes = planner.played(&states);
        let unplayed = planner.unplayed(&notes);
        let rail = rail_targets(&planner, &states, &notes, strokes.steps);
        let goals = goals(&reach, &notes, strokes.steps);
        Self { notes, rail, goals, unplayed, poses: None, rail_range: 0.0 }
    }

    /// The same with targets of the rail so far from its planned position, m.
    #[must_use]
    pub(crate) fn with_rail_range(self, rail_range: f64) -> Self {
        Self { rail_range, ..self }
    }

    /// The same with targets of finger joints at most `range` (rad) from the pose that holds the
    /// fingertips over their goals.
    pub(crate) fn with_poses(self, stage: &StageConfig, params: &PhysicalParams, range: f64) -> Self {
        // Where the rail really is at the end of each control step: it is slower than the fingers.
        let rail = RailModel::new(stage, params);
        let path: Vec<f64> =
            rail.follow(rail.start, &self.rail).into_iter().step_by(PHYSICS_STEPS).skip(1).collect();
        let reach = HandReach::new(stage.side, params);
        let poses = Poses::over_goals(&reach, params, &self.goals, &path, range);
        Self { poses: Some(poses), ..self }
    }

    /// How far the target of the rail may be from its planned position, m.
    pub fn rail_range(&self) -> f64 {
        self.rail_range
    }

    /// The poses around which the targets of the fingers are, if they are around poses.
    pub fn poses(&self) -> Option<&Poses> {
        self.poses.as_ref()
    }

    /// The notes as the fingers play them, in order of their beginning.
    pub fn notes(&self) -> &[PlannedNote] {
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
    pub fn unplayed(&self) -> &UnplayedNotes {
        &self.unplayed
    }
}

/// Target of the rail at each of `steps` control steps, m. The rail leaves as early as the keys
/// that are held allow, some steps before the release.
fn rail_targets(
    planner: &FingeringPlanner<'_>,
    states: &[OnsetState],
    notes: &[PlannedNote],
    steps: usize,
) -> Vec<f64> {
    let Some(first) = states.first() else { return vec![0.0; steps] };
    let mut targets = vec![first.rail; steps];
    for (onset, pair) in planner.onsets.iter().zip(states.windows(2)) {
        let [state, next] = pair else { continue };
        let ending = notes.iter().filter(|note| {
            state.hand.contains(&Some(note.stroke)) && !next.hand.contains(&Some(note.stroke))
        });
        let released = ending.map(|note| note.end).max().unwrap_or(onset.start);
        let leave = released.saturating_sub(planner.rail.early_steps).max(onset.start);
        let waiting = next.rail.clamp(state.rail_interval[0], state.rail_interval[1]);
        targets[onset.start.min(steps)..leave.min(steps)].fill(waiting);
        targets[leave.min(steps)..].fill(next.rail);
    }
    targets
}

/// A finger's goal is the key that it plays or, from [`AHEAD_STEPS`] before, the next one.
fn goals(reach: &HandReach, notes: &[PlannedNote], steps: usize) -> Vec<Goals> {
    let mut goals = vec![Goals::default(); steps];
    for note in notes {
        let first = note.start.saturating_sub(AHEAD_STEPS);
        for (step, goals) in goals.iter_mut().enumerate().take(note.end).skip(first) {
            let wait_steps = note.start.saturating_sub(step);
            let goal = &mut goals[note.finger];
            if goal.is_none_or(|goal| goal.wait_steps > wait_steps) {
                *goal = Some(Goal {
                    key: note.key,
                    over: reach.over(note.key),
                    wait_steps,
                    age_steps: step.saturating_sub(note.start),
                    velocity: note.velocity,
                });
            }
        }
    }
    goals
}
