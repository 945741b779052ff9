//! Settings of the emulated controller that our driver does not use: every register of
//! xarm-python-sdk 1.18.4 that sets one of them, and every one that reads it back.

use etude_robot::xarm::SafetyBox;
use etude_robot::xarm::codec::{floats, push_floats};
use etude_robot::xarm::kinematics::ARM_JOINTS;

use super::answers::Answer;
use super::emulator::ArmEmulator;
use super::motion::MAX_SPEED;
use super::settings::{DH_MM_RAD, Extra, Settings};

/// Trajectories that are kept at most.
const MAX_TRAJECTORIES: usize = 16;
/// Status of a trajectory file in register 65.
const LOADED: u8 = 2;
const LOAD_FAILED: u8 = 3;
const SAVED: u8 = 5;

/// Floats that are numbers.
pub(super) fn numbers<const N: usize>(params: &[u8]) -> Option<[f32; N]> {
    floats(params).filter(|values| values.iter().all(|value| value.is_finite()))
}

impl ArmEmulator {
    /// Sets or reads a setting. `None` if the register is none of a setting, or its parameters are
    /// wrong.
    pub(super) fn setting(&mut self, register: u8, params: &[u8]) -> Option<Answer> {
        let byte = |at: usize| params.get(at).copied();
        let flag = |at: usize| byte(at).map(|value| value != 0);
        let mut reply = Vec::new();
        let extra = &mut self.extra;
        match register {
            // Verification of the controller: it is the maker's own.
            3 => reply.push(0),
            // Dynamics are loaded again, the configuration is saved, timers: nothing that a client
            // could see.
            4 | 40 | 71 | 72 => {}
            5 => reply.push(extra.currents_for_torques),
            6 => push_floats(&mut reply, &[0.0]),
            7 => reply.push(extra.approximate.into()),
            10 if byte(0)? == 1 || byte(0)? == 2 => {}
            // Brakes, of one joint or of all.
            18 => drop(byte(1).filter(|_| matches!(params[0], 1..=8))?),
            38 => {
                extra.teach_sensitivity = byte(0).filter(|value| (1..=5).contains(value))?;
                self.reset();
            }
            39 => self.clean_configuration(),
            47 => extra.reduced_tcp_mm_s = numbers::<1>(params)?[0].max(0.0),
            48 => extra.reduced_joint_rad_s = numbers::<1>(params)?[0].clamp(0.0, MAX_SPEED as f32),
            49 => reply.push(extra.reduced.into()),
            50 => extra.reduced = flag(0)?,
            51 => extra.gravity = numbers(params)?,
            55 => push_floats(&mut reply, &[0.0; ARM_JOINTS]),
            56 => extra.safe_level = byte(0)?,
            57 => reply.push(extra.safe_level),
            58 => {
                let ranges: [f32; 2 * ARM_JOINTS] = numbers(params)?;
                extra.reduced_ranges_rad = ranges.as_chunks().0.try_into().ok()?;
            }
            60 => extra.rebound = flag(0)?,
            61..=65 => return self.trajectory(register, params),
            66 => extra.approximate = flag(0)?,
            67 => push_floats(&mut reply, extra.dh_mm_rad.as_flattened()),
            68 if byte(112)? > 2 => extra.dh_mm_rad = DH_MM_RAD,
            68 => {
                let values: [f32; 4 * ARM_JOINTS] = numbers(params)?;
                extra.dh_mm_rad = values.as_chunks().0.try_into().ok()?;
            }
            69 => reply.push(self.motion.moving().into()),
            70 => extra.currents_for_torques = byte(0)?,
            73 => {
                extra.world_offset_mm_rad = numbers(params)?;
                self.reset();
            }
            74 => extra.counter = 0,
            75 => extra.counter = extra.counter.wrapping_add(1),
            77 => extra.self_collision = flag(0)?,
            78 => return self.tool_model(params),
            79 => extra.simulated = flag(0)?,
            80 => extra.continuous = flag(0)?,
            // Seven servos and the gripper: status and code of each.
            106 => reply.resize(16, 0),
            // Time-outs of the flange's RS-485 line, which register 233 reads back, ms.
            123 | 240 => {
                let word = u16::from_be_bytes([byte(0)?, byte(1)?]);
                let kind = if register == 123 { 4 } else { 5 };
                extra.common.insert(kind, u32::from(word).to_le_bytes().to_vec());
            }
            // Power board: version; types of the hardware.
            140 => reply.extend([1, 0, 0, 0, 0, 0]),
            141 => reply.extend([0, 0]),
            146 => *extra.reset_io.get_mut(usize::from(byte(0)?))? = flag(1)?.into(),
            // No joint of a trajectory was too fast.
            230 => reply.resize(16, 0),
            // The highest joint speed for a speed of the tool.
            231 => push_floats(&mut reply, &[MAX_SPEED as f32]),
            232 => extra.set_common(params)?,
            233 => reply = extra.common(byte(0)?)?,
            // What led to an error: nothing is known of any.
            234 => {
                let bytes = match byte(0)? {
                    1 | 2 => 1,
                    50 => 4,
                    101 | 107 => 9,
                    102 | 104 => 5,
                    105 => 8,
                    103 | 106 => 29,
                    _ => return None,
                };
                reply.resize(bytes, 0);
            }
            _ => return None,
        }
        Some(Answer::Done(reply))
    }

