//! A song in control steps: the keys that are due at each.

use std::sync::Arc;

use etude_music::{CONTROL_HZ, KeySchedule, KeyScheduleConfig, KeySet, Note, Song, SongError};

use crate::fingering::{Fingering, Goals, Strokes};
use crate::{TaskConfig, TaskError};

/// A song in control steps. Cheap to clone: environments share it.
#[derive(Clone, Debug)]
pub struct Piece {
    title: String,
    due: Arc<[KeySet]>,
    robopianist_due: Arc<[KeySet]>,
    notes: Arc<[Note]>,
    bars: Arc<[f64]>,
    latency_compensation_secs: f64,
    fingering: Option<Arc<Fingering>>,
}

impl Piece {
    /// The song by RoboPianist's rules, after `initial_silence_secs` of silence, rounded to whole
    /// control steps.
    ///
    /// # Errors
    /// If a note lies outside the keyboard, or the song is longer than the frames may be.
    pub fn new(song: &Song, initial_silence_secs: f64) -> Result<Self, SongError> {
        Ok(KeyScheduleConfig::default().schedule(song, initial_silence_secs)?.into())
    }

    /// The song as `config` plays it: with its key schedule, after its initial silence and, if it
    /// asks for one, with a fingering for its world.
    ///
    /// # Errors
    /// As [`Piece::new`]; also if a parameter of the schedule or of the physics is out of range.
    pub fn for_task(song: &Song, config: &TaskConfig) -> Result<Self, TaskError> {
        Self::for_task_with_progress(song, config, &mut |_| {})
    }

    /// The same for a song that may be long: `on_progress` receives the share of its fingering that
    /// is planned, 0 to 1.
    ///
    /// # Errors
    /// As [`Piece::for_task`].
    pub fn for_task_with_progress(
        song: &Song,
        config: &TaskConfig,
        on_progress: &mut dyn FnMut(f64),
    ) -> Result<Self, TaskError> {
        let piece = Self::from(config.key_schedule.schedule(song, config.initial_silence_secs)?);
        if !config.fingering {
            return Ok(piece);
        }
        let (stage, params) = (&config.stage, &config.params()?);
        let strokes = piece.strokes();
        let mut fingering = Fingering::plan(stage, params, config.change_steps, &strokes, on_progress)
            .with_rail_range(config.rail_range);
        if config.finger_range > 0.0 {
            fingering = fingering.with_poses(stage, params, config.finger_range);
        }
        Ok(piece.with_fingering(fingering))
    }

    /// `steps` control steps in which no key is due, for motions without a song.
    pub fn silent(steps: usize) -> Self {
        let due: Arc<[KeySet]> = vec![KeySet::EMPTY; steps].into();
        let robopianist_due = due.clone();
        let (title, notes, bars) = (String::new(), [].into(), [].into());
        Self { title, due, robopianist_due, notes, bars, latency_compensation_secs: 0.0, fingering: None }
    }

    /// The same piece with this fingering.
    pub(crate) fn with_fingering(self, fingering: Fingering) -> Self {
        Self { fingering: Some(Arc::new(fingering)), ..self }
    }

    /// Its fingering, if a task asked for one.
    pub fn fingering(&self) -> Option<&Arc<Fingering>> {
        self.fingering.as_ref()
    }

    /// Its strokes, for which a fingering can be planned.
    pub fn strokes(&self) -> Strokes {
        Strokes::new(&self.due, &self.notes, self.latency_compensation_secs)
    }

    /// The keys that its fingering plays in each control step: what is due, less what the hand
    /// cannot do.
    pub fn planned(&self) -> Vec<KeySet> {
        let mut planned = vec![KeySet::EMPTY; self.due.len()];
        for note in self.fingering.iter().flat_map(|fingering| fingering.notes()) {
            let end = note.end.min(planned.len());
            for keys in &mut planned[note.start.min(end)..end] {
                keys.insert(note.key);
            }
        }
        planned
    }

    /// The goals of the fingers in control step `step`; none without a fingering.
    pub fn goals(&self, step: usize) -> Goals {
        self.fingering.as_ref().map(|fingering| fingering.goals(step)).unwrap_or_default()
    }

    /// Target of the rail in control step `step` by the fingering, m; 0 without one.
    pub fn planned_rail(&self, step: usize) -> f64 {
        self.fingering.as_ref().map_or(0.0, |fingering| fingering.rail_at(step))
    }

    /// Title of the song.
    pub fn title(&self) -> &str {
        &self.title
    }

    /// Number of control steps.
    pub fn steps(&self) -> usize {
        self.due.len()
    }

    /// Keys due at control step `step`; none after the end.
    pub fn due(&self, step: usize) -> KeySet {
        self.due.get(step).copied().unwrap_or_default()
    }

    /// Keys to hold in control step `step`: those that are due or, with a fingering, those of them
    /// that it plays then or played one step before: a policy is a step quicker than its plan. With
    /// [`change_steps`](crate::TaskConfig::change_steps) of 1 no silent step is left between two
    /// keys of a finger, and the policy itself has to find the time.
    pub fn held(&self, step: usize) -> KeySet {
        let due = self.due(step);
        let Some(fingering) = &self.fingering else { return due };
        let mut held = KeySet::EMPTY;
        for goals in [fingering.goals(step), fingering.goals(step.saturating_sub(1))] {
            for goal in goals.iter().flatten().filter(|goal| goal.sounds() && due.contains(goal.key)) {
                held.insert(goal.key);
            }
        }
        held
    }

    /// Keys due at every control step.
    pub fn frames(&self) -> &[KeySet] {
        &self.due
    }

    /// Keys due at every control step by RoboPianist's rule, whatever the piece's own.
    pub fn robopianist_frames(&self) -> &[KeySet] {
        &self.robopianist_due
    }

    /// Time by which the notes are later than the keys that are due, s.
    pub fn latency_compensation_secs(&self) -> f64 {
        self.latency_compensation_secs
    }

    /// Time by which a robot that plays this on time is heard later than a simulation, s. In a
    /// simulation a key that is due in a control step goes down half a step after its beginning on
    /// average, and sounds at its end; the rest of the compensation makes up for a robot's lag.
    pub fn late_secs(&self) -> f64 {
        (self.latency_compensation_secs - 0.5 / CONTROL_HZ).max(0.0)
    }

    /// A note at a time of the control steps, at the time that is written for it: earlier by the
    /// latency compensation. Every note that people see or hear is on this axis.
    pub fn as_written(&self, note: Note) -> Note {
        let [start_secs, end_secs] =
            [note.start_secs, note.end_secs].map(|secs| (secs - self.latency_compensation_secs).max(0.0));
        Note { start_secs, end_secs, ..note }
    }

    /// Times of the bar lines, with the initial silence, s.
    pub fn bars(&self) -> &[f64] {
        &self.bars
    }

    /// The notes that are due, with times of the control steps: they include the initial silence
    /// and the latency compensation.
    pub fn notes(&self) -> &[Note] {
        &self.notes
    }
}

impl From<KeySchedule> for Piece {
    fn from(schedule: KeySchedule) -> Self {
        let KeySchedule { song, frames, robopianist_frames, latency_compensation_secs } = schedule;
        Self {
            title: song.title().to_string(),
            due: frames.into(),
            robopianist_due: robopianist_frames.into(),
            notes: song.notes().into(),
            bars: song.beats().bar_lines(song.duration_secs()).into(),
            latency_compensation_secs,
            fingering: None,
        }
    }
}
