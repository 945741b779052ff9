//! Recordings: every control step and key event of a performance, as an MCAP file.
//!
//! | topic | message | when |
//! |---|---|---|
//! | `/header` | [`Header`] | once, first |
//! | `/step` | [`StepMessage`] | at the end of every control step |
//! | `/key` | [`KeyMessage`] | when a key is struck or released (in simulation at the physics step) |
//! | `/reward` | [`RewardMessage`] | at the end of every control step, in simulation |
//!
//! and of a robot also
//!
//! | topic | message | when |
//! |---|---|---|
//! | `/target` | [`TargetMessage`] | at the beginning of every control step |
//! | `/policy` | [`PolicyMessage`] | when a control step was commanded |
//! | `/setpoint` | [`SetPointMessage`] | at every set-point, 200 a second |
//! | `/hand` | [`HandMessage`] | at every period of the hand's joint loop, 333 a second, also while it starts and for a second after a release |
//! | `/arm` | [`ArmMessage`] | at every report of the arm, 100 a second |
//! | `/event` | [`EventMessage`] | at a new phase, a warning, a fault |
//!
//! Messages are JSON with a JSON schema. Log times are nanoseconds since the start of the
//! performance; what comes before it has the time 0. The publish times of what a robot's devices
//! measured are those of the robot's clock, since its wires were opened. The file has an end at any
//! moment, so a recording that was interrupted, even by kill -9, can be opened by any reader of
//! MCAP, and at most its last second is missing. [`RecordingWriter`](crate::RecordingWriter) writes
//! it, [`Recording`] reads it.

use std::path::Path;

use serde::Deserialize;

use crate::error::RecordingError;
use crate::messages::{
    ArmMessage, EventMessage, HandMessage, Header, KeyMessage, Message, PolicyMessage, RewardMessage,
    SetPointMessage, StepMessage, TargetMessage,
};
use crate::terminated_file::UNINDEXED_END;

/// Version of the messages ([`Header::schema`]).
pub(crate) const SCHEMA: u32 = 2;

/// A recording read back.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// What was played.
    pub header: Header,
    /// Every control step.
    pub steps: Vec<StepMessage>,
    /// Every key event.
    pub keys: Vec<KeyMessage>,
    /// What each control step in simulation earned.
    pub rewards: Vec<RewardMessage>,
    /// Joint targets of a robot's control steps, before they were shaped.
    pub targets: Vec<TargetMessage>,
    /// What a robot's policy saw and chose.
    pub policy: Vec<PolicyMessage>,
    /// A robot's set-points, each at its time, s.
    pub setpoints: Vec<(f64, SetPointMessage)>,
    /// Periods of a robot's hand, each at its time, s.
    pub hand: Vec<(f64, HandMessage)>,
    /// Reports of a robot's arm, each at its time, s.
    pub arm: Vec<(f64, ArmMessage)>,
    /// What an operator should read, each at its time, s.
    pub events: Vec<(f64, EventMessage)>,
    /// Whether the file ends as it should; `false` for one that was interrupted or damaged.
    pub complete: bool,
}

impl Recording {
    /// Reads a recording; a damaged or unfinished one as far as it goes.
    ///
    /// # Errors
    /// If the file cannot be read, or not even its header is there.
    pub fn read(path: &Path) -> Result<Self, RecordingError> {
        let bytes = std::fs::read(path)
            .map_err(|source| RecordingError::Open { path: path.to_path_buf(), source })?;
        Self::from_bytes(&bytes)
            .map_err(|message| RecordingError::Format { path: path.to_path_buf(), message })
    }

    /// Reads the bytes of a recording. `Err` says what is wrong with them.
    ///
    /// # Errors
    /// If not even the header can be read.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        let mut recording = Self { complete: true, ..Self::default() };
        // mcap 0.26.0 subtracts sizes that it has not checked: with overflow checks on, a damaged
        // chunk panics there.
        let read = std::panic::AssertUnwindSafe(|| recording.take(bytes));
        match std::panic::catch_unwind(read) {
            Ok(taken) => taken?,
            Err(_) => recording.complete = false,
        }
        recording.complete &= bytes.ends_with(mcap::MAGIC) && !bytes.ends_with(&UNINDEXED_END);
        match recording.header.schema {
            SCHEMA => Ok(recording),
            _ => Err("it has no header".to_string()),
        }
    }

    /// Adds the messages up to the end or to the first damaged record.
    fn take(&mut self, bytes: &[u8]) -> Result<(), String> {
        let options = mcap::read::Options::IgnoreEndMagic.into();
        let stream = mcap::MessageStream::new_with_options(bytes, options).map_err(|error| {
            format!("{error}; name an .mcap file that `etude play` or `perform` has written")
        })?;
        for message in stream {
            let Ok(message) = message else {
                self.complete = false;
                break;
            };
            let data: &[u8] = &message.data;
            let secs = message.log_time as f64 * 1e-9;
            let taken = match message.channel.topic.as_str() {
                Header::TOPIC => {
                    check_schema(data)?;
                    serde_json::from_slice(data).map(|header| self.header = header)
                }
                StepMessage::TOPIC => serde_json::from_slice(data).map(|step| self.steps.push(step)),
                KeyMessage::TOPIC => serde_json::from_slice(data).map(|key| self.keys.push(key)),
                RewardMessage::TOPIC => serde_json::from_slice(data).map(|reward| self.rewards.push(reward)),
                TargetMessage::TOPIC => serde_json::from_slice(data).map(|target| self.targets.push(target)),
                PolicyMessage::TOPIC => serde_json::from_slice(data).map(|policy| self.policy.push(policy)),
                SetPointMessage::TOPIC => {
                    serde_json::from_slice(data).map(|point| self.setpoints.push((secs, point)))
                }
                HandMessage::TOPIC => serde_json::from_slice(data).map(|hand| self.hand.push((secs, hand))),
                ArmMessage::TOPIC => serde_json::from_slice(data).map(|arm| self.arm.push((secs, arm))),
                EventMessage::TOPIC => {
                    serde_json::from_slice(data).map(|event| self.events.push((secs, event)))
                }
                _ => Ok(()),
            };
            taken.map_err(|error| format!("a message on {} is damaged: {error}", message.channel.topic))?;
        }
        Ok(())
    }
}

