//! The periodic reports of the controller (ufactory_docs): on port 30003, 100 a second, or on port
//! 30000 (firmware 2.1 and newer), 250 a second, which carry the time at the controller. Their
//! sizes tell them apart.

use std::time::Duration;

use super::codec::floats;
use super::framing::Framing;
use super::kinematics::{ARM_JOINTS, WIDEST_LIMITS_RAD};

/// Time from one report of port 30003 to the next.
pub(super) const REPORT_PERIOD: Duration = Duration::from_millis(10);
/// Bytes of a report of port 30003, without what later firmware appends.
const SIZE: usize = 87;
/// Bytes of a report of port 30000, without what later firmware appends. Reports of all other ports
/// are shorter (587 at most).
const TIMED_SIZE: usize = 784;
/// Largest plausible size word.
const MAX_SIZE: usize = 1024;
/// Where a report of port 30000 has the joints where they were sent, and as they are.
const TIMED_TARGET: usize = 32;
const TIMED_JOINTS: usize = 116;

/// What the driver reads of a report. The pose and the torques after the joints are not looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// State of the arm: 1 moving, 2 ready, 3 paused, 4 stopped, 5 reset, 6 stopping.
    pub state: u8,
    /// Mode: 0 planned moves, 1 servo, 2 by hand.
    pub mode: u8,
    /// Joints, rad.
    pub joints_rad: [f32; ARM_JOINTS],
    /// The time at the controller, which only port 30000 gives.
    pub sent_at: Option<Duration>,
    /// Where the joints were sent, rad, which only port 30000 gives.
    pub target_rad: Option<[f32; ARM_JOINTS]>,
}

/// Beyond what any model's joints reach, rad: encoders and stops have some play. An angle farther
/// out was not measured.
const SLACK_RAD: f64 = 0.2;

/// Whether every reported joint angle is possible.
fn possible_joints(joints_rad: &[f32; ARM_JOINTS]) -> bool {
    joints_rad.iter().zip(WIDEST_LIMITS_RAD).all(|(angle, (lowest, highest))| {
        (lowest - SLACK_RAD..=highest + SLACK_RAD).contains(&f64::from(*angle))
    })
}

impl Report {
    /// Reads a whole frame; `None` if it is too short, or holds what no report can.
    fn read(frame: &[u8]) -> Option<Self> {
        // The size comes first, and on port 30000 the time, in microseconds.
        let (_size, mut rest) = frame.split_first_chunk::<4>()?;
        let mut sent_at = None;
        if frame.len() >= TIMED_SIZE {
            let (&time, others) = rest.split_first_chunk()?;
            (sent_at, rest) = (Some(Duration::from_micros(u64::from_be_bytes(time))), others);
        }
        // Then state and mode, and the length of the queue.
        let (&[state_and_mode, _, _], rest) = rest.split_first_chunk()?;
        let joints_rad = floats(if sent_at.is_some() { frame.get(TIMED_JOINTS..)? } else { rest })?;
        let target_rad = sent_at.and_then(|_| floats(frame.get(TIMED_TARGET..)?));
        let (state, mode) = (state_and_mode & 0x0F, state_and_mode >> 4);
        // The modes and states that xArm-Python-SDK accepts.
        let possible = state <= 9 && mode <= 11 && possible_joints(&joints_rad);
        possible.then_some(Self { state, mode, joints_rad, sent_at, target_rad })
    }
}

/// Finds the reports in a stream of bytes, however it is cut up.
#[derive(Debug, Default)]
pub struct ReportParser {
    framing: Framing,
    /// The size of the first report, which all later ones have too.
    size: Option<usize>,
}

