//! A recording as input of a fit: commands, measured positions and sounding keys.
//!
//! Commands are either joint targets, one a control step and shaped on the robot (excitations, the
//! execution mode `real`), or set-points that a simulation had shaped already, one a physics step
//! (the mirroring modes). A recording that would mislead a fit is refused with the reason.

use std::path::{Path, PathBuf};

use etude_music::{CONTROL_HZ, KEY_COUNT, KeyEvent, LOWEST_PITCH};
use etude_perform::{Activity, Excitation, Recording, RecordingError};
use etude_robot::joints::HAND_DRIVEN_JOINTS;
use etude_robot::rig_file::RigConfig;
use etude_stage::{DRIVEN_JOINTS, JOINT_NAMES, RAIL, Side};

mod commands;
mod readings;

pub use commands::Commands;
use commands::commands;
use readings::{at_rest, check_limits, check_times, duties, finger_readings, rail_readings};

/// Shortest motion, s: a song of a few notes.
const MIN_DURATION_SECS: f64 = 1.0;
/// Largest share of periods in which a joint's drive may have been at its limit.
const MAX_SATURATED_SHARE: f64 = 0.5;
/// Drives of joints that move less are not identifiable, rad and m.
const MIN_MOTION: [f64; 2] = [0.02, 0.005];

/// A recording.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedMotion {
    /// Its file.
    pub path: PathBuf,
    /// The rig.
    pub rig: RigConfig,
    /// Its name; of the twin with its parameter set.
    pub rig_label: String,
    /// The execution mode, or the excitation.
    pub mode: String,
    /// The commands.
    pub commands: Commands,
    /// Measured positions before the first command, rad, the rail in m.
    pub start: [f64; DRIVEN_JOINTS],
    /// Readings of the finger joints: time, s, and rad.
    pub fingers: Vec<(f64, [f64; HAND_DRIVEN_JOINTS])>,
    /// Duties (of 1200) that were sent after each reading of the fingers.
    pub pwm: Vec<[f64; HAND_DRIVEN_JOINTS]>,
    /// Readings of the rail: time, s, and m.
    pub rail: Vec<(f64, f64)>,
    /// Standard deviation of the readings of a joint at rest.
    pub noise: [f64; DRIVEN_JOINTS],
    /// Whether a joint moves enough to be identified.
    pub moves: [bool; DRIVEN_JOINTS],
    /// Key events.
    pub keys: Vec<KeyEvent>,
}

/// A recording that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum MotionError {
    /// It cannot be read.
    #[error(transparent)]
    Read(#[from] RecordingError),
    /// It is not of a robot, nothing moves, or it would mislead a fit.
    #[error("{path}: {why}")]
    Unsuitable {
        /// The file.
        path: PathBuf,
        /// What is missing, and where to get it.
        why: String,
    },
}

impl RecordedMotion {
    /// Reads recordings of one rig.
    ///
    /// # Errors
    /// If one of them cannot be used, or they are of more than one rig.
    pub fn load_all(paths: &[PathBuf]) -> Result<Vec<Self>, MotionError> {
        let motions = paths.iter().map(|path| Self::load(path)).collect::<Result<Vec<_>, _>>()?;
        if let Some((first, rest)) = motions.split_first()
            && let Some(other) =
                rest.iter().find(|motion| (&motion.rig, &motion.rig_label) != (&first.rig, &first.rig_label))
        {
            let why = format!(
                "it was made on the rig `{}`, and {} on `{}`: identify one rig at a time, from its own recordings",
                other.rig_label,
                first.path.display(),
                first.rig_label
            );
            return Err(MotionError::Unsuitable { path: other.path.clone(), why });
        }
        Ok(motions)
    }

    /// Reads a recording.
    ///
    /// # Errors
    /// If it cannot be read, or would mislead a fit; the message says why.
    pub fn load(path: &Path) -> Result<Self, MotionError> {
        Self::new(path, &Recording::read(path)?)
            .map_err(|why| MotionError::Unsuitable { path: path.to_path_buf(), why })
    }

