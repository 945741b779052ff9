//! The additional content of the slow reports (30001, 30002; ufactory_docs).

use super::kinematics::JOINTS;

/// What 30001 and 30002 add to a report. All zero in the others.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Details {
    /// Bit i: the brake of joint i + 1 is released.
    pub brakes: u8,
    /// Bit i: joint i + 1 is enabled.
    pub enabled: u8,
    /// Controller error, 0 for none.
    pub error: u8,
    /// Controller warning, 0 for none.
    pub warning: u8,
    /// Offset of the tool from the flange, as on the wire: mm and rad.
    pub tcp_offset_mm_rad: [f32; 6],
    /// Payload, kg, and its centre, mm.
    pub payload_kg_mm: [f32; 4],
    /// How easily a collision is seen, 0 (off) to 5.
    pub collision_sensitivity: u8,
    /// How easily the arm follows the hand, 1 to 5.
    pub teach_sensitivity: u8,
    /// Direction of gravity.
    pub gravity: [f32; 3],
    /// 30002: limits of the tool's moves, mm and s.
    pub tcp_limits_mm: MotionLimits,
    /// 30002: limits of the joints' moves, rad and s.
    pub joint_limits_rad: MotionLimits,
    /// 30002: status and code of each servo.
    pub servos: [[u8; 2]; JOINTS],
}

/// The limits of planned moves in 30002.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotionLimits {
    /// Jerk.
    pub jerk: f32,
    /// Smallest and largest acceleration.
    pub acceleration: [f32; 2],
    /// Smallest and largest speed.
    pub speed: [f32; 2],
}

impl MotionLimits {
    pub(super) fn to_wire(self) -> [f32; 5] {
        let ([slowest, fastest], [least, most]) = (self.speed, self.acceleration);
        [self.jerk, least, most, slowest, fastest]
    }

    pub(super) fn from_wire([jerk, least, most, slowest, fastest]: [f32; 5]) -> Self {
        Self { jerk, acceleration: [least, most], speed: [slowest, fastest] }
    }
}
