//! The page's data of one recording.

use std::ffi::OsStr;
use std::path::Path;

use anyhow::Context as _;
use etude_lab::{SIGHT_READER, readable};
use etude_music::metrics::{FrameScores, FrameTally, NoteScores, frame_scores, note_scores};
use etude_music::sound::{self, SoundError};
use etude_music::{
    CONTROL_HZ, HIGHEST_PITCH, KeyEvent, KeySet, LOWEST_PITCH, Note, keys_at, notes_from_key_events,
    repertoire,
};
use etude_perform::session::stage_side;
use etude_perform::{Header, Recording};
use etude_stage::{DRIVEN_JOINTS, RAIL_BEAM, Scene, StageConfig, World};
use etude_task::TaskConfig;
use serde::Serialize;

use super::arm::{Arm, arm};
use super::marks::{Mark, marks};
use super::matching::{NoteMatch, match_notes};
use super::rewards::{RewardCurve, rewards, rounded};

/// Notes of one piece are due at the same times from its first note on, except for differences of
/// at most this, s.
const SAME_RHYTHM_SECS: f64 = 0.05;
/// One recording. Lengths in m, angles in rad, times in s as written after the initial silence;
/// lists with a value a control step have the end of step `i` at `(i + 1) / control_hz -
/// early_secs`.
#[derive(Clone, Debug, Serialize)]
pub struct Take {
    /// Its name: its path.
    pub name: String,
    /// Title of the song.
    pub song: String,
    /// The player: a policy file, or `scripted`.
    pub player: String,
    /// The same in short, for people.
    pub who: String,
    /// On what.
    pub rig: String,
    /// The execution mode; empty in simulation.
    pub mode: String,
    /// Control steps per second.
    pub control_hz: f64,
    /// How much earlier than written the player plays.
    pub early_secs: f64,
    /// Times of the bar lines.
    pub bar_secs: Vec<f64>,
    /// What is missing in the recording, for the reader.
    pub incomplete: Option<String>,
    /// The simulator's world of the recording.
    pub scene: Scene,
    /// Names of the joints.
    pub joints: Vec<String>,
    /// Joint positions, a row a control step.
    pub positions: Vec<Vec<f64>>,
    /// Joint positions at the beginning, where they are known.
    pub start: Option<Vec<f64>>,
    /// The robot's arm; none in simulation, where the hand is on a rail.
    pub arm: Option<Arm>,
    /// Pitches that are due in each control step.
    pub due: Vec<Vec<u8>>,
    /// Pitches that sounded at the end of each control step.
    pub pressed: Vec<Vec<u8>>,
    /// Keys that F1 compares with those that are due in each control step: see
    /// [`Header::late_secs`].
    #[serde(skip)]
    pub(super) scored_keys: Vec<KeySet>,
    /// Time from the end of each control step to the moment of its `scored_keys`.
    #[serde(skip)]
    pub(super) late_secs: f64,
    /// The notes that were played.
    pub notes: Vec<TakeNote>,
    /// The notes that were due; empty without a song.
    pub due_notes: Vec<TakeNote>,
    /// By which of `notes` each of `due_notes` was played.
    pub matches: Vec<Option<NoteMatch>>,
    /// Scores by note; none without `due_notes`.
    pub note_scores: Option<NoteScores>,
    /// Scores of the steps so far, after each step, of `scored_keys`; empty without a song.
    pub running: Running,
    /// Scores of the whole song, in which steps that were not played count as silent; none without
    /// a song.
    #[serde(rename = "final")]
    pub last: Option<FrameScores>,
    /// The reward's terms.
    pub rewards: Vec<RewardCurve>,
    /// A note on them for the reader.
    pub rewards_note: Option<String>,
    /// Phases, warnings, faults, clamps.
    pub marks: Vec<Mark>,
    /// The task, from which MuJoCo's world is built for pictures.
    #[serde(skip)]
    task: TaskConfig,
}

/// A note, as it was played or as it was due.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TakeNote {
    /// MIDI number.
    pub pitch: u8,
    /// When its key goes down.
    pub start: f64,
    /// When its key comes up.
    pub end: f64,
    /// MIDI velocity.
    pub velocity: u8,
}

/// Scores of the control steps so far.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Running {
    /// Mean F1.
    pub f1: Vec<f64>,
    /// Mean precision.
    pub precision: Vec<f64>,
    /// Mean recall.
    pub recall: Vec<f64>,
}

impl Take {
    /// Whether the same notes were due here as in `other`, in the same rhythm, whatever the lead of
    /// each.
    pub fn has_the_notes_of(&self, other: &Self) -> bool {
        let ([first, ..], [theirs, ..]) = (self.due_notes.as_slice(), other.due_notes.as_slice()) else {
            return self.due_notes.len() == other.due_notes.len() && self.due == other.due;
        };
        let later = theirs.start - first.start;
        let is_same = |(ours, theirs): (&TakeNote, &TakeNote)| {
            ours.pitch == theirs.pitch && (theirs.start - ours.start - later).abs() <= SAME_RHYTHM_SECS
        };
        self.due_notes.len() == other.due_notes.len()
            && self.due_notes.iter().zip(&other.due_notes).all(is_same)
    }

