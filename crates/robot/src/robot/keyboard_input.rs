//! The keyboard of a robot: its connection, and what is heard of it.

use std::time::Duration;

use super::fault::Fault;
use super::record::{Journal, Record};
use crate::keyboard::{KeyChange, Keyboard, KeyboardState, KeyboardWarning};
use crate::rig_file::{RigConfig, RigError};
use crate::wires::Wires;

/// The keyboard's driver and its connection.
pub(super) struct KeyboardInput {
    pub keyboard: Keyboard,
    is_connected: bool,
    changes: Vec<KeyChange>,
    /// Warnings that are in the journal.
    noted: Vec<KeyboardWarning>,
}

impl KeyboardInput {
    pub fn new(config: &RigConfig) -> Result<Self, RigError> {
        let keyboard = Keyboard::new(&config.keyboard)?;
        Ok(Self { keyboard, is_connected: false, changes: Vec::new(), noted: Vec::new() })
    }

    /// Receives what has arrived, and records each key.
    pub fn receive(
        &mut self,
        now: Duration,
        wires: &mut dyn Wires,
        bytes: &mut Vec<u8>,
        journal: &mut Journal,
    ) {
        bytes.clear();
        self.changes.clear();
        let is_connected = wires.receive_midi(bytes).is_ok();
        if is_connected != self.is_connected {
            self.is_connected = is_connected;
            if is_connected {
                self.keyboard.connected(now, &mut self.changes);
            } else {
                self.keyboard.disconnected(now, &mut self.changes);
            }
        }
        if is_connected {
            self.keyboard.receive(now, bytes, &mut self.changes);
        }
        self.keyboard.poll(now, &mut self.changes);
        for change in &self.changes {
            journal.push(Record::Key(*change));
        }
        let noted = &mut self.noted;
        let is_new = |new: &KeyboardWarning| !noted.iter().any(|old| old.is_about_the_same(new));
        let new: Vec<KeyboardWarning> = self.keyboard.warnings().filter(is_new).collect();
        for warning in new {
            journal.push(Record::Note { at: now, kind: "warning", text: warning.to_string() });
            self.noted.push(warning);
        }
    }

    /// The fault of a keyboard that is not there.
    pub fn check_present(&self) -> Result<(), Fault> {
        let state = self.keyboard.state();
        if state == KeyboardState::Present { Ok(()) } else { Err(Fault::Keyboard(state.to_string())) }
    }

    /// The fault of a keyboard that was there.
    pub fn lost(&self) -> Option<Fault> {
        let state = self.keyboard.state();
        matches!(state, KeyboardState::Lost { .. }).then(|| Fault::Keyboard(state.to_string()))
    }
}
