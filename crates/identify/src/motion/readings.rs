//! The readings of a recording: positions and duties of the joints, and whether a fit can use them.

use etude_perform::{HandMessage, Recording};
use etude_robot::allegro::RAD_PER_COUNT;
use etude_robot::joints::HAND_DRIVEN_JOINTS;
use etude_robot::rig_file::SETPOINT_HZ;
use etude_stage::{DRIVEN_JOINTS, JOINT_NAMES, RAIL};

/// Longest gap between readings, s.
const MAX_GAP_SECS: f64 = 0.1;
/// Largest share of control steps whose command may have been a physics step late or more.
const MAX_LATE_SHARE: f64 = 0.01;
/// Duties that differ by more were cut, of 1200.
const CUT_PWM: f64 = 2.0;
/// Readings before the motion from which the start and the noise are taken.
const REST_READINGS: usize = 60;
/// Noise of the rail's readings at least: the arm's report holds single-precision angles of joints,
/// m.
const RAIL_NOISE_M: f64 = 2e-5;

pub(super) type FingerReadings = Vec<(f64, [f64; HAND_DRIVEN_JOINTS])>;

/// Readings of the fingers before the first command, and from then to the end.
pub(super) fn finger_readings(
    recording: &Recording,
    secs: f64,
) -> Result<(FingerReadings, FingerReadings), String> {
    let readings: Option<FingerReadings> = recording
        .hand
        .iter()
        .map(|(at, message)| Some((*at, *message.positions.first_chunk::<HAND_DRIVEN_JOINTS>()?)))
        .collect();
    let readings = readings.ok_or("a reading of the hand in it has too few joints; record it again")?;
    // Readings before the start have the time 0.
    let first = readings.partition_point(|(at, _)| *at <= 0.0);
    let end = readings.partition_point(|(at, _)| *at <= secs);
    Ok((readings[..first].to_vec(), readings[first..end.max(first)].to_vec()))
}

/// Duties of the last `count` periods that ended by `secs`, those of the readings of the fingers.
pub(super) fn duties(recording: &Recording, count: usize, secs: f64) -> Vec<[f64; HAND_DRIVEN_JOINTS]> {
    let end = recording.hand.partition_point(|(at, _)| *at <= secs);
    let duty =
        |message: &HandMessage, joint: usize| message.pwm.get(joint).map_or(0.0, |&pwm| f64::from(pwm));
    let of = |message: &HandMessage| std::array::from_fn(|joint| duty(message, joint));
    recording.hand[end.saturating_sub(count)..end].iter().map(|(_, message)| of(message)).collect()
}

pub(super) fn rail_readings(recording: &Recording, secs: f64) -> (Vec<f64>, Vec<(f64, f64)>) {
    let before = recording.arm.iter().filter(|(at, _)| *at <= 0.0).map(|(_, arm)| arm.rail_m).collect();
    let inside = recording.arm.iter().filter(|(at, _)| *at > 0.0 && *at <= secs);
    (before, inside.map(|(at, arm)| (*at, arm.rail_m)).collect())
}

/// Refuses recordings with gaps or late commands.
pub(super) fn check_times(
    recording: &Recording,
    fingers: &FingerReadings,
    rail: &[(f64, f64)],
    secs: f64,
) -> Result<(), String> {
    let rail: Vec<f64> = rail.iter().map(|(at, _)| *at).collect();
    let fingers: Vec<f64> = fingers.iter().map(|(at, _)| *at).collect();
    for (who, times) in [("hand", fingers), ("arm", rail)] {
        let all: Vec<f64> = [0.0].into_iter().chain(times).chain([secs]).collect();
        let gap = all.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
        if gap > MAX_GAP_SECS {
            return Err(format!(
                "it is badly timed: {:.0} ms without a reading of the {who}; record it on a quieter machine or mend the link",
                gap * 1e3
            ));
        }
    }
    let late =
        recording.policy.iter().filter(|message| message.command_late_secs > 1.0 / SETPOINT_HZ).count();
    if late as f64 > MAX_LATE_SHARE * recording.policy.len() as f64 {
        return Err(format!(
            "it is badly timed: {late} of {} commands were late; record it on a quieter machine",
            recording.policy.len()
        ));
    }
    Ok(())
}

/// Refuses recordings in which a drive was at its limit for a larger share of the time than
/// `max_share`.
pub(super) fn check_limits(recording: &Recording, secs: f64, max_share: f64) -> Result<(), String> {
    for (joint, name) in JOINT_NAMES.iter().enumerate().take(HAND_DRIVEN_JOINTS) {
        let cut = |message: &HandMessage| {
            let [wanted, sent] =
                [message.wanted.get(joint).copied(), message.pwm.get(joint).map(|&pwm| f64::from(pwm))];
            wanted.zip(sent).is_some_and(|(wanted, sent)| (wanted - sent).abs() > CUT_PWM)
        };
        let (inside, cut) = recording
            .hand
            .iter()
            .filter(|(at, _)| *at > 0.0 && *at <= secs)
            .fold((0usize, 0usize), |(all, cuts), (_, message)| (all + 1, cuts + usize::from(cut(message))));
        if cut as f64 > max_share * inside as f64 {
            return Err(format!(
                "it is saturated: the drive of {name} was at its limit for {:.0} % of the time; move less or slower",
                100.0 * cut as f64 / inside as f64
            ));
        }
    }
    Ok(())
}

/// Mean and standard deviation of the readings just before the first command.
pub(super) fn at_rest(
    fingers: &FingerReadings,
    rail: &[f64],
) -> Result<([f64; DRIVEN_JOINTS], [f64; DRIVEN_JOINTS]), String> {
    let fingers = &fingers[fingers.len().saturating_sub(REST_READINGS)..];
    let rail = &rail[rail.len().saturating_sub(REST_READINGS / 4)..];
    if fingers.is_empty() || rail.is_empty() {
        return Err(
            "it does not show where the joints were before the first command; record it again".to_string()
        );
    }
    let statistics = |joint: usize| {
        let values: Vec<f64> = match joint {
            RAIL => rail.to_vec(),
            _ => fingers.iter().map(|(_, angles)| angles[joint]).collect(),
        };
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let variance =
            values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
        // The readings of a joint at rest may be constant; the noise is at least that of one count.
        let least = if joint == RAIL { RAIL_NOISE_M } else { RAD_PER_COUNT / 12f64.sqrt() };
        (mean, variance.sqrt().max(least))
    };
    Ok((std::array::from_fn(|joint| statistics(joint).0), std::array::from_fn(|joint| statistics(joint).1)))
}
