//! Whatever a correction asks for, the robot is sent nothing beyond the limits of its rig.

#![allow(clippy::unwrap_used, reason = "a test that cannot continue has failed")]

use std::sync::atomic::AtomicBool;

use etude_lab::{
    RobotPlay, RobotStep, SongPlanner, find_song, load_player, play_on_robot, run_file, shipped_policy,
};
use etude_music::CONTROL_HZ;
use etude_perform::session::rig_choice;
use etude_perform::{Correction, Ending, Job, Mode, Recording};
use etude_robot::joints::{DRIVEN, RAIL};
use etude_robot::rig_file::SETPOINT_HZ;
use etude_stage::{DRIVEN_JOINTS, PHYSICS_STEPS};
use proptest::prelude::*;

/// Control steps of Twinkle.
const STEPS: usize = 181;
/// Rounding of the places in a recording and of their differences, in the largest limit's share.
const ROUNDING: f64 = 1.001;

proptest! {
    #![proptest_config(ProptestConfig { cases: 4, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_limiter_bounds_what_is_sent(
        jumps in prop::collection::vec((1..40usize, prop::array::uniform13(-1.0..1.0f64)), 400),
        mode in prop::sample::select(&[Mode::JointMirroring, Mode::Hybrid][..]),
    ) {
        // Offsets that jump at any time, larger than any that is learned.
        let mut offsets: Vec<[f64; DRIVEN_JOINTS]> = vec![[0.0; DRIVEN_JOINTS]; PHYSICS_STEPS];
        for (ticks, values) in jumps {
            let mut values = values;
            values[RAIL] *= 0.05;
            offsets.extend(std::iter::repeat_n(values, ticks));
        }
        offsets.resize(STEPS * PHYSICS_STEPS, [0.0; DRIVEN_JOINTS]);
        let correction: Correction = serde_json::from_value(serde_json::to_value(&offsets).unwrap()).unwrap();

        let folder = tempfile::tempdir().unwrap();
        let rig = rig_choice("twin", "standard").unwrap();
        let player = load_player(&shipped_policy("twinkle").unwrap()).unwrap();
        let song = find_song("twinkle", false).unwrap();
        let play = RobotPlay {
            correction: Some(correction),
            ..RobotPlay::new(&song, &player, &rig, mode)
        };
        let (never, mut silent) = (AtomicBool::new(false), |_: &RobotStep| {});
        let mut job = Job::new(&mut silent, &never);
        let report = play_on_robot(&play, Some(folder.path()), &mut SongPlanner::default(), &mut job).unwrap();
        // The twin may stop itself, which is a bound too.
        let whole = report.runs[0].ending == Ending::Complete;
        prop_assert!(!whole || report.runs[0].clamped > 0, "nothing tested the limiter");

        let recording = Recording::read(&folder.path().join("latest").join(run_file(0, "mcap"))).unwrap();
        // While it plays: what comes before is recorded at time 0, and once stopped it holds the
        // measured place.
        let followed = report.runs[0].steps[0].saturating_sub(1) as f64 / CONTROL_HZ;
        let sent: Vec<&[f64]> = recording
            .setpoints
            .iter()
            .filter(|(secs, _)| *secs > 0.0 && *secs < followed)
            .map(|(_, point)| point.sent.as_slice())
            .collect();
        prop_assert!(sent.len() > 20);
        let axes = rig.config().axes();
        let difference = |column: &[f64]| -> Vec<f64> {
            column.windows(2).map(|pair| (pair[1] - pair[0]) * SETPOINT_HZ).collect()
        };
        for joint in 0..DRIVEN {
            let axis = if joint == RAIL { axes[axes.len() - 1] } else { axes[joint] };
            let places: Vec<f64> = sent.iter().map(|sent| sent[joint]).collect();
            let velocities = difference(&places);
            let accelerations = difference(&velocities);
            let jerks = difference(&accelerations);
            for place in &places {
                prop_assert!(*place >= axis.position[0] - 1e-7 && *place <= axis.position[1] + 1e-7, "{joint}: {place}");
            }
            for (values, most) in
                [(&velocities, axis.velocity), (&accelerations, axis.acceleration), (&jerks, axis.jerk)]
            {
                let largest = values.iter().fold(0.0f64, |most, value| most.max(value.abs()));
                prop_assert!(largest <= most * ROUNDING, "joint {joint}: {largest} of {most}");
            }
        }
    }
}