    /// The page's data of `recording`, with this `name`.
    ///
    /// # Errors
    /// If its world cannot be built.
    pub fn new(recording: &Recording, name: String) -> anyhow::Result<Self> {
        let header = &recording.header;
        let task = task_of(header)?;
        let mut world = world_of(&task)?;
        let mut scene = world.scene();
        let in_simulation = header.activity == etude_perform::Activity::Simulation;
        let start = in_simulation.then(|| world.start_pose().map(rounded).to_vec());

        let whole = |step: &&etude_perform::StepMessage| step.positions.len() == DRIVEN_JOINTS;
        let steps: Vec<_> = recording.steps.iter().take_while(whole).collect();
        let keys = |pitches: &[u8]| KeySet::from_pitches(pitches.iter().copied());
        let due: Vec<KeySet> = header.due.iter().map(|pitches| keys(pitches)).collect();
        let pressed: Vec<KeySet> = steps.iter().map(|step| keys(&step.pressed)).collect();
        let hz = if (1.0..=1000.0).contains(&header.control_hz) { header.control_hz } else { CONTROL_HZ };
        let early_secs = header.latency_compensation_secs;
        let end_secs = steps.len() as f64 / hz - early_secs;
        let (down_before, events) = events(recording, end_secs + header.late_secs.unwrap_or_default());
        let scored_keys = match header.late_secs {
            Some(late_secs) => {
                let times = (1..=steps.len()).map(|step| step as f64 / hz - early_secs + late_secs);
                keys_at(down_before, &events, times)
            }
            None => pressed.clone(),
        };
        let arm = arm(recording, steps.len(), hz);
        if arm.is_some() {
            scene.geoms.retain(|geom| geom.name != RAIL_BEAM);
        }

        let mut running = Running::default();
        if !due.is_empty() {
            let mut tally = FrameTally::default();
            for (step, pressed) in scored_keys.iter().enumerate() {
                tally.push(due.get(step).copied().unwrap_or_default(), *pressed);
                let scores = tally.scores();
                running.f1.push(rounded(scores.f1));
                running.precision.push(rounded(scores.precision));
                running.recall.push(rounded(scores.recall));
            }
        }
        let positions: Vec<[f64; DRIVEN_JOINTS]> =
            steps.iter().map(|step| std::array::from_fn(|joint| step.positions[joint])).collect();
        let notes = notes_from_key_events(&events, end_secs);
        let due_notes: Vec<Note> = header.due_notes.iter().map(|note| Note::from(*note)).collect();
        let (rewards, rewards_note) = rewards(recording, &task, &mut world, &due, &scored_keys, &positions);
        Ok(Self {
            name,
            song: header.song.clone(),
            player: header.player.clone(),
            who: player_label(&header.player, &header.song),
            rig: header.rig.clone(),
            mode: if in_simulation { String::new() } else { header.activity.to_string() },
            control_hz: hz,
            early_secs,
            bar_secs: header.bar_secs.iter().copied().filter(|secs| secs.is_finite()).collect(),
            incomplete: incomplete(recording, steps.len(), due.len()),
            scene,
            joints: header.joints.clone(),
            positions: positions.iter().map(|row| row.map(rounded).to_vec()).collect(),
            start,
            arm,
            matches: match_notes(&due_notes, &notes),
            note_scores: (!due_notes.is_empty()).then(|| note_scores(&due_notes, &notes)),
            due_notes: due_notes.iter().map(TakeNote::of).collect(),
            notes: notes.iter().map(TakeNote::of).collect(),
            running,
            last: (!due.is_empty()).then(|| frame_scores(&due, &scored_keys)),
            due: due.iter().map(|keys| keys.pitches().collect()).collect(),
            pressed: pressed.iter().map(|keys| keys.pitches().collect()).collect(),
            late_secs: header.late_secs.unwrap_or_default(),
            scored_keys,
            rewards,
            rewards_note,
            marks: marks(recording),
            task,
        })
    }

    /// The simulator's world of the recording, in its start pose.
    ///
    /// # Errors
    /// If MuJoCo refuses it.
    pub fn world(&self) -> anyhow::Result<World> {
        world_of(&self.task)
    }

    /// What was played, as sound.
    ///
    /// # Errors
    /// If it cannot be rendered.
    pub fn sound(&self) -> Result<Vec<f32>, SoundError> {
        let note = |note: &TakeNote| Note {
            pitch: note.pitch,
            velocity: note.velocity,
            start_secs: note.start,
            end_secs: note.end,
        };
        sound::render(&self.notes.iter().map(note).collect::<Vec<_>>(), None)
    }

    /// Length of what was recorded, s.
    pub fn secs(&self) -> f64 {
        self.positions.len() as f64 / self.control_hz - self.early_secs
    }

    /// The control step that ends at a time, with its fraction; −1 at the beginning of the first.
    pub fn step_at(&self, secs: f64) -> f64 {
        (secs + self.early_secs) * self.control_hz - 1.0
    }
}

