//! What clients can set on the emulated controller.

use std::collections::BTreeMap;
use std::f32::consts::FRAC_PI_2;

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
/// What clients set, and what the slow reports tell of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Settings {
    /// Bit i: joint i + 1 is enabled, and its brake released.
    pub enabled: u8,
    /// Controller error and warning, 0 for none.
    pub error: u8,
    pub warning: u8,
    /// Offset of the tool from the flange, as on the wire: mm and rad.
    pub tcp_offset_mm_rad: [f32; 6],
    /// Payload, kg, and its centre, mm.
    pub payload_kg_mm: [f32; 4],
    /// How easily a collision is seen, 0 (off) to 5.
    pub collision_sensitivity: u8,
    /// Limits of the tool's moves (mm, s) and of the joints' (rad, s): jerk, smallest and largest
    /// acceleration, smallest and largest speed.
    pub tcp_limits_mm: [f32; 5],
    pub joint_limits_rad: [f32; 5],
}

impl Default for Settings {
    /// Motors off; limits as in the xArm user manual.
    fn default() -> Self {
        let [jerk, acceleration] = [11_459_f32, 1145.0].map(f32::to_radians);
        Self {
            enabled: 0,
            error: 0,
            warning: 0,
            tcp_offset_mm_rad: [0.0; 6],
            payload_kg_mm: [0.0; 4],
            collision_sensitivity: 3,
            tcp_limits_mm: [7000.0, 0.0, 50_000.0, 0.0, 1000.0],
            joint_limits_rad: [jerk, 0.0, acceleration, 0.0, std::f32::consts::PI],
        }
    }
}

/// What clients set with registers that our driver does not use.
#[derive(Clone, Debug)]
pub(super) struct Extra {
    /// How easily the arm follows the hand, 1 to 5.
    pub teach_sensitivity: u8,
    /// Direction of gravity in the frame of the base.
    pub gravity: [f32; 3],
    /// Offset of the base, as on the wire: mm and rad.
    pub world_offset_mm_rad: [f32; 6],
    /// Reduced mode: whether it is on, its limits of speed, and its ranges of the joints.
    pub reduced: bool,
    pub reduced_tcp_mm_s: f32,
    pub reduced_joint_rad_s: f32,
    pub reduced_ranges_rad: [[f32; 2]; ARM_JOINTS],
    pub rebound: bool,
    pub safe_level: u8,
    pub approximate: bool,
    /// 1: the reports have currents in place of torques.
    pub currents_for_torques: u8,
    pub continuous: bool,
    pub self_collision: bool,
    /// Shape of the tool for the check of self-collision.
    pub tool_model: u8,
    pub tool_size_mm: [f32; 6],
    pub simulated: bool,
    pub counter: u32,
    /// Whether a stop resets the outputs of the control box and of the flange.
    pub reset_io: [u8; 2],
    pub dh_mm_rad: [f32; 4 * ARM_JOINTS],
    /// Registers 232 and 233: value of each type as it is set.
    pub common: BTreeMap<u8, Vec<u8>>,
    pub trajectories: Vec<Vec<u8>>,
    pub trajectory_status: u8,
}

impl Default for Extra {
    /// As delivered. The safe level is a guess.
    fn default() -> Self {
        let mut dh_mm_rad = [0.0; 4 * ARM_JOINTS];
        dh_mm_rad.copy_from_slice(DH_MM_RAD.as_flattened());
        Self {
            teach_sensitivity: 3,
            gravity: [0.0, 0.0, -1.0],
            world_offset_mm_rad: [0.0; 6],
            reduced: false,
            reduced_tcp_mm_s: 1000.0,
            reduced_joint_rad_s: MAX_SPEED as f32,
            reduced_ranges_rad: WIDEST_LIMITS_RAD.map(|(low, high)| [low as f32, high as f32]),
            rebound: false,
            safe_level: 4,
            approximate: true,
            currents_for_torques: 0,
            continuous: false,
            self_collision: false,
            tool_model: 0,
            tool_size_mm: [0.0; 6],
            simulated: false,
            counter: 0,
            reset_io: [0; 2],
            dh_mm_rad,
            common: BTreeMap::new(),
            trajectories: Vec::new(),
            trajectory_status: 0,
        }
    }
}

impl Extra {
    /// The bits of byte 494 of the rich report.
    pub(super) fn bits(&self, fenced: bool) -> u8 {
        let bits = [self.reduced, fenced, self.currents_for_torques != 0, self.approximate, self.continuous];
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
