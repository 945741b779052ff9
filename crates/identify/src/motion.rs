//! A recording as input of a fit: commands, measured positions and sounding keys.
//!
//! Commands are either joint targets, one a control step and shaped on their way (excitations, the
//! execution mode `real`), or set-points that a simulation had shaped already, one a physics step
//! (the mirroring modes). A recording that would mislead a fit is refused with the reason.

use std::path::{Path, PathBuf};

use etude_music::{CONTROL_HZ, KEY_COUNT, KeyEvent, LOWEST_PITCH};
use etude_perform::{Activity, Excitation, HandMessage, Recording, RecordingError};
use etude_robot::allegro::RAD_PER_COUNT;
use etude_robot::joints::HAND_DRIVEN_JOINTS;
use etude_robot::rig::{RigConfig, SETPOINT_HZ};
use etude_stage::{DRIVEN_JOINTS, JOINT_NAMES, PHYSICS_STEPS, RAIL, Side};

/// Shortest motion, s: a song of a few notes.
const MIN_DURATION_SECS: f64 = 1.0;
/// Longest gap between readings, s.
const MAX_GAP_SECS: f64 = 0.1;
/// Largest share of control steps whose command may have been a physics step late or more.
const MAX_LATE_SHARE: f64 = 0.01;
/// Largest share of periods in which a joint's drive may have been at its limit.
const MAX_SATURATED_SHARE: f64 = 0.5;
/// Duties that differ by more were cut, of 1200.
const CUT_PWM: f64 = 2.0;
/// Readings before the motion from which the start and the noise are taken.
const REST_READINGS: usize = 60;
/// Drives of joints that move less are not identifiable, rad and m.
const MIN_MOTION: [f64; 2] = [0.02, 0.005];
/// Noise of the rail's readings at least: the arm's report holds single-precision angles of joints,
/// m.
const RAIL_NOISE_M: f64 = 2e-5;

/// The commands of a motion.
#[derive(Clone, Debug, PartialEq)]
pub enum Commands {
    /// Joint targets, one a control step.
    Targets(Vec<[f64; DRIVEN_JOINTS]>),
    /// Set-points, one a physics step.
    SetPoints(Vec<[[f64; DRIVEN_JOINTS]; PHYSICS_STEPS]>),
}

impl Commands {
    /// Control steps.
    pub fn steps(&self) -> usize {
        match self {
            Self::Targets(targets) => targets.len(),
            Self::SetPoints(points) => points.len(),
        }
    }
}

/// A recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
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

