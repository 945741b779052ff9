//! Registers of inputs, outputs and servos, and of the two RS-485 lines, to which nothing is
//! connected.

use super::answers::Answer;
use super::emulator::ArmEmulator;
use super::lines::{Lines, servo, version};

/// Highest index of a baud rate; 11 stands for 2 Mbaud.
const MAX_BAUD: u8 = 12;
/// Addresses on the RS-485 lines: the gripper behind the flange's board, that board itself, and the
/// control box.
const GRIPPER: u8 = 8;
const FLANGE: u8 = 9;
const BOX: u8 = 11;

impl ArmEmulator {
    /// Reads an input, sets an output, or asks a servo or an accessory. `None` if it cannot.
    pub(super) fn line(&mut self, register: u8, params: &[u8]) -> Option<Answer> {
        let byte = |at: usize| params.get(at).copied();
        let word = |at: usize| Some(u16::from_be_bytes([byte(at)?, byte(at + 1)?]));
        let lines = &mut self.lines;
        let mut reply = Vec::new();
        match register {
            101 | 103 => drop(byte(6).filter(|_| matches!(params[0], 1..=8))?),
            102 | 104 | 107 => {
                let value = servo(byte(0)?, word(1)?)?;
                reply.extend(value.to_be_bytes());
            }
            // The zero of a servo: the emulated one keeps its own.
            105 => drop(byte(0).filter(|servo| (1..=8).contains(servo))?),
            124 | 241 => return self.accessory(byte(0)?),
            // Errors of the gripper.
            125 => return self.accessory(FLANGE),
            127..=130 => return self.board(register, params),
            131 => reply.extend(0xFFFF_u16.to_be_bytes()),
            132 | 133 => reply.extend([0, 0]),
            134 => {
                lines.digital = Lines::set(lines.digital, word(0)?, 0);
                if let Some(next) = word(2) {
                    lines.digital = Lines::set(lines.digital, next, 8);
                }
            }
            135 | 136 => lines.analog[usize::from(register - 135)] = word(0)?,
            137 | 138 => {
                *lines.functions[usize::from(register - 137)].get_mut(usize::from(byte(0)?))? = byte(1)?;
            }
            139 => {
                reply.extend([0, 0]);
                reply.extend(lines.words().map(u16::to_be_bytes).as_flattened());
                reply.extend(lines.function_bytes());
            }
            // Outputs that are set later, or at a place: at once here.
            142 | 144 => {
                let (which, on) = (byte(0).filter(|which| *which < 16)?, byte(1)? != 0);
                lines.digital = lines.digital & !(1 << which) | u16::from(on) << which;
            }
            143 | 145 => {
                let (which, on) = (byte(0).filter(|which| *which < 4)?, byte(1)? != 0);
                lines.flange = lines.flange & !(1 << which) | u16::from(on) << which;
            }
            147 => *lines.analog.get_mut(usize::from(byte(0)?))? = word(1)?,
            _ => return None,
        }
        Some(Answer::Done(reply))
    }

    /// Registers of the flange's board, and of whatever is behind it: a device, an address, and a
    /// float to write.
    fn board(&mut self, register: u8, params: &[u8]) -> Option<Answer> {
        let (device, low, high) = (*params.first()?, *params.get(2)?, *params.get(1)?);
        let address = u16::from_be_bytes([high, low]);
        let line = match device {
            GRIPPER => return self.accessory(FLANGE),
            FLANGE => 0,
            BOX => 1,
            _ => return None,
        };
        let lines = &mut self.lines;
        if matches!(register, 127 | 129) {
            let value = f32::from_le_bytes(params.get(3..7)?.try_into().ok()?);
            match address {
                0x1A0B => lines.bauds[line] = (value as u8).min(MAX_BAUD),
                0x0A15 => lines.flange = Lines::set(lines.flange, value as u16, 0),
                _ => {}
            }
            return Some(Answer::Done(Vec::new()));
        }
        let value = match address {
            0x0A0B => i32::from(lines.bauds[line]),
            0x0A18 => lines.flange.into(),
            // Inputs, and what is not known.
            _ => version(address),
        };
        Some(Answer::Done(value.to_be_bytes().to_vec()))
    }

    /// Nothing answers on the line: the controller raises its error of that line, 19 at the flange
    /// and 111 at the box.
    fn accessory(&mut self, line: u8) -> Option<Answer> {
        match line {
            FLANGE => self.inject_error(19),
            BOX => self.inject_error(111),
            _ => return None,
        }
        Some(Answer::Done(vec![line]))
    }
}
