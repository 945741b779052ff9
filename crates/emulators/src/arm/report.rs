//! The reports of the emulated controller (ufactory_docs): their bytes.

use etude_robot::xarm::codec::push_floats;
use etude_robot::xarm::kinematics::{ARM_JOINTS, jacobian, logarithm};
use nalgebra::SVector;

use super::emulator::ArmEmulator;
use super::lines::{CURRENTS_A, TEMPERATURES_C, VOLTS};
use super::state::ReportKind;

/// Reports of each kind that wait to be taken at most, in bytes.
const MAX_WAITING: usize = 1 << 14;

impl ArmEmulator {
    /// Adds a report to those that wait, if there is room.
    pub(super) fn push_report(&mut self, kind: ReportKind) {
        let full = self.waiting.get(kind as usize).is_none_or(|waiting| waiting.len() >= MAX_WAITING);
        if self.mute || full {
            return;
        }
        let (settings, extra, (_, size, _)) = (&self.settings, &self.extra, kind.numbers());
        let mut report = Vec::with_capacity(size);
        report.extend((size as u32).to_be_bytes());
        if kind == ReportKind::Control {
            report.extend((self.clock * 1000).to_be_bytes());
        }
        report.push(self.state() | self.mode << 4);
        report.extend((self.queue.len() as u16).to_be_bytes());
        if kind == ReportKind::Control {
            self.push_motion(&mut report);
        } else {
            push_floats(&mut report, &self.motion.joints.map(|angle| angle as f32));
            push_floats(&mut report, &self.tool().to_wire());
            push_floats(&mut report, &self.torques());
        }
        if matches!(kind, ReportKind::Normal | ReportKind::Rich) {
            report.extend([settings.enabled, settings.enabled, settings.error, settings.warning]);
            push_floats(&mut report, &settings.tcp_offset_mm_rad);
            push_floats(&mut report, &settings.payload_kg_mm);
            report.extend([settings.collision_sensitivity, extra.teach_sensitivity]);
            push_floats(&mut report, &extra.gravity);
        }
        if kind == ReportKind::Rich {
            self.push_rest(&mut report);
        }
        report.resize(size, 0);
        if let Some(waiting) = self.waiting.get_mut(kind as usize) {
            waiting.append(&mut report);
        }
    }

    /// The report of port 30000 from its byte 15 on. The targets of speed and pose are what they
    /// are, and no acceleration, torque or force is emulated.
    fn push_motion(&self, report: &mut Vec<u8>) {
        let joints = self.motion.joints.map(|angle| angle as f32);
        let speeds = self.motion.speeds().map(|speed| speed as f32);
        let target = self.motion.target().map(|angle| angle as f32);
        let tool = self.tool();
        let turn = logarithm(&tool.rotation);
        let [x, y, z, ..] = tool.to_wire();
        let pose = [x, y, z, turn.x as f32, turn.y as f32, turn.z as f32];
        let mut twist = self.twist().map(|value| value as f32);
        twist.iter_mut().take(3).for_each(|metres| *metres *= 1e3);
        for (at, values) in [
            (32, &target[..]),
            (60, &speeds),
            (116, &joints),
            (144, &speeds),
            (200, &CURRENTS_A),
            (424, &pose),
            (448, &twist),
            (472, &pose),
            (496, &twist),
        ] {
            report.resize(at, 0);
            push_floats(report, values);
        }
    }

    /// Speed of the flange, m/s and rad/s.
    fn twist(&self) -> [f64; 6] {
        (jacobian(&self.motion.joints) * SVector::from(self.motion.speeds())).into()
    }

    /// Torques of the joints, which are not emulated, or their currents where those were asked for.
    fn torques(&self) -> [f32; ARM_JOINTS] {
        if self.extra.currents_for_torques == 0 { [0.0; ARM_JOINTS] } else { CURRENTS_A }
    }

    /// The rich report from its byte 145 on.
    fn push_rest(&self, report: &mut Vec<u8>) {
        let (settings, extra, lines) = (&self.settings, &self.extra, &self.lines);
        // Type and axes, then what the controller calls its master, its slave and its motors.
        report.extend([ARM_JOINTS as u8, ARM_JOINTS as u8, 0xAA, 0x55, 0, 0]);
        report.extend(self.config.firmware.bytes().chain(std::iter::repeat(0)).take(30));
        push_floats(report, &settings.tcp_limits_mm);
        push_floats(report, &settings.joint_limits_rad);
        // Jerk and acceleration of turns, which are not documented, and status and code of each
        // servo and of the flange.
        report.resize(245, 0);
        report.extend(TEMPERATURES_C);
        let speeds = self.motion.speeds();
        let [x, y, z, ..] = self.twist();
        push_floats(report, &[x.hypot(y).hypot(z) as f32 * 1e3]);
        push_floats(report, &speeds.map(|speed| speed as f32));
        report.extend(extra.counter.to_be_bytes());
        push_floats(report, &extra.world_offset_mm_rad);
        report.extend(extra.reset_io);
        report.extend([extra.simulated.into(), extra.self_collision.into(), extra.tool_model]);
        push_floats(report, &extra.tool_size_mm);
        report.extend([((VOLTS * 100.0) as u16).to_be_bytes(); ARM_JOINTS].as_flattened());
        push_floats(report, &CURRENTS_A);
        report.extend([0, 0]);
        report.extend(lines.words().map(u16::to_be_bytes).as_flattened());
        report.extend(lines.function_bytes());
        // Forces, of which there is no sensor, and the share of an identification that is done.
        report.resize(482, 0);
        let turn = logarithm(&self.tool().rotation);
        push_floats(report, &[turn.x, turn.y, turn.z].map(|angle| angle as f32));
        report.push(extra.bits(self.has_box));
        // Then alarms of inputs and devices beside the arm, of which there are none.
        report.extend(self.reduced_mode());
    }
}
