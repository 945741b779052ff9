//! The reports of the emulated controller (ufactory_docs): what its settings are, and the bytes of a report.

use etude_robot::xarm::codec::push_floats;
use etude_robot::xarm::kinematics::JOINTS;

use super::ArmEmulator;

/// Reports of each kind that wait to be taken at most, in bytes.
const MAX_WAITING: usize = 1 << 14;
/// How easily the arm follows the hand, and the direction of gravity: nothing changes them.
const TEACH_SENSITIVITY: u8 = 3;
const GRAVITY: [f32; 3] = [0.0, 0.0, -1.0];

/// Which of the report ports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReportKind {
    /// Port 30003: state, joints, pose and torque at 100 Hz.
    Real,
    /// Port 30001: the same with brakes, errors and payload, at 5 Hz.
    Normal,
    /// Port 30002: the same with limits and servo errors, at 5 Hz.
    Rich,
}

impl ReportKind {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Real, Self::Normal, Self::Rich];

    /// Its TCP port, its bytes, and the time from one to the next, ms.
    pub(super) fn numbers(self) -> (u16, usize, u64) {
        match self {
            Self::Real => (30003, 87, 10),
            Self::Normal => (30001, 145, 200),
            Self::Rich => (30002, 245, 200),
        }
    }
}

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
    /// Limits of the tool's moves (mm, s) and of the joints' (rad, s): jerk, smallest and largest acceleration, smallest
    /// and largest speed.
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

impl ArmEmulator {
    /// Adds a report to those that wait, if there is room.
    pub(super) fn tell(&mut self, kind: ReportKind) {
        let (settings, (_, size, _)) = (&self.settings, kind.numbers());
        let mut report = Vec::with_capacity(size);
        report.extend((size as u32).to_be_bytes());
        report.push(self.state() | self.mode << 4);
        report.extend((self.queue.len() as u16).to_be_bytes());
        push_floats(&mut report, &self.motion.joints.map(|angle| angle as f32));
        push_floats(&mut report, &self.tool().to_wire());
        // Torques.
        push_floats(&mut report, &[0.0; JOINTS]);
        if kind != ReportKind::Real {
            report.extend([settings.enabled, settings.enabled, settings.error, settings.warning]);
            push_floats(&mut report, &settings.tcp_offset_mm_rad);
            push_floats(&mut report, &settings.payload_kg_mm);
            report.extend([settings.collision_sensitivity, TEACH_SENSITIVITY]);
            push_floats(&mut report, &GRAVITY);
        }
        if kind == ReportKind::Rich {
            // Type and axes, then what the controller calls its master, its slave and its motors.
            report.extend([JOINTS as u8, JOINTS as u8, 0xAA, 0x55, 0, 0]);
            report.extend(self.config.firmware.bytes().chain(std::iter::repeat(0)).take(30));
            push_floats(&mut report, &settings.tcp_limits_mm);
            push_floats(&mut report, &settings.joint_limits_rad);
        }
        // The rest is jerk and acceleration of turns, which are not documented, and status and code of each servo.
        report.resize(size, 0);
        if let Some(waiting) = self.waiting.get_mut(kind as usize)
            && !self.mute
            && waiting.len() < MAX_WAITING
        {
            waiting.append(&mut report);
        }
    }
}
