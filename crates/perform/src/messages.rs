//! The messages of a recording, as JSON. Rad, N·m and s; the rail in m and N.

use std::collections::BTreeMap;

use etude_music::Note;
use etude_robot::rig_file::RigConfig;
use schemars::{JsonSchema, Schema};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::{Excitation, Mode};

/// One kind of message. Each kind has its own topic.
pub trait Message: Serialize + DeserializeOwned + JsonSchema {
    /// The topic.
    const TOPIC: &'static str;
    /// Name of the schema.
    const SCHEMA: &'static str;
}

/// Each kind of message: its type, its topic and the name of its schema. To add a kind: one row
/// here.
macro_rules! messages {
    ($($message:ty => $topic:literal, $schema:literal;)*) => {
        $(impl Message for $message {
            const TOPIC: &'static str = $topic;
            const SCHEMA: &'static str = $schema;
        })*

        /// Topic, name of the schema and schema of every kind of message.
        pub(crate) fn topics() -> Vec<(&'static str, &'static str, Schema)> {
            vec![$(($topic, $schema, schemars::schema_for!($message))),*]
        }
    };
}

messages! {
    Header => "/header", "etude.Header";
    StepMessage => "/step", "etude.Step";
    KeyMessage => "/key", "etude.Key";
    TargetMessage => "/target", "etude.Target";
    PolicyMessage => "/policy", "etude.Policy";
    SetPointMessage => "/setpoint", "etude.SetPoint";
    HandMessage => "/hand", "etude.Hand";
    ArmMessage => "/arm", "etude.Arm";
    EventMessage => "/event", "etude.Event";
    RewardMessage => "/reward", "etude.Reward";
}

/// What a rig did while it was recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", content = "name", rename_all = "kebab-case")]
pub enum Activity {
    /// A simulation played a piece.
    #[default]
    Simulation,
    /// A robot played a piece in this execution mode.
    Mode(Mode),
    /// A robot moved through this sequence.
    Excitation(Excitation),
    /// A robot held still.
    Rest,
}

impl std::fmt::Display for Activity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Simulation => f.write_str("simulation"),
            Self::Mode(mode) => mode.fmt(f),
            Self::Excitation(excitation) => excitation.fmt(f),
            Self::Rest => f.write_str("rest"),
        }
    }
}

/// What was played, by whom, on what.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Header {
    /// Version of the messages.
    pub schema: u32,
    /// Title of the song; empty without one.
    pub song: String,
    /// Who played: a policy file, `scripted`, or `nobody`.
    pub player: String,
    /// Which rig: `simulation`, `twin` with its parameters in parentheses, or the name of a robot.
    pub rig: String,
    /// What the rig did.
    pub activity: Activity,
    /// Control steps per second.
    pub control_hz: f64,
    /// Names of the joints, in the order of every list below.
    pub joints: Vec<String>,
    /// MIDI numbers of the keys that are due in each control step.
    pub due: Vec<Vec<u8>>,
    /// On a robot: F1 compares the keys that are due in a control step with those that sound this
    /// time after its end, s. `None` in a simulation, where it is those that sound at its end, and
    /// without a song.
    pub late_secs: Option<f64>,
    /// How much earlier than written the player plays, s. A time of a note, in `due_notes`,
    /// `bar_secs` and `/key`, is the written one after the initial silence: the time of the control
    /// steps, and of every message, less this.
    #[serde(default)]
    pub latency_compensation_secs: f64,
    /// The notes that are due.
    pub due_notes: Vec<DueNote>,
    /// Times of the score's bar lines, s.
    pub bar_secs: Vec<f64>,
    /// The resolved configuration of the run that the player comes from, as in the run's
    /// `config.toml`; without one for an excitation and at rest.
    pub run: Option<serde_json::Value>,
    /// Whether a correction that was learned on the robot was added to the set-points of the robot.
    /// The targets of `/target` are without it, those of `/step` with it.
    pub corrected: bool,
    /// The rig's file, resolved; none in simulation.
    #[schemars(with = "Option<serde_json::Value>")]
    pub rig_config: Option<RigConfig>,
}

/// A note that is due. Times in s, as written after the initial silence.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DueNote {
    /// MIDI number.
    pub pitch: u8,
    /// MIDI velocity.
    pub velocity: u8,
    /// When its key should go down.
    pub start_secs: f64,
    /// When it should come up.
    pub end_secs: f64,
}

impl From<Note> for DueNote {
    fn from(Note { pitch, velocity, start_secs, end_secs }: Note) -> Self {
        Self { pitch, velocity, start_secs, end_secs }
    }
}

impl From<DueNote> for Note {
    fn from(DueNote { pitch, velocity, start_secs, end_secs }: DueNote) -> Self {
        Self { pitch, velocity, start_secs, end_secs }
    }
}

/// One control step, as it stood at its end. Rad and N·m; the rail in m and N.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
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
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct KeyMessage {
    /// When, s, on the axis of the notes that are due ([`Header::latency_compensation_secs`]).
    pub secs: f64,
    /// MIDI number.
    pub pitch: u8,
    /// MIDI velocity; 0 is a release.
    pub velocity: u8,
}

/// What a control step in simulation earned.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RewardMessage {
    /// Index of the step.
    pub step: u64,
    /// Weighted reward terms by name.
    pub terms: BTreeMap<String, f64>,
}

/// The joint targets that were chosen for a control step, as they were before anything shaped them:
/// what a simulated joint's controller is given. Rad, the rail in m.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TargetMessage {
    /// Index of the step.
    pub step: u64,
    /// The targets.
    pub targets: Vec<f64>,
}

/// What the policy saw and chose at the beginning of a control step, and how late it was.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PolicyMessage {
    /// Index of the step.
    pub step: u64,
    /// The observation.
    pub observation: Vec<f32>,
    /// The action, −1 to 1.
    pub action: Vec<f32>,
    /// Time from the beginning of the step until its command was there, s.
    #[serde(alias = "late_secs")] // Its name in older recordings.
    pub command_late_secs: f64,
}

/// A set-point of a robot: what was asked, and what the limiter let through.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SetPointMessage {
    /// Asked positions of the driven joints.
    pub asked: Vec<f64>,
    /// Positions that were sent on.
    pub sent: Vec<f64>,
    /// Joints that were clamped, and by which limit.
    pub clamps: Vec<(usize, String)>,
}

/// One period of the hand's joint loop: sixteen joints in the order of the wire.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct HandMessage {
    /// Measured angles.
    pub positions: Vec<f64>,
    /// Angles to be at; the measured ones while the hand is not driven.
    pub reference: Vec<f64>,
    /// What the joint loop wanted, of 1200, before it was cut to the limits; to a tenth.
    pub wanted: Vec<f64>,
    /// What was sent, of 1200.
    pub pwm: Vec<i16>,
}

/// A report of the arm.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ArmMessage {
    /// Measured joints.
    pub measured: Vec<f64>,
    /// Joints that it was last asked for; none while it follows nothing.
    pub sent: Option<Vec<f64>>,
    /// Measured place on the rail.
    pub rail_m: f64,
}

/// Something that an operator should read.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct EventMessage {
    /// `phase`, `warning` or `fault`.
    pub kind: String,
    /// What happened.
    pub text: String,
}