    /// Extracts a motion from a recording. `Err` says why it cannot be used.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn new(path: &Path, recording: &Recording) -> Result<Self, String> {
        let header = &recording.header;
        let rig = header.rig_config.clone().ok_or_else(|| {
            "it does not say what rig it was made on: record it again with `etude record` or `etude perform`".to_string()
        })?;
        if header.joints != JOINT_NAMES {
            return Err(
                "its joints are not those of this hand; record it again with this version".to_string()
            );
        }
        let commands = commands(recording)?;
        let secs = commands.steps() as f64 / CONTROL_HZ;
        let (before, fingers) = finger_readings(recording, secs)?;
        let (rail_before, rail) = rail_readings(recording, secs);
        if secs < MIN_DURATION_SECS {
            return Err(format!(
                "it lasts {secs:.1} s, and a fit needs {MIN_DURATION_SECS} s at least; record a longer motion"
            ));
        }
        check_times(recording, &fingers, &rail, secs)?;
        // A pressing finger's drive is often at its limit; of such a motion only the keys are
        // fitted.
        let keys: Vec<KeyEvent> = recording
            .keys
            .iter()
            .filter_map(|event| {
                let key = usize::from(event.pitch.checked_sub(LOWEST_PITCH)?);
                // By the clock of the commands.
                let secs = event.secs + header.latency_compensation_secs;
                (key < KEY_COUNT).then_some(KeyEvent { secs, key, velocity: event.velocity })
            })
            // After the last command the hand was released.
            .filter(|event| event.secs <= secs)
            .collect();
        if header.activity == Activity::Excitation(Excitation::Keys) && keys.is_empty() {
            return Err("no key sounded in it: check that the keyboard is on, in its position, and the one that the rig's file names, \
                        then record it again"
                .to_string());
        }
        let max_share = if keys.is_empty() { MAX_SATURATED_SHARE } else { 1.0 };
        check_limits(recording, secs, max_share)?;
        let (start, noise) = at_rest(&before, &rail_before)?;
        let mut moves = [false; DRIVEN_JOINTS];
        for (joint, moves) in moves.iter_mut().enumerate() {
            let values = fingers.iter().map(|(_, angles)| angles.get(joint).copied());
            let (low, high) =
                if joint == RAIL { min_max(rail.iter().map(|(_, m)| *m)) } else { min_max(values.flatten()) };
            *moves = high - low > MIN_MOTION[usize::from(joint == RAIL)];
        }
        if !moves.contains(&true) {
            return Err(
                "nothing moves in it; record an excitation (`etude record --excitation chirp`)".to_string()
            );
        }
        Ok(Self {
            path: path.to_path_buf(),
            rig,
            rig_label: header.rig.clone(),
            mode: header.activity.to_string(),
            commands,
            start,
            pwm: duties(recording, fingers.len(), secs),
            fingers,
            rail,
            noise,
            moves,
            keys,
        })
    }

    /// Whether it presses keys slowly ([`Excitation::Keys`]).
    pub fn presses_keys(&self) -> bool {
        self.mode == Excitation::Keys.name()
    }

    /// Whether it is an excitation that touches nothing.
    pub fn is_in_the_air(&self) -> bool {
        self.keys.is_empty()
            && self.mode.parse().is_ok_and(|excitation: Excitation| excitation != Excitation::Keys)
    }

    /// Whether it plays keys as music is played.
    pub fn plays_keys(&self) -> bool {
        !self.keys.is_empty() && !self.presses_keys()
    }

    /// Name of its file.
    pub fn file_name(&self) -> String {
        let name = self.path.file_name();
        name.map_or_else(|| self.path.display().to_string(), |name| name.to_string_lossy().into_owned())
    }

    /// Duration, s.
    pub fn secs(&self) -> f64 {
        self.commands.steps() as f64 / CONTROL_HZ
    }

    /// Side of its hand.
    pub fn side(&self) -> Side {
        match self.rig.hand.side {
            etude_robot::allegro::HandSide::Left => Side::Left,
            etude_robot::allegro::HandSide::Right => Side::Right,
        }
    }

    /// Readings of a joint, in the order of time: s, and rad or m.
    pub fn readings(&self, joint: usize) -> Box<dyn Iterator<Item = (f64, f64)> + '_> {
        if joint == RAIL {
            Box::new(self.rail.iter().copied())
        } else {
            Box::new(self.fingers.iter().map(move |(secs, angles)| (*secs, angles[joint])))
        }
    }
}

fn min_max(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
}
