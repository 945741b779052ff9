//! What a robot did, on its way into a recording.

use std::time::Duration;

use etude_music::{CONTROL_HZ, KeyEvent, LOWEST_PITCH};
use etude_robot::joints::DRIVEN;
use etude_robot::{Record, Robot};
use etude_task::ACTION_LEN;

use crate::messages::{
    ArmMessage, HandMessage, KeyMessage, NoteMessage, PolicyMessage, SetPointMessage, StepMessage,
    TargetMessage,
};
use crate::performer::keys;
use crate::recording::RecordingError;
use crate::timing::Timing;
use crate::writer::RecordingWriter;

/// Takes the records of a robot, with times since `begun`.
pub struct RobotRecords<'a> {
    begun: Duration,
    writer: Option<&'a mut RecordingWriter>,
}

impl<'a> RobotRecords<'a> {
    /// Records from now on into `writer`, if there is one.
    pub fn new(begun: Duration, writer: Option<&'a mut RecordingWriter>) -> Self {
        Self { begun, writer }
    }

    fn secs(&self, at: Duration) -> f64 {
        at.as_secs_f64() - self.begun.as_secs_f64()
    }

    /// Takes what has happened since the last call; key events from the beginning on go to `events`.
    ///
    /// # Errors
    /// If writing fails.
    pub fn take(
        &mut self,
        robot: &mut Robot,
        events: &mut Vec<KeyEvent>,
        timing: &mut Timing,
    ) -> Result<(), RecordingError> {
        for record in robot.records() {
            match &record {
                Record::Key(change) if change.at >= self.begun => {
                    let secs = self.secs(change.at);
                    events.push(KeyEvent { secs, key: change.key, velocity: change.velocity });
                }
                Record::Hand { at, .. } if *at >= self.begun => timing.hand(*at),
                _ => {}
            }
            self.write(&record)?;
        }
        Ok(())
    }

    fn write(&mut self, record: &Record) -> Result<(), RecordingError> {
        let begun = self.begun.as_secs_f64();
        let Some(writer) = &mut self.writer else { return Ok(()) };
        let secs = |at: &Duration| at.as_secs_f64() - begun;
        match record {
            Record::SetPoint { at, asked, sent, clamps } => {
                let clamps = clamps.iter().map(|(joint, clamp)| (*joint, clamp.name().to_string())).collect();
                let message = SetPointMessage { asked: asked.to_vec(), sent: sent.to_vec(), clamps };
                writer.setpoint(secs(at), &message)
            }
            Record::Hand { at, positions, reference, wanted, pwm } => {
                let (positions, reference, pwm) = (positions.to_vec(), reference.to_vec(), pwm.to_vec());
                let wanted = wanted.iter().map(|pwm| (pwm * 10.0).round() / 10.0).collect();
                writer.hand(secs(at), &HandMessage { positions, reference, wanted, pwm })
            }
            Record::Arm { at, measured, sent, rail_m } => {
                let (measured, sent) = (measured.to_vec(), sent.map(|joints| joints.to_vec()));
                writer.arm(secs(at), &ArmMessage { measured, sent, rail_m: *rail_m })
            }
            Record::Key(change) => {
                let pitch = LOWEST_PITCH + change.key as u8;
                writer.key(&KeyMessage { secs: secs(&change.at), pitch, velocity: change.velocity })
            }
            Record::Note { at, kind, text } => {
                let message = NoteMessage { kind: (*kind).to_string(), text: text.clone() };
                writer.note(secs(at), &message)
            }
        }
    }

    /// The targets of a control step, before they are shaped.
    pub(crate) fn target(&mut self, step: usize, targets: &[f64; DRIVEN]) -> Result<(), RecordingError> {
        let Some(writer) = &mut self.writer else { return Ok(()) };
        let message = TargetMessage { step: step as u64, targets: targets.to_vec() };
        writer.target(step as f64 / CONTROL_HZ, &message)
    }

    /// What the policy saw and chose.
    pub(crate) fn policy(
        &mut self,
        step: usize,
        observation: &[f32],
        action: &[f32; ACTION_LEN],
        late: Duration,
    ) -> Result<(), RecordingError> {
        let Some(writer) = &mut self.writer else { return Ok(()) };
        let message = PolicyMessage {
            step: step as u64,
            observation: observation.to_vec(),
            action: action.to_vec(),
            late_secs: late.as_secs_f64(),
        };
        writer.policy(step as f64 / CONTROL_HZ, &message)
    }

    /// A control step, as it stood at its end.
    pub(crate) fn step(
        &mut self,
        step: usize,
        robot: &Robot,
        targets: &[f64; DRIVEN],
    ) -> Result<(), RecordingError> {
        let Some(writer) = &mut self.writer else { return Ok(()) };
        let message = StepMessage {
            step: step as u64,
            targets: targets.to_vec(),
            positions: robot.joints().to_vec(),
            pressed: keys(robot).pitches().collect(),
            ..StepMessage::default()
        };
        writer.step((step + 1) as f64 / CONTROL_HZ, &message)
    }
}
