//! Inputs and outputs of the emulated control box and flange, the servos' own registers, and the two RS-485 lines, to which
//! nothing is connected.

use etude_robot::xarm::kinematics::JOINTS;

use super::ArmEmulator;
use super::answers::Answer;

/// Temperature of each servo, °C, current, A, and voltage, V: plausible constants for an arm that stands.
pub(super) const TEMPERATURES_C: [u8; JOINTS] = [36, 37, 35, 36, 34, 33, 33];
pub(super) const CURRENTS_A: [f32; JOINTS] = [0.1, 1.6, 0.3, 1.2, 0.1, 0.3, 0.05];
pub(super) const VOLTS: f32 = 48.0;
/// Version of a servo and of the flange's board: three numbers from this address on. Ours are made up.
const VERSION_AT: u16 = 0x0801;
const VERSION: [i32; 3] = [2, 8, 2];
/// Highest index of a baud rate; 11 stands for 2 Mbaud.
const HIGHEST_BAUD: u8 = 12;
/// Addresses on the RS-485 lines: the gripper behind the flange's board, that board itself, and the control box.
const GRIPPER: u8 = 8;
const FLANGE: u8 = 9;
const BOX: u8 = 11;

/// What the control box and the flange are given.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lines {
    /// Outputs of the control box, of the flange, and functions of the box's 16 inputs and 16 outputs.
    pub digital: u16,
    pub analog: [u16; 2],
    pub flange: u16,
    pub functions: [[u8; 16]; 2],
    /// Index of the baud rate of the flange's line and of the box's.
    bauds: [u8; 2],
}

impl Default for Lines {
    fn default() -> Self {
        Self { digital: 0, analog: [0; 2], flange: 0, functions: [[0; 16]; 2], bauds: [11; 2] }
    }
}

impl Lines {
    /// Two bytes set up to eight outputs: the high one tells which, the low one how.
    fn set(outputs: u16, word: u16, shift: u32) -> u16 {
        let mask = (word >> 8) << shift;
        outputs & !mask | ((word & 0xFF) << shift) & mask
    }

    /// Inputs, which pull themselves up, and outputs, as the report and register 139 have them.
    pub(super) fn words(&self) -> [u16; 8] {
        let [first, second] = self.analog;
        [0xFFFF, 0xFFFF, self.digital, self.digital, 0, 0, first, second]
    }

    /// The functions, as the report and register 139 have them: eight inputs, eight outputs, and the next eight of each.
    pub(super) fn function_bytes(&self) -> [u8; 32] {
        let [inputs, outputs] = self.functions;
        let mut bytes = [0; 32];
        for (to, from) in bytes.chunks_mut(8).zip([&inputs[..8], &outputs[..8], &inputs[8..], &outputs[8..]])
        {
            to.copy_from_slice(from);
        }
        bytes
    }
}

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

    /// Registers of the flange's board, and of whatever is behind it: a device, an address, and a float to write.
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
                0x1A0B => lines.bauds[line] = (value as u8).min(HIGHEST_BAUD),
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

    /// Nothing answers on the line: the controller raises its error of that line, 19 at the flange and 111 at the box.
    fn accessory(&mut self, line: u8) -> Option<Answer> {
        match line {
            FLANGE => self.inject_error(19),
            BOX => self.inject_error(111),
            _ => return None,
        }
        Some(Answer::Done(vec![line]))
    }
}

/// A register of a servo; `None` for other devices than the seven servos and the force sensor (8), which is not there.
fn servo(device: u8, address: u16) -> Option<i32> {
    let joint = match device {
        1..=7 => usize::from(device - 1),
        // The force sensor's error: 27 says that there is none.
        8 if address == 0x0010 => return Some(27),
        _ => return None,
    };
    Some(match address {
        0x0003 => (CURRENTS_A[joint] * 100.0) as i32,
        0x000E => TEMPERATURES_C[joint].into(),
        0x0018 => (VOLTS * 100.0) as i32,
        _ => version(address),
    })
}

/// A version's number, or 0 for any other address.
fn version(address: u16) -> i32 {
    address.checked_sub(VERSION_AT).and_then(|at| VERSION.get(usize::from(at))).map_or(0, |number| *number)
}