    /// All settings as delivered, with those of our driver among them. What is no setting stays:
    /// errors, trajectories, the counter.
    fn clean_configuration(&mut self) {
        let Extra { simulated, counter, trajectories, trajectory_status, .. } =
            std::mem::take(&mut self.extra);
        self.extra = Extra { simulated, counter, trajectories, trajectory_status, ..Extra::default() };
        let Settings { enabled, error, warning, .. } = self.settings;
        self.settings = Settings { enabled, error, warning, ..Settings::default() };
        (self.safety_box, self.has_box) = (SafetyBox::WIDEST, false);
        self.reset();
    }

    /// The tool's model: its type, after six sizes for a box (22) or five for a cylinder (21).
    fn tool_model(&mut self, params: &[u8]) -> Option<Answer> {
        let (kind, sizes) = params.split_last()?;
        let count = sizes.len() / 4;
        if !sizes.len().is_multiple_of(4) || count > 6 {
            return None;
        }
        let mut padded = [0; 24];
        padded[..sizes.len()].copy_from_slice(sizes);
        (self.extra.tool_model, self.extra.tool_size_mm) = (*kind, numbers(&padded)?);
        Some(Answer::Done(Vec::new()))
    }

    /// Recorded trajectories. Only their names are kept: none is recorded, and playing one takes no
    /// time.
    fn trajectory(&mut self, register: u8, params: &[u8]) -> Option<Answer> {
        let extra = &mut self.extra;
        let name = params.split(|byte| *byte == 0).next().filter(|name| !name.is_empty());
        match register {
            61 => drop(params.first()?),
            62 => {
                let name = name?.to_vec();
                if extra.trajectories.len() < MAX_TRAJECTORIES && !extra.trajectories.contains(&name) {
                    extra.trajectories.push(name);
                }
                extra.trajectory_status = SAVED;
            }
            63 => {
                let known = name.is_some_and(|name| extra.trajectories.iter().any(|known| known == name));
                extra.trajectory_status = if known { LOADED } else { LOAD_FAILED };
            }
            64 if extra.trajectory_status != LOADED => return None,
            64 => {}
            _ => return Some(Answer::Done(vec![extra.trajectory_status])),
        }
        Some(Answer::Done(Vec::new()))
    }

    /// Result of the last operation on a trajectory as feedback has it: 1 after a failure.
    pub(super) fn trajectory_result(&self) -> u8 {
        u8::from(self.extra.trajectory_status == LOAD_FAILED)
    }
}
