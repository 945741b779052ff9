//! Somebody at the wires between the controller and the twin: drops, damages and invents what
//! passes, and lets the judge listen.

use std::collections::VecDeque;
use std::time::Duration;

use etude_robot::can::{CanError, CanFrame};
use etude_robot::keyboard::MidiError;
use etude_robot::wires::Wires;
use etude_robot::xarm::ArmLinkError;

use crate::dice::Dice;
use crate::judge::Judge;

/// What becomes of a frame on its way: nothing, itself, or others.
pub type AlterFrame = Box<dyn FnMut(CanFrame) -> Vec<CanFrame>>;
/// What becomes of bytes on their way.
pub type AlterBytes = Box<dyn FnMut(&mut Vec<u8>)>;

/// What is done at the wires.
pub struct Mischief {
    /// Share of frames that is lost, both ways.
    pub frame_loss: f64,
    /// What becomes of the frames from and to the hand.
    pub from_hand: Option<AlterFrame>,
    pub to_hand: Option<AlterFrame>,
    /// What becomes of the bytes that come from the arm in one poll.
    pub alter_replies: Option<AlterBytes>,
    pub alter_reports: Option<AlterBytes>,
    /// What arrives besides what the twin says.
    pub frames: VecDeque<CanFrame>,
    pub replies: Vec<u8>,
    pub reports: Vec<u8>,
    pub midi: Vec<u8>,
    /// The same, in each poll.
    pub flood: Vec<CanFrame>,
    pub midi_flood: Option<AlterBytes>,
    /// A request (register, parameters) of another client of the arm, in each poll.
    pub other_client: Vec<u8>,
    dice: Dice,
}

impl Default for Mischief {
    fn default() -> Self {
        Self {
            frame_loss: 0.0,
            from_hand: None,
            to_hand: None,
            alter_replies: None,
            alter_reports: None,
            frames: VecDeque::new(),
            replies: Vec::new(),
            reports: Vec::new(),
            midi: Vec::new(),
            flood: Vec::new(),
            midi_flood: None,
            other_client: Vec::new(),
            dice: Dice::new(1),
        }
    }
}

/// The wires with somebody at them.
pub struct Tap<'a> {
    pub now: Duration,
    pub inner: &'a mut dyn Wires,
    pub mischief: &'a mut Mischief,
    pub judge: &'a mut Judge,
}

impl Wires for Tap<'_> {
    fn send_frame(&mut self, frame: CanFrame) -> Result<(), CanError> {
        self.judge.frame(&frame);
        if self.mischief.dice.chance(self.mischief.frame_loss) {
            return Ok(());
        }
        match &mut self.mischief.to_hand {
            None => self.inner.send_frame(frame),
            Some(alter) => alter(frame).into_iter().try_for_each(|frame| self.inner.send_frame(frame)),
        }
    }

    fn next_frame(&mut self) -> Result<Option<CanFrame>, CanError> {
        while let Some(frame) = self.inner.next_frame()? {
            let mischief = &mut *self.mischief;
            if mischief.dice.chance(mischief.frame_loss) {
                continue;
            }
            match &mut mischief.from_hand {
                None => return Ok(Some(frame)),
                Some(alter) => mischief.frames.extend(alter(frame)),
            }
        }
        Ok(self.mischief.frames.pop_front())
    }

    fn send_arm(&mut self, bytes: &[u8]) -> Result<(), ArmLinkError> {
        self.judge.arm_bytes(self.now, bytes);
        self.inner.send_arm(bytes)
    }

    fn receive_arm(&mut self, bytes: &mut Vec<u8>) -> Result<(), ArmLinkError> {
        bytes.append(&mut self.mischief.replies);
        receive(bytes, &mut self.mischief.alter_replies, |bytes| self.inner.receive_arm(bytes))
    }

    fn receive_report(&mut self, bytes: &mut Vec<u8>) -> Result<(), ArmLinkError> {
        bytes.append(&mut self.mischief.reports);
        receive(bytes, &mut self.mischief.alter_reports, |bytes| self.inner.receive_report(bytes))
    }

    fn receive_midi(&mut self, bytes: &mut Vec<u8>) -> Result<(), MidiError> {
        self.inner.receive_midi(bytes)?;
        bytes.append(&mut self.mischief.midi);
        if let Some(flood) = &mut self.mischief.midi_flood {
            flood(bytes);
        }
        Ok(())
    }
}

/// Receives bytes, and does to them what is to be done.
fn receive(
    bytes: &mut Vec<u8>,
    alter: &mut Option<AlterBytes>,
    from: impl FnOnce(&mut Vec<u8>) -> Result<(), ArmLinkError>,
) -> Result<(), ArmLinkError> {
    let mut new = Vec::new();
    from(&mut new)?;
    if let Some(alter) = alter.as_mut().filter(|_| !new.is_empty()) {
        alter(&mut new);
    }
    bytes.append(&mut new);
    Ok(())
}