/// Checks the version of a header. The rest of another version's header may be anything.
fn check_schema(header: &[u8]) -> Result<(), String> {
    #[derive(Deserialize)]
    struct Schema {
        schema: u32,
    }
    match serde_json::from_slice(header) {
        Ok(Schema { schema: SCHEMA }) => Ok(()),
        Ok(Schema { schema: other }) => Err(format!(
            "its messages are version {other}, and this Étude reads {SCHEMA}: record it again, or read it with \
             the version that wrote it"
        )),
        Err(error) => Err(format!("its header is damaged: {error}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RecordingWriter;
    use proptest::prelude::*;

    fn sample() -> (Recording, Vec<u8>) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r.mcap");
        let header = Header {
            schema: SCHEMA,
            song: "A <song>".to_string(),
            joints: vec!["rail".to_string()],
            due: vec![vec![60], vec![]],
            ..Header::default()
        };
        let mut writer = RecordingWriter::create(&path, &header).unwrap();
        let mut steps = Vec::new();
        for step in 0..400 {
            let message = StepMessage {
                step,
                targets: vec![0.1 * step as f64],
                pressed: vec![60],
                ..Default::default()
            };
            writer.write(step as f64 * 0.05, &message).unwrap();
            steps.push(message);
        }
        let key = KeyMessage { secs: 0.125, pitch: 60, velocity: 90 };
        writer.write(key.secs, &key).unwrap();
        let note = EventMessage { kind: "fault".to_string(), text: "hot".to_string() };
        writer.write(21.5, &note).unwrap();
        let [positions, reference, wanted] = [0.1, 0.2, -7.3].map(|value| vec![value; 16]);
        let hand = HandMessage { positions, reference, wanted, pwm: vec![-7; 16] };
        writer.write(-0.003, &hand).unwrap();
        writer.finish().unwrap();
        let recording = Recording {
            header,
            steps,
            keys: vec![key],
            events: vec![(21.5, note)],
            hand: vec![(0.0, hand)],
            complete: true,
            ..Recording::default()
        };
        assert_eq!(Recording::read(&path).unwrap(), recording);
        (recording, std::fs::read(&path).unwrap())
    }

    #[test]
    fn a_recording_whose_folder_was_removed_is_written_again() {
        let there = tempfile::tempdir().unwrap();
        let path = there.path().join("out/1/run-1.mcap");
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        let mut writer = RecordingWriter::create(&path, &Header::default()).unwrap();
        let step = StepMessage { positions: vec![0.1; 16], ..StepMessage::default() };
        writer.write(0.05, &step).unwrap();
        std::fs::remove_dir_all(there.path().join("out")).unwrap();
        writer.write(0.1, &step).unwrap();
        writer.finish().unwrap();
        let recording = Recording::read(&path).unwrap();
        assert!(recording.complete && recording.steps.len() == 2, "{}", recording.steps.len());
    }

    #[test]
    fn a_recording_that_was_cut_short_is_read_as_far_as_it_goes() {
        let (whole, bytes) = sample();
        let half = Recording::from_bytes(&bytes[..bytes.len() / 2]).unwrap();
        assert!(!half.complete && !half.steps.is_empty());
        assert_eq!(half.steps[..], whole.steps[..half.steps.len()]);
        assert!(Recording::from_bytes(&bytes[..20]).is_err());
        assert!(Recording::from_bytes(b"MThd").is_err());
    }

    #[test]
    fn a_recording_of_another_version_is_refused_by_its_version() {
        assert!(check_schema(br#"{"schema":1,"mode":"real"}"#).unwrap_err().contains("version 1"));
        let (_, mut bytes) = sample();
        let schema = format!(r#""schema":{SCHEMA}"#);
        let at = bytes.windows(schema.len()).position(|part| part == schema.as_bytes()).unwrap();
        bytes[at + schema.len() - 1] = b'1';
        assert!(Recording::from_bytes(&bytes).unwrap_err().contains("version 1"));
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 48, ..Default::default() })]
        #[test]
        fn damage_never_panics(at in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..20)) {
            let (_, mut bytes) = sample();
            for (index, value) in at {
                let index = index.index(bytes.len());
                bytes[index] = value;
            }
            let _ = Recording::from_bytes(&bytes);
        }
    }
}
