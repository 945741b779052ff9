//! The periodic reports of the controller: port 30003 at 100 Hz, 30001 and 30002 at 5 Hz (ufactory_docs).

use super::codec::{floats, push_floats};
pub use super::details::{Details, MotionLimits};
use super::framing::Framing;
use super::kinematics::{JOINTS, WIDEST_LIMITS_RAD};

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

    /// Its TCP port.
    pub fn port(self) -> u16 {
        match self {
            Self::Real => 30003,
            Self::Normal => 30001,
            Self::Rich => 30002,
        }
    }

    /// Bytes of a frame without what later firmware appends, and with what is written here.
    fn size(self) -> usize {
        match self {
            Self::Real => 87,
            Self::Normal => 145,
            Self::Rich => 245,
        }
    }

    /// Time from one frame to the next, ms.
    pub fn period_ms(self) -> u64 {
        if self == Self::Real { 10 } else { 200 }
    }
}

/// Largest plausible size word; the longest known report has 587 bytes.
const MAX_SIZE: usize = 1024;

/// One report.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// State of the arm: 1 moving, 2 ready, 3 paused, 4 stopped, 5 reset, 6 stopping.
    pub state: u8,
    /// Mode: 0 planned moves, 1 servo, 2 by hand.
    pub mode: u8,
    /// Commands in the queue.
    pub queue: u16,
    /// Joints, rad.
    pub joints_rad: [f32; JOINTS],
    /// Pose of the tool, as on the wire: x, y, z in mm, then roll, pitch, yaw in rad.
    pub pose_mm_rad: [f32; 6],
    /// Torques, N m.
    pub torques_nm: [f32; JOINTS],
    /// What 30001 and 30002 add.
    pub details: Details,
}

/// Beyond what any model's joints reach, rad: encoders and stops have some play. An angle farther out was not measured.
const SLACK_RAD: f64 = 0.2;

/// Whether every reported joint angle is possible.
fn possible_joints(joints_rad: &[f32; JOINTS]) -> bool {
    joints_rad.iter().zip(WIDEST_LIMITS_RAD).all(|(angle, (lowest, highest))| {
        (lowest - SLACK_RAD..=highest + SLACK_RAD).contains(&f64::from(*angle))
    })
}

impl Report {
    /// Appends the frame that `kind` sends.
    pub fn write(&self, kind: ReportKind, firmware: &str, out: &mut Vec<u8>) {
        let (start, details) = (out.len(), &self.details);
        out.extend((kind.size() as u32).to_be_bytes());
        out.push(self.state & 0x0F | self.mode << 4);
        out.extend(self.queue.to_be_bytes());
        push_floats(out, &self.joints_rad);
        push_floats(out, &self.pose_mm_rad);
        push_floats(out, &self.torques_nm);
        if kind != ReportKind::Real {
            out.extend([details.brakes, details.enabled, details.error, details.warning]);
            push_floats(out, &details.tcp_offset_mm_rad);
            push_floats(out, &details.payload_kg_mm);
            out.extend([details.collision_sensitivity, details.teach_sensitivity]);
            push_floats(out, &details.gravity);
        }
        if kind == ReportKind::Rich {
            // Type and axes, then what the controller calls its master, its slave and its motors.
            out.extend([JOINTS as u8, JOINTS as u8, 0xAA, 0x55, 0, 0]);
            out.extend(firmware.bytes().chain(std::iter::repeat(0)).take(30));
            push_floats(out, &details.tcp_limits_mm.to_wire());
            push_floats(out, &details.joint_limits_rad.to_wire());
            // Jerk and acceleration of turns, which are not documented.
            push_floats(out, &[0.0; 2]);
            out.extend(details.servos.as_flattened());
        }
        out.resize(start + kind.size(), 0);
    }

    /// Reads a whole frame; `None` if it is too short, or holds what no report can.
    fn read(kind: ReportKind, frame: &[u8]) -> Option<Self> {
        let at = |offset: usize| frame.get(offset..);
        let &[.., state_and_mode, high, low] = frame.get(..7)? else { return None };
        let mut report = Self {
            state: state_and_mode & 0x0F,
            mode: state_and_mode >> 4,
            queue: u16::from_be_bytes([high, low]),
            joints_rad: floats(at(7)?)?,
            pose_mm_rad: floats(at(35)?)?,
            torques_nm: floats(at(59)?)?,
            details: Details::default(),
        };
        if kind != ReportKind::Real {
            let &[brakes, enabled, error, warning] = frame.get(87..91)? else { return None };
            let &[collision_sensitivity, teach_sensitivity] = frame.get(131..133)? else { return None };
            report.details = Details {
                brakes,
                enabled,
                error,
                warning,
                tcp_offset_mm_rad: floats(at(91)?)?,
                payload_kg_mm: floats(at(115)?)?,
                collision_sensitivity,
                teach_sensitivity,
                gravity: floats(at(133)?)?,
                ..Details::default()
            };
        }
        if kind == ReportKind::Rich {
            report.details.tcp_limits_mm = MotionLimits::from_wire(floats(at(181)?)?);
            report.details.joint_limits_rad = MotionLimits::from_wire(floats(at(201)?)?);
            report.details.servos.as_flattened_mut().copy_from_slice(frame.get(229..243)?);
        }
        // The modes and states that xArm-Python-SDK accepts.
        let possible = report.state <= 9 && report.mode <= 11;
        let details = &report.details;
        let sensible = details.collision_sensitivity <= 5 && details.teach_sensitivity <= 5;
        (possible && sensible && possible_joints(&report.joints_rad)).then_some(report)
    }
}

