//! Receives what a rig measures: keeps the key events in memory and writes everything to the
//! recording, if there is one.

use std::time::Duration;

use etude_music::{KeyEvent, LOWEST_PITCH};
use etude_robot::{Pace, Record, Robot};

use crate::error::RecordingError;
use crate::messages::{ArmMessage, EventMessage, HandMessage, KeyMessage, Message, SetPointMessage};
use crate::timing::Timing;
use crate::writer::RecordingWriter;

/// Receives what a rig measures during a performance.
pub struct Recorder<'a> {
    writer: Option<&'a mut RecordingWriter>,
    /// Strikes and releases since the beginning.
    pub events: Vec<KeyEvent>,
}

impl<'a> Recorder<'a> {
    /// A recorder that writes into `writer`, if there is one.
    pub fn new(writer: Option<&'a mut RecordingWriter>) -> Self {
        Self { writer, events: Vec::new() }
    }

    /// Writes what a device measured at `device_secs` of the robot's clock, which is `secs` of the
    /// performance.
    ///
    /// # Errors
    /// If writing fails.
    fn measured<M: Message>(
        &mut self,
        [secs, device_secs]: [f64; 2],
        message: impl FnOnce() -> M,
    ) -> Result<(), RecordingError> {
        let Some(writer) = &mut self.writer else { return Ok(()) };
        writer.begun_secs = device_secs - secs;
        writer.write_measured(secs, device_secs, &message())
    }

    /// Takes a key event. An event before time zero (while a robot is prepared) is written, but not
    /// kept in `events`.
    ///
    /// # Errors
    /// If writing fails.
    pub fn key(&mut self, event: KeyEvent) -> Result<(), RecordingError> {
        if event.secs >= 0.0 {
            self.events.push(event);
        }
        let KeyEvent { secs, key, velocity } = event;
        let early_secs = self.writer.as_ref().map_or(0.0, |writer| writer.latency_compensation_secs);
        let pitch = LOWEST_PITCH + key as u8;
        self.write(secs, || KeyMessage { secs: secs - early_secs, pitch, velocity })
    }

    /// Writes a message at `secs`. `message` is called only if there is a recording.
    ///
    /// # Errors
    /// If writing fails.
    pub fn write<M: Message>(
        &mut self,
        secs: f64,
        message: impl FnOnce() -> M,
    ) -> Result<(), RecordingError> {
        self.writer.as_mut().map_or(Ok(()), |writer| writer.write(secs, &message()))
    }
}

/// Lets `write` write what the robot has recorded since the last call, while the robot is
/// controlled: a disk that hangs does not hold it up.
///
/// # Errors
/// If writing fails.
pub(crate) fn take_records(
    robot: &mut Robot,
    pace: &mut dyn Pace,
    mut write: impl FnMut(&[Record]) -> Result<(), RecordingError> + Send,
) -> Result<(), RecordingError> {
    let records: Vec<Record> = robot.records().collect();
    let mut written = Ok(());
    pace.run_while(robot, &mut || written = write(&records));
    written
}

/// Passes the records of a robot on to a [`Recorder`].
pub(crate) struct RobotRecords {
    begun: Duration,
}

impl RobotRecords {
    /// Times are counted from `begun`.
    pub(crate) fn since(begun: Duration) -> Self {
        Self { begun }
    }

    /// The robot's time that is zero in the recording.
    pub(crate) fn begun(&self) -> Duration {
        self.begun
    }

    /// Passes records on; `timing` receives the periods of the hand.
    ///
    /// # Errors
    /// If writing fails.
    pub(crate) fn write_all(
        &self,
        records: &[Record],
        recorder: &mut Recorder<'_>,
        timing: &mut Timing,
    ) -> Result<(), RecordingError> {
        for record in records {
            if let Record::Hand { at, .. } = record
                && *at >= self.begun
            {
                timing.hand(*at);
            }
            self.write(record, recorder)?;
        }
        Ok(())
    }

    fn write(&self, record: &Record, recorder: &mut Recorder<'_>) -> Result<(), RecordingError> {
        let secs = |at: &Duration| {
            let device_secs = at.as_secs_f64();
            [device_secs - self.begun.as_secs_f64(), device_secs]
        };
        match record {
            Record::Key(change) => {
                let [secs, _] = secs(&change.at);
                recorder.key(KeyEvent { secs, key: change.key, velocity: change.velocity })
            }
            Record::SetPoint { at, asked, sent, clamps } => recorder.measured(secs(at), || SetPointMessage {
                asked: asked.to_vec(),
                sent: sent.to_vec(),
                clamps: clamps.iter().map(|(joint, clamp)| (*joint, clamp.name().to_string())).collect(),
            }),
            Record::Hand { at, positions, reference, wanted, pwm } => {
                recorder.measured(secs(at), || HandMessage {
                    positions: positions.to_vec(),
                    reference: reference.to_vec(),
                    wanted: wanted.iter().map(|pwm| (pwm * 10.0).round() / 10.0).collect(),
                    pwm: pwm.to_vec(),
                })
            }
            Record::Idle { at, positions } => recorder.measured(secs(at), || HandMessage {
                positions: positions.to_vec(),
                reference: positions.to_vec(),
                wanted: vec![0.0; positions.len()],
                pwm: vec![0; positions.len()],
            }),
            Record::Arm { at, measured, sent, rail_m } => recorder.measured(secs(at), || ArmMessage {
                measured: measured.to_vec(),
                sent: sent.map(|joints| joints.to_vec()),
                rail_m: *rail_m,
            }),
            Record::Note { at, kind, text } => {
                recorder.measured(secs(at), || EventMessage { kind: (*kind).to_string(), text: text.clone() })
            }
        }
    }
}
