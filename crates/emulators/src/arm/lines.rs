//! Inputs and outputs of the emulated control box and flange, and the servos' own registers.

use etude_checks::settings;
use etude_robot::xarm::kinematics::ARM_JOINTS;

/// Temperature of each servo, °C, current, A, and voltage, V: plausible constants for an arm that
/// stands.
pub(super) const TEMPERATURES_C: [u8; ARM_JOINTS] = [36, 37, 35, 36, 34, 33, 33];
pub(super) const CURRENTS_A: [f32; ARM_JOINTS] = [0.1, 1.6, 0.3, 1.2, 0.1, 0.3, 0.05];
pub(super) const VOLTS: f32 = 48.0;
/// Version of a servo and of the flange's board: three numbers from this address on. Ours are made
/// up.
const VERSION_AT: u16 = 0x0801;
const VERSION: [i32; 3] = [2, 8, 2];
settings! {
    /// What the control box and the flange are given.
    #[derive(Clone, Copy, Debug)]
    pub(super) struct Lines {
        /// Outputs of the control box, of the flange, and functions of the box's 16 inputs and 16
        /// outputs.
        pub digital: u16 = 0;
        pub analog: [u16; 2] = [0; 2];
        pub flange: u16 = 0;
        pub functions: [[u8; 16]; 2] = [[0; 16]; 2];
        /// Index of the baud rate of the flange's line and of the box's.
        pub bauds: [u8; 2] = [11; 2];
    }
}

impl Lines {
    /// Two bytes set up to eight outputs: the high one tells which, the low one how.
    pub(super) fn set(outputs: u16, word: u16, shift: u32) -> u16 {
        let mask = (word >> 8) << shift;
        outputs & !mask | ((word & 0xFF) << shift) & mask
    }

    /// Inputs, which pull themselves up, and outputs, as the report and register 139 have them.
    pub(super) fn words(&self) -> [u16; 8] {
        let [first, second] = self.analog;
        [0xFFFF, 0xFFFF, self.digital, self.digital, 0, 0, first, second]
    }

    /// The functions, as the report and register 139 have them: eight inputs, eight outputs, and
    /// the next eight of each.
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

/// A register of a servo; `None` for other devices than the seven servos and the force sensor (8),
/// which is not there.
pub(super) fn servo(device: u8, address: u16) -> Option<i32> {
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
pub(super) fn version(address: u16) -> i32 {
    address.checked_sub(VERSION_AT).and_then(|at| VERSION.get(usize::from(at))).map_or(0, |number| *number)
}