/// A configuration that is not valid is drawn as the default world.
fn world_of(task: &TaskConfig) -> anyhow::Result<World> {
    let params = task.check().ok().and_then(|()| task.params().ok()).unwrap_or_default();
    Ok(World::new(&task.stage, &params)?)
}

/// The task of a recording; without one in its header the default task with the rig's hand.
///
/// # Errors
/// If it has a task that this version cannot read.
fn task_of(header: &Header) -> anyhow::Result<TaskConfig> {
    if let Some(task) = header.run.as_ref().and_then(|run| run.get("task")) {
        return serde_json::from_value(task.clone())
            .context("its task is of another version of Étude; record it again");
    }
    let side = header.rig_config.as_ref().map(|rig| stage_side(rig.hand.side));
    let stage = StageConfig { side: side.unwrap_or_default(), ..StageConfig::default() };
    Ok(TaskConfig { stage, ..TaskConfig::default() })
}

impl TakeNote {
    fn of(note: &Note) -> Self {
        let [start, end] = [note.start_secs, note.end_secs].map(|secs| rounded(secs.max(0.0)));
        Self { pitch: note.pitch, start, end, velocity: note.velocity }
    }
}

/// Keys that are down at the beginning; strikes and releases from then on. A recording that broke
/// off may have some after its last whole step.
fn events(recording: &Recording, end_secs: f64) -> (KeySet, Vec<KeyEvent>) {
    let begin_secs = -recording.header.latency_compensation_secs;
    let on_keyboard = |pitch: u8| (LOWEST_PITCH..=HIGHEST_PITCH).contains(&pitch);
    let (before, events): (Vec<KeyEvent>, _) = recording
        .keys
        .iter()
        .filter(|key| on_keyboard(key.pitch) && key.secs <= end_secs)
        .map(|key| KeyEvent {
            secs: key.secs,
            key: usize::from(key.pitch - LOWEST_PITCH),
            velocity: key.velocity,
        })
        .partition(|event| event.secs < begin_secs);
    (keys_at(KeySet::EMPTY, &before, [begin_secs])[0], events)
}

fn incomplete(recording: &Recording, steps: usize, due: usize) -> Option<String> {
    let of = if due > 0 { format!("{steps} of {due}") } else { steps.to_string() };
    if steps == 0 {
        return Some("The recording has no control step, so nothing moves.".to_string());
    }
    if steps < recording.steps.len() {
        return Some(format!("The recording is damaged after control step {of}; the rest is not shown."));
    }
    if !recording.complete {
        return Some(format!("The recording is incomplete or damaged; its {of} control steps are shown."));
    }
    (steps < due).then(|| format!("The performance ended early, after {of} control steps."))
}

/// The player, in short: a policy that comes with Étude, or that of a run, by its name and without
/// its path.
fn player_label(player: &str, song: &str) -> String {
    let path = Path::new(player);
    // A policy trained in a rehearsal is named by its iteration.
    let folder = path.ancestors().skip(1).find(|folder| !folder.ends_with("training"));
    let names = [folder.and_then(Path::file_name), path.file_stem()];
    match names.map(|name| name.and_then(OsStr::to_str)) {
        [Some("policies"), Some(SIGHT_READER)] => SIGHT_READER.to_string(),
        [Some("policies"), Some(id)] if is_of(id, song) => "shipped policy".to_string(),
        [Some("policies"), Some(id)] => format!("shipped policy of {id}"),
        [Some(run), Some(file)] if file.starts_with("policy-") => run.to_string(),
        _ => player.to_string(),
    }
}

/// Whether the shipped policy of this name has learned the song of this title.
fn is_of(id: &str, song: &str) -> bool {
    repertoire::get(id).map_or_else(|| readable(song) == id, |learned| learned.title() == song)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_is_shown_in_its_own_task() {
        let task = serde_json::to_value(TaskConfig { lookahead: 9, ..TaskConfig::default() }).unwrap();
        let header = Header { run: Some(serde_json::json!({ "task": task })), ..Header::default() };
        assert_eq!(task_of(&header).unwrap().lookahead, 9);
        let other = serde_json::json!({ "task": { "of_another_version": 1 } });
        let header = Header { run: Some(other), ..Header::default() };
        assert!(task_of(&header).unwrap_err().to_string().contains("another version"));
    }

    #[test]
    fn players_have_short_labels() {
        for (player, short) in [
            ("/home/a/etude/policies/sight-reader.safetensors", "sight-reader"),
            ("policies/twinkle.safetensors", "shipped policy"),
            ("policies/ode-to-joy.safetensors", "shipped policy of ode-to-joy"),
            ("runs/my-song__fast__0/policy-best.safetensors", "my-song__fast__0"),
            ("out/rehearse-twinkle/iteration-1/training/policy-best.safetensors", "iteration-1"),
            ("elsewhere/mine.safetensors", "elsewhere/mine.safetensors"),
            ("scripted", "scripted"),
        ] {
            assert_eq!(player_label(player, "Twinkle Twinkle Little Star"), short);
        }
    }
}
