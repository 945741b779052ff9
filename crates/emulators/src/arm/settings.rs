//! What clients can set on the emulated controller.

use std::collections::BTreeMap;
use std::f32::consts::{FRAC_PI_2, PI};

use etude_checks::settings;
use etude_robot::xarm::kinematics::{ARM_JOINTS, WIDEST_LIMITS_RAD};

use super::motion::MAX_SPEED;

/// Standard Denavit-Hartenberg rows (ufactory_docs, kinematics): offset (rad), d (mm), alpha (rad),
/// a (mm).
pub(super) const DH_MM_RAD: [[f32; 4]; ARM_JOINTS] = [
    [0.0, 267.0, -FRAC_PI_2, 0.0],
    [0.0, 0.0, FRAC_PI_2, 0.0],
    [0.0, 293.0, FRAC_PI_2, 52.5],
    [0.0, 0.0, FRAC_PI_2, 77.5],
    [0.0, 342.5, FRAC_PI_2, 0.0],
    [0.0, 0.0, -FRAC_PI_2, 76.0],
    [0.0, 97.0, 0.0, 0.0],
];
settings! {
    /// What clients set, and what the slow reports tell of it. By default the motors are off, with
    /// the limits of the xArm user manual.
    #[derive(Clone, Copy, Debug)]
    pub(super) struct Settings {
        /// Bit i: joint i + 1 is enabled, and its brake released.
        pub enabled: u8 = 0;
        /// Controller error and warning, 0 for none.
        pub error: u8 = 0;
        pub warning: u8 = 0;
        /// Offset of the tool from the flange, as on the wire: mm and rad.
        pub tcp_offset_mm_rad: [f32; 6] = [0.0; 6];
        /// Payload, kg, and its centre, mm.
        pub payload_kg_mm: [f32; 4] = [0.0; 4];
        /// How easily a collision is seen, 0 (off) to 5.
        pub collision_sensitivity: u8 = 3;
        /// Limits of the tool's moves (mm, s) and of the joints' (rad, s): jerk, smallest and
        /// largest acceleration, smallest and largest speed.
        pub tcp_limits_mm: [f32; 5] = [7000.0, 0.0, 50_000.0, 0.0, 1000.0];
        pub joint_limits_rad: [f32; 5] = [11_459_f32.to_radians(), 0.0, 1145_f32.to_radians(), 0.0, PI];
    }
}

settings! {
    /// What clients set with registers that our driver does not use; by default as delivered. The
    /// safe level is a guess.
    #[derive(Clone, Debug)]
    pub(super) struct Extra {
        /// How easily the arm follows the hand, 1 to 5.
        pub teach_sensitivity: u8 = 3;
        /// Direction of gravity in the frame of the base.
        pub gravity: [f32; 3] = [0.0, 0.0, -1.0];
        /// Offset of the base, as on the wire: mm and rad.
        pub world_offset_mm_rad: [f32; 6] = [0.0; 6];
        /// Reduced mode: whether it is on, its limits of speed, and its ranges of the joints.
        pub reduced: bool = false;
        pub reduced_tcp_mm_s: f32 = 1000.0;
        pub reduced_joint_rad_s: f32 = MAX_SPEED as f32;
        pub reduced_ranges_rad: [[f32; 2]; ARM_JOINTS] = WIDEST_LIMITS_RAD.map(|(low, high)| [low as f32, high as f32]);
        pub rebound: bool = false;
        pub safe_level: u8 = 4;
        pub approximate: bool = true;
        /// 1: the reports have currents in place of torques.
        pub currents_for_torques: u8 = 0;
        pub continuous: bool = false;
        pub self_collision: bool = false;
        /// Shape of the tool for the check of self-collision.
        pub tool_model: u8 = 0;
        pub tool_size_mm: [f32; 6] = [0.0; 6];
        pub simulated: bool = false;
        pub counter: u32 = 0;
        /// Whether a stop resets the outputs of the control box and of the flange.
        pub reset_io: [u8; 2] = [0; 2];
        pub dh_mm_rad: [[f32; 4]; ARM_JOINTS] = DH_MM_RAD;
        /// Registers 232 and 233: value of each type as it is set.
        pub common: BTreeMap<u8, Vec<u8>> = BTreeMap::new();
        pub trajectories: Vec<Vec<u8>> = Vec::new();
        pub trajectory_status: u8 = 0;
    }
}

impl Extra {
    /// The bits of byte 494 of the rich report.
    pub(super) fn bits(&self, has_box: bool) -> u8 {
        let bits = [self.reduced, has_box, self.currents_for_torques != 0, self.approximate, self.continuous];
        bits.iter().rev().fold(0, |bits, bit| bits << 1 | u8::from(*bit))
    }

    /// A common parameter (register 232): the type, then as many bytes as that type has.
    pub(super) fn set_common(&mut self, params: &[u8]) -> Option<()> {
        let (&kind, value) = params.split_first()?;
        (common_default(kind)?.len() == value.len()).then(|| drop(self.common.insert(kind, value.to_vec())))
    }

    /// A common parameter as register 233 has it: integers are set with the low byte first and read
    /// with the high one first.
    pub(super) fn common(&self, kind: u8) -> Option<Vec<u8>> {
        let mut value = self.common.get(&kind).cloned().map_or_else(|| common_default(kind), Some)?;
        if matches!(kind, 2..=5 | 11 | 13 | 15 | 16 | 24 | 25) {
            value.chunks_mut(4).for_each(<[u8]>::reverse);
        }
        Some(value)
    }
}

/// The value of a common parameter that nobody has set; `None` if there is no such type. Zero is a
/// guess for all but the first (facts: a factor of 1.2).
fn common_default(kind: u8) -> Option<Vec<u8>> {
    Some(match kind {
        1 => 1.2_f32.to_le_bytes().to_vec(),
        2..=5 | 11 | 13 | 24 | 25 => vec![0; 4],
        6 | 12 | 14 => vec![0; 24],
        7 => vec![0; 56],
        15 | 16 => vec![0; 8],
        // Modbus RTU of the flange: unit 1 at 2 Mbaud, one stop bit, no parity.
        26 => vec![1, 11, 1, 0],
        _ => return None,
    })
}