impl Motion {
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
            // After the last command the hand was released.
            .filter(|event| event.secs <= secs)
            .filter_map(|event| {
                let key = usize::from(event.pitch.checked_sub(LOWEST_PITCH)?);
                (key < KEY_COUNT).then_some(KeyEvent { secs: event.secs, key, velocity: event.velocity })
            })
            .collect();
        if header.activity == Activity::Excitation(Excitation::Keys) && keys.is_empty() {
            return Err("no key sounded in it: see that the keyboard is on, in its place, and the one that the rig's file names, \
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

fn joint_vector(values: &[f64]) -> Result<[f64; DRIVEN_JOINTS], String> {
    let found =
        <[f64; DRIVEN_JOINTS]>::try_from(values).ok().filter(|values| values.iter().all(|v| v.is_finite()));
    found
        .ok_or_else(|| "a command in it does not have one number for each joint; record it again".to_string())
}

/// The commands of every complete control step.
fn commands(recording: &Recording) -> Result<Commands, String> {
    let mirrored = matches!(recording.header.activity, Activity::Mode(mode) if mode.has_simulation());
    let played = recording.steps.len();
    if recording.targets.is_empty() {
        return Err("it has no commands: it is of a robot at rest, or of a simulation, or from an earlier \
                    version; record an excitation (`etude record --excitation chirp`) or a performance"
            .to_string());
    }
    if !mirrored {
        let targets = recording.targets.iter().take(played).map(|message| joint_vector(&message.targets));
        return Ok(Commands::Targets(targets.collect::<Result<_, _>>()?));
    }
    // The set-point after physics step n is the target of that step.
    let mut points = vec![None; played * PHYSICS_STEPS];
    for (secs, point) in &recording.setpoints {
        let index = (secs * SETPOINT_HZ).round();
        if index >= 1.0
            && let Some(slot) = points.get_mut(index as usize - 1)
        {
            *slot = Some(joint_vector(&point.sent)?);
        }
    }
    let mut last = None;
    let filled: Option<Vec<_>> = points
        .into_iter()
        .map(|point| {
            last = point.or(last);
            last
        })
        .collect();
    let filled = filled.ok_or("its first set-points are missing; record it again")?;
    let (steps, _) = filled.as_chunks::<PHYSICS_STEPS>();
    Ok(Commands::SetPoints(steps.to_vec()))
}

type FingerReadings = Vec<(f64, [f64; HAND_DRIVEN_JOINTS])>;

/// Readings of the fingers before the first command, and from then to the end.
fn finger_readings(recording: &Recording, secs: f64) -> Result<(FingerReadings, FingerReadings), String> {
    let readings: Option<FingerReadings> = recording
        .hand
        .iter()
        .map(|(at, message)| Some((*at, *message.positions.first_chunk::<HAND_DRIVEN_JOINTS>()?)))
        .collect();
    let readings = readings.ok_or("a reading of the hand in it has too few joints; record it again")?;
    // Readings before the start have the time 0.
    let begun = readings.partition_point(|(at, _)| *at <= 0.0);
    let end = readings.partition_point(|(at, _)| *at <= secs);
    Ok((readings[..begun].to_vec(), readings[begun..end.max(begun)].to_vec()))
}

/// Duties of the last `count` periods that ended by `secs`, those of the readings of the fingers.
fn duties(recording: &Recording, count: usize, secs: f64) -> Vec<[f64; HAND_DRIVEN_JOINTS]> {
    let end = recording.hand.partition_point(|(at, _)| *at <= secs);
    let duty =
        |message: &HandMessage, joint: usize| message.pwm.get(joint).map_or(0.0, |&pwm| f64::from(pwm));
    let of = |message: &HandMessage| std::array::from_fn(|joint| duty(message, joint));
    recording.hand[end.saturating_sub(count)..end].iter().map(|(_, message)| of(message)).collect()
}

fn rail_readings(recording: &Recording, secs: f64) -> (Vec<f64>, Vec<(f64, f64)>) {
    let before = recording.arm.iter().filter(|(at, _)| *at <= 0.0).map(|(_, arm)| arm.rail_m).collect();
    let inside = recording.arm.iter().filter(|(at, _)| *at > 0.0 && *at <= secs);
    (before, inside.map(|(at, arm)| (*at, arm.rail_m)).collect())
}

/// Refuses recordings with gaps or late commands.
fn check_times(
    recording: &Recording,
    fingers: &FingerReadings,
    rail: &[(f64, f64)],
    secs: f64,
) -> Result<(), String> {
    let rail: Vec<f64> = rail.iter().map(|(at, _)| *at).collect();
    let fingers: Vec<f64> = fingers.iter().map(|(at, _)| *at).collect();
    for (who, times) in [("hand", fingers), ("arm", rail)] {
        let all: Vec<f64> = [0.0].into_iter().chain(times).chain([secs]).collect();
        let gap = all.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
        if gap > MAX_GAP_SECS {
            return Err(format!(
                "it is badly timed: {:.0} ms without a reading of the {who}; record it on a quieter machine or mend the link",
                gap * 1e3
            ));
        }
    }
    let late = recording.policy.iter().filter(|message| message.late_secs > 1.0 / SETPOINT_HZ).count();
    if late as f64 > MAX_LATE_SHARE * recording.policy.len() as f64 {
        return Err(format!(
            "it is badly timed: {late} of {} commands were late; record it on a quieter machine",
            recording.policy.len()
        ));
    }
    Ok(())
}

/// Refuses recordings in which a drive was at its limit for a larger share of the time than
/// `max_share`.
fn check_limits(recording: &Recording, secs: f64, max_share: f64) -> Result<(), String> {
    for (joint, name) in JOINT_NAMES.iter().enumerate().take(HAND_DRIVEN_JOINTS) {
        let cut = |message: &HandMessage| {
            let [wanted, sent] =
                [message.wanted.get(joint).copied(), message.pwm.get(joint).map(|&pwm| f64::from(pwm))];
            wanted.zip(sent).is_some_and(|(wanted, sent)| (wanted - sent).abs() > CUT_PWM)
        };
        let (inside, cut) = recording
            .hand
            .iter()
            .filter(|(at, _)| *at > 0.0 && *at <= secs)
            .fold((0usize, 0usize), |(all, cuts), (_, message)| (all + 1, cuts + usize::from(cut(message))));
        if cut as f64 > max_share * inside as f64 {
            return Err(format!(
                "it is saturated: the drive of {name} was at its limit for {:.0} % of the time; move less or slower",
                100.0 * cut as f64 / inside as f64
            ));
        }
    }
    Ok(())
}

/// Mean and standard deviation of the readings just before the first command.
fn at_rest(
    fingers: &FingerReadings,
    rail: &[f64],
) -> Result<([f64; DRIVEN_JOINTS], [f64; DRIVEN_JOINTS]), String> {
    let fingers = &fingers[fingers.len().saturating_sub(REST_READINGS)..];
    let rail = &rail[rail.len().saturating_sub(REST_READINGS / 4)..];
    if fingers.is_empty() || rail.is_empty() {
        return Err(
            "it does not show where the joints were before the first command; record it again".to_string()
        );
    }
    let statistics = |joint: usize| {
        let values: Vec<f64> = match joint {
            RAIL => rail.to_vec(),
            _ => fingers.iter().map(|(_, angles)| angles[joint]).collect(),
        };
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let variance =
            values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
        // The readings of a joint at rest may be constant; the noise is at least that of one count.
        let least = if joint == RAIL { RAIL_NOISE_M } else { RAD_PER_COUNT / 12f64.sqrt() };
        (mean, variance.sqrt().max(least))
    };
    Ok((std::array::from_fn(|joint| statistics(joint).0), std::array::from_fn(|joint| statistics(joint).1)))
}