impl ReportParser {
    /// The next report. Takes bytes off the front of `bytes` as it needs them: call it again until
    /// it returns `None`.
    pub fn next(&mut self, bytes: &mut &[u8]) -> Option<Report> {
        let first = self.size;
        let size = |header: &[u8]| {
            let size = u32::from_be_bytes(*header.first_chunk()?) as usize;
            let possible = first.map_or((SIZE..=MAX_SIZE).contains(&size), |first| size == first);
            possible.then_some(size)
        };
        let read = |frame: &[u8]| Some((Report::read(frame)?, frame.len()));
        let (report, size) = self.framing.next(bytes, 4, size, read)?;
        self.size = Some(size);
        Some(report)
    }

    /// Bytes that belonged to no report: anything but 0 means that the other side uses another
    /// protocol.
    pub fn skipped(&self) -> u64 {
        self.framing.skipped()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn any_report() -> impl Strategy<Value = Report> {
        let joints = prop::array::uniform7(0.0..1.0_f64).prop_map(|shares| {
            std::array::from_fn(|joint| {
                let (lowest, highest) = WIDEST_LIMITS_RAD[joint];
                (lowest + (highest - lowest) * shares[joint]) as f32
            })
        });
        (0..10_u8, 0..12_u8, joints).prop_map(|(state, mode, joints_rad)| Report {
            state,
            mode,
            joints_rad,
            sent_at: None,
            target_rad: None,
        })
    }

    /// The frame of a report by the documented offsets, with so many bytes of later firmware.
    fn frame(report: &Report, longer: usize) -> Vec<u8> {
        let timed = report.sent_at.is_some();
        let (size, state_at, joints_at) = if timed { (TIMED_SIZE, 12, 116) } else { (SIZE, 4, 7) };
        let mut frame = vec![0xA5; size + longer];
        frame[..4].copy_from_slice(&((size + longer) as u32).to_be_bytes());
        if let Some(at) = report.sent_at {
            frame[4..12].copy_from_slice(&(at.as_micros() as u64).to_be_bytes());
        }
        frame[state_at] = report.state | report.mode << 4;
        frame[joints_at..joints_at + 28]
            .copy_from_slice(report.joints_rad.map(f32::to_le_bytes).as_flattened());
        if let Some(target_rad) = report.target_rad {
            frame[32..60].copy_from_slice(target_rad.map(f32::to_le_bytes).as_flattened());
        }
        frame
    }

    /// An angle is valid up to its stop and a little farther, and each joint has its own range.
    #[test]
    fn impossible_angles_are_rejected() {
        let report = |joint: usize, angle: f64| {
            let mut report =
                Report { state: 2, mode: 1, joints_rad: [0.0; 7], sent_at: None, target_rad: None };
            report.joints_rad[joint] = angle as f32;
            Report::read(&frame(&report, 0)).is_some()
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
            mut reports in prop::collection::vec(any_report(), 1..5), longer in 0..240_usize, cut in 1..300_usize,
            sent_us in prop::option::of(any::<u64>()),
        ) {
            for report in &mut reports {
                report.sent_at = sent_us.map(Duration::from_micros);
                report.target_rad = sent_us.map(|_| report.joints_rad.map(|angle| angle + 0.01));
            }
            let stream: Vec<u8> = reports.iter().flat_map(|report| frame(report, longer)).collect();
            let (mut parser, mut found) = (ReportParser::default(), Vec::new());
            for mut piece in stream.chunks(cut) {
                while let Some(report) = parser.next(&mut piece) {
                    found.push(report);
                }
            }
            prop_assert_eq!(found, reports);
            prop_assert_eq!(parser.skipped(), 0);
        }

        #[test]
        fn garbage_passes(garbage in prop::collection::vec(prop_oneof![Just(0_u8), any::<u8>()], 0..3000)) {
            let mut parser = ReportParser::default();
            let mut bytes = garbage.as_slice();
            while let Some(report) = parser.next(&mut bytes) {
                prop_assert!(possible_joints(&report.joints_rad));
            }
            prop_assert!(bytes.is_empty() && parser.framing.buffered() <= MAX_SIZE);
        }
    }
}