/// Finds the reports in a stream of bytes, however it is cut up.
#[derive(Debug)]
pub struct ReportParser {
    kind: ReportKind,
    framing: Framing,
    /// The size of the first report, which all later ones have too.
    size: Option<usize>,
}

impl ReportParser {
    /// For the stream of one port.
    pub fn new(kind: ReportKind) -> Self {
        Self { kind, framing: Framing::default(), size: None }
    }

    /// The next report. Takes bytes off the front of `bytes` as it needs them: call it again until it returns `None`.
    pub fn next(&mut self, bytes: &mut &[u8]) -> Option<Report> {
        let (kind, first) = (self.kind, self.size);
        let size = |header: &[u8]| {
            let size = u32::from_be_bytes(*header.first_chunk()?) as usize;
            let possible = first.map_or((kind.size()..=MAX_SIZE).contains(&size), |first| size == first);
            possible.then_some(size)
        };
        let read = |frame: &[u8]| Some((Report::read(kind, frame)?, frame.len()));
        let (report, size) = self.framing.next(bytes, 4, size, read)?;
        self.size = Some(size);
        Some(report)
    }

    /// Bytes that belonged to no report: anything but 0 means that the other side uses another protocol.
    pub fn skipped(&self) -> u64 {
        self.framing.skipped()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn any_report() -> impl Strategy<Value = Report> {
        let head = (0..10_u8, 0..12_u8, any::<u16>());
        let numbers = (
            prop::array::uniform7(0.0..1.0_f64).prop_map(|shares| {
                std::array::from_fn(|joint| {
                    let (lowest, highest) = WIDEST_LIMITS_RAD[joint];
                    (lowest + (highest - lowest) * shares[joint]) as f32
                })
            }),
            prop::array::uniform6(-900.0..900.0_f32),
            prop::array::uniform7(-50.0..50.0_f32),
        );
        let bytes = (any::<[u8; 4]>(), 0..=5_u8, 0..=5_u8, any::<[[u8; 2]; JOINTS]>());
        let limits = prop::array::uniform5(0.0..9e4_f32).prop_map(MotionLimits::from_wire);
        let rest = (
            prop::array::uniform6(-9.0..9.0_f32),
            prop::array::uniform4(0.0..9.0_f32),
            [limits.clone(), limits],
        );
        (head, numbers, bytes, rest).prop_map(|((state, mode, queue), numbers, bytes, rest)| Report {
            state,
            mode,
            queue,
            joints_rad: numbers.0,
            pose_mm_rad: numbers.1,
            torques_nm: numbers.2,
            details: Details {
                brakes: bytes.0[0],
                enabled: bytes.0[1],
                error: bytes.0[2],
                warning: bytes.0[3],
                tcp_offset_mm_rad: rest.0,
                payload_kg_mm: rest.1,
                collision_sensitivity: bytes.1,
                teach_sensitivity: bytes.2,
                gravity: [0.0, 0.0, -1.0],
                tcp_limits_mm: rest.2[0],
                joint_limits_rad: rest.2[1],
                servos: bytes.3,
            },
        })
    }

    /// What is left of a report on the port of this kind.
    fn as_sent(report: &Report, kind: ReportKind) -> Report {
        let mut report = *report;
        match kind {
            ReportKind::Real => report.details = Details::default(),
            ReportKind::Normal => {
                let none = Details::default();
                report.details.servos = none.servos;
                report.details.tcp_limits_mm = none.tcp_limits_mm;
                report.details.joint_limits_rad = none.joint_limits_rad;
            }
            ReportKind::Rich => {}
        }
        report
    }

    #[test]
    fn the_documented_offsets() {
        let report = Report {
            state: 2,
            mode: 1,
            queue: 0x0102,
            joints_rad: [1.0; 7],
            pose_mm_rad: [2.0; 6],
            torques_nm: [3.0; 7],
            details: Details {
                brakes: 0x7F,
                enabled: 0x7E,
                error: 23,
                warning: 11,
                tcp_offset_mm_rad: [4.0; 6],
                payload_kg_mm: [5.0; 4],
                collision_sensitivity: 3,
                teach_sensitivity: 4,
                gravity: [6.0; 3],
                tcp_limits_mm: MotionLimits { jerk: 7.0, acceleration: [8.0, 9.0], speed: [10.0, 11.0] },
                joint_limits_rad: MotionLimits {
                    jerk: 12.0,
                    acceleration: [13.0, 14.0],
                    speed: [15.0, 16.0],
                },
                servos: [[0, 9]; 7],
            },
        };
        let mut frame = Vec::new();
        report.write(ReportKind::Rich, "7,7,XS1304,AC1302,v2.4.0", &mut frame);
        assert_eq!(frame.len(), 245);
        assert_eq!(frame[..7], [0, 0, 0, 245, 0x12, 1, 2]);
        let float = |at: usize| f32::from_le_bytes(frame[at..at + 4].try_into().unwrap());
        let numbers = [7, 35, 59, 91, 115, 133].map(float);
        assert_eq!(numbers, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let limits: [f32; 10] = std::array::from_fn(|word| float(181 + 4 * word));
        assert_eq!(limits, [7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0, 16.0]);
        assert_eq!(frame[87..91], [0x7F, 0x7E, 23, 11]);
        assert_eq!((&frame[131..133], &frame[145..149]), (&[3, 4][..], &[7, 7, 0xAA, 0x55][..]));
        assert_eq!((&frame[151..154], &frame[229..231]), (&b"7,7"[..], &[0, 9][..]));
        let sizes = ReportKind::ALL.map(|kind| {
            let mut frame = Vec::new();
            report.write(kind, "", &mut frame);
            (kind.port(), frame.len())
        });
        assert_eq!(sizes, [(30003, 87), (30001, 145), (30002, 245)]);
    }

    /// An angle is valid up to its stop and a little farther, and each joint has its own range.
    #[test]
    fn impossible_angles_are_rejected() {
        let report = |joint: usize, angle: f64| {
            let mut report = Report {
                state: 2,
                mode: 1,
                queue: 0,
                joints_rad: [0.0; 7],
                pose_mm_rad: [0.0; 6],
                torques_nm: [0.0; 7],
                details: Details::default(),
            };
            report.joints_rad[joint] = angle as f32;
            let mut frame = Vec::new();
            report.write(ReportKind::Real, "", &mut frame);
            Report::read(ReportKind::Real, &frame).is_some()
        };
        // Degrees, the widest of all models (xArm user manual).
        let degrees =
            [[-360, 360], [-118, 120], [-360, 360], [-11, 225], [-360, 360], [-97, 180], [-360, 360]];
        for (joint, [low, high]) in degrees.into_iter().enumerate() {
            let [low, high] = [low, high].map(|degrees: i32| f64::from(degrees).to_radians());
            assert!(report(joint, low - 0.15) && report(joint, high + 0.15), "{joint}");
            for odd in [low - 0.25, high + 0.25, 1e9, f64::NAN, f64::NEG_INFINITY] {
                assert!(!report(joint, odd), "joint {joint} at {odd}");
            }
        }
    }

    proptest! {
        #[test]
        fn any_cut_gives_the_same_reports(
            reports in prop::collection::vec(any_report(), 1..5),
            longer in 0..300_usize,
            cut in 1..300_usize,
            kind in prop::sample::select(&ReportKind::ALL[..]),
        ) {
            // Later firmware appends fields that are not looked at.
            let mut stream = Vec::new();
            for report in &reports {
                let start = stream.len();
                report.write(kind, "v2.4.0", &mut stream);
                stream.resize(stream.len() + longer, 0xA5);
                let size = (stream.len() - start) as u32;
                stream[start..start + 4].copy_from_slice(&size.to_be_bytes());
            }
            let (mut parser, mut found) = (ReportParser::new(kind), Vec::new());
            for mut piece in stream.chunks(cut) {
                while let Some(report) = parser.next(&mut piece) {
                    found.push(report);
                }
            }
            let sent: Vec<_> = reports.iter().map(|report| as_sent(report, kind)).collect();
            prop_assert_eq!(found, sent);
            prop_assert_eq!(parser.skipped(), 0);
        }

        #[test]
        fn garbage_passes(
            garbage in prop::collection::vec(prop_oneof![Just(0_u8), any::<u8>()], 0..3000),
            kind in prop::sample::select(&ReportKind::ALL[..]),
        ) {
            let mut parser = ReportParser::new(kind);
            let mut bytes = garbage.as_slice();
            while let Some(report) = parser.next(&mut bytes) {
                prop_assert!(possible_joints(&report.joints_rad));
            }
            prop_assert!(bytes.is_empty() && parser.framing.buffered() <= MAX_SIZE);
        }
    }
}
