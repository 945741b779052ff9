//! The messages of a recording, as JSON. Rad, N·m and s; the rail in m and N.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// What was played, by whom, on what.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Version of the messages.
    pub schema: u32,
    /// Title of the song.
    pub song: String,
    /// Who played: a policy file or `scripted`.
    pub player: String,
    /// Which rig: `simulation`, `twin`, or the name of a robot.
    pub rig: String,
    /// The execution mode on a robot; `excitation` or `rest` without a song; empty in simulation.
    #[serde(default)]
    pub mode: String,
    /// Control steps per second.
    pub control_hz: f64,
    /// Names of the joints, in the order of every list below.
    pub joints: Vec<String>,
    /// MIDI numbers of the keys due at each control step.
    pub due: Vec<Vec<u8>>,
    /// Times of the score's bar lines, s; absent in older recordings.
    #[serde(default)]
    pub bar_secs: Vec<f64>,
    /// The resolved configuration.
    pub config: serde_json::Value,
}

/// One control step, as it stood at its end. Rad and N·m; the rail in m and N.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StepMessage {
    /// Index of the step.
    pub step: u64,
    /// Joint targets that were sent; of a robot the last waypoint.
    pub targets: Vec<f64>,
    /// Joint positions as the encoders read them.
    pub positions: Vec<f64>,
    /// Joint velocities.
    pub velocities: Vec<f64>,
    /// Torques of the last physics step.
    pub torques: Vec<f64>,
    /// Fingertips, `[x, y, z]` each, m.
    pub fingertips: Vec<[f64; 3]>,
    /// MIDI numbers of the keys that sound.
    pub pressed: Vec<u8>,
}

/// A key was struck or released.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct KeyMessage {
    /// Time since the start, s.
    pub secs: f64,
    /// MIDI number.
    pub pitch: u8,
    /// MIDI velocity; 0 is a release.
    pub velocity: u8,
}

/// What a control step in simulation earned.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RewardMessage {
    /// Index of the step.
    pub step: u64,
    /// Weighted reward terms by name.
    pub terms: BTreeMap<String, f64>,
}

/// The joint targets that were chosen for a control step, as they were before anything shaped them: what a simulated joint's
/// controller is given. Rad, the rail in m.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TargetMessage {
    /// Index of the step.
    pub step: u64,
    /// The targets.
    pub targets: Vec<f64>,
}

/// What the policy saw and chose at the beginning of a control step, and how late it was.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PolicyMessage {
    /// Index of the step.
    pub step: u64,
    /// The observation.
    pub observation: Vec<f32>,
    /// The action, −1 to 1.
    pub action: Vec<f32>,
    /// Time from the beginning of the step until its command was there, s.
    pub late_secs: f64,
}

/// A set-point of a robot: what was asked, and what the limiter let through.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SetPointMessage {
    /// Asked positions of the driven joints.
    pub asked: Vec<f64>,
    /// Positions that were sent on.
    pub sent: Vec<f64>,
    /// Joints that were clamped, and by which limit.
    pub clamps: Vec<(usize, String)>,
}

/// One period of the hand's joint loop: sixteen joints in the order of the wire.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HandMessage {
    /// Measured angles.
    pub positions: Vec<f64>,
    /// Angles to be at.
    pub reference: Vec<f64>,
    /// What the joint loop wanted, of 1200, before it was cut to the limits; to a tenth.
    pub wanted: Vec<f64>,
    /// What was sent, of 1200.
    pub pwm: Vec<i16>,
}

/// A report of the arm.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ArmMessage {
    /// Measured joints.
    pub measured: Vec<f64>,
    /// Joints that it was last asked for; none while it follows nothing.
    pub sent: Option<Vec<f64>>,
    /// Measured place on the rail.
    pub rail_m: f64,
}

/// Something that an operator should read.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NoteMessage {
    /// `phase`, `warning` or `fault`.
    pub kind: String,
    /// What happened.
    pub text: String,
}
