//! The arm that carries the hand, as points along its links in the simulator's world.

use etude_perform::Recording;
use etude_robot::xarm::kinematics::{ARM_JOINTS, forward, jacobian};
use etude_stage::FLANGE_END;
use etude_stage::hand::MOUNT;
use nalgebra::Vector3;
use serde::Serialize;

use super::rewards::rounded;

/// Radius of the tube that is drawn from each point to the next, m (our choice; the xArm7 looks
/// like this).
const RADII: [f64; POINTS - 1] = [0.058, 0.05, 0.048, 0.046, 0.042, 0.038, 0.029];
/// Base, shoulder, end of the upper arm, elbow, begin of the forearm, wrist, last axis, flange.
const POINTS: usize = 8;

/// The arm of a robot. Lengths in m.
#[derive(Clone, Debug, Serialize)]
pub struct Arm {
    /// Radius of the tube from each point to the next.
    pub radii: Vec<f64>,
    /// The points, a row a control step, x, y and z of each in a row.
    pub points: Vec<Vec<f64>>,
}

/// The arm at the end of each of `steps` control steps; none if the recording has no reports of an
/// arm.
pub(super) fn arm(recording: &Recording, steps: usize, control_hz: f64) -> Option<Arm> {
    let reports: Vec<(f64, [f64; ARM_JOINTS], f64)> = recording
        .arm
        .iter()
        .filter_map(|(secs, report)| {
            let joints = <[f64; ARM_JOINTS]>::try_from(report.measured.as_slice()).ok()?;
            // At 0 s are also those of the way to the keyboard.
            let counts = *secs > 0.0 && joints.iter().all(|joint| joint.is_finite());
            counts.then_some((*secs, joints, report.rail_m))
        })
        .collect();
    let place = place(&reports)?;
    let row = |step: usize| {
        let secs = (step + 1) as f64 / control_hz;
        let next = reports.partition_point(|(at, _, _)| *at < secs).min(reports.len() - 1);
        let joints = &reports[next].1;
        points(joints)
            .iter()
            .flat_map(|point| <[f64; 3]>::from(turned(*point) + place))
            .map(rounded)
            .collect()
    };
    Some(Arm { radii: RADII.to_vec(), points: (0..steps).map(row).collect() })
}

/// Where the arm's base stands in the world. The arm looks at the keyboard from the player's side:
/// its x is the keyboard's -x. The hand's mount gives the rest, in the median of the reports, since
/// a robot may still come or already leave in some.
fn place(reports: &[(f64, [f64; ARM_JOINTS], f64)]) -> Option<Vector3<f64>> {
    let place = |(_, joints, rail): &(f64, [f64; ARM_JOINTS], f64)| {
        let flange = Vector3::new(MOUNT[0] - FLANGE_END[2], *rail, MOUNT[1] - FLANGE_END[0]);
        flange - turned(forward(joints).position_m)
    };
    let places: Vec<Vector3<f64>> = reports.iter().map(place).collect();
    let median = |axis: usize| {
        let mut values: Vec<f64> = places.iter().map(|place| place[axis]).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied()
    };
    Some(Vector3::new(median(0)?, median(1)?, median(2)?))
}

/// Half a turn about the vertical axis.
fn turned(point: Vector3<f64>) -> Vector3<f64> {
    Vector3::new(-point.x, -point.y, point.z)
}

/// A joint's axis: a point on it and its direction.
type Axis = (Vector3<f64>, Vector3<f64>);

/// Points of the links in the frame of the arm's base.
fn points(joints: &[f64; ARM_JOINTS]) -> [Vector3<f64>; POINTS] {
    let flange = forward(joints).position_m;
    let jacobian = jacobian(joints);
    let axes: [Axis; ARM_JOINTS] = std::array::from_fn(|joint| {
        let column = jacobian.column(joint);
        let (speed, axis) = (column.fixed_rows::<3>(0).into_owned(), column.fixed_rows::<3>(3).into_owned());
        // The speed of the flange is axis × (flange − point), of which this leaves the part across
        // the axis.
        (flange - speed.cross(&axis), axis)
    });
    let near = |on: usize, to: usize| nearest(axes[on - 1], axes[to - 1]);
    [Vector3::zeros(), near(2, 1), near(3, 4), near(4, 3), near(5, 4), near(5, 6), near(7, 6), flange]
}

/// The point of `on` that is nearest to `to`. Neighbouring axes of the arm are never parallel.
fn nearest((point, axis): Axis, (other, direction): Axis) -> Vector3<f64> {
    let across = axis.cross(&direction);
    let along = (other - point).cross(&direction).dot(&across) / across.norm_squared();
    point + along * axis
}

#[cfg(test)]
mod tests {
    use etude_perform::ArmMessage;
    use etude_robot::xarm::kinematics::PAPER_HOME_DEG;

    use super::*;

    /// Lengths in the maker's drawing, m (ufactory_docs, kinematics).
    const LENGTHS: [f64; POINTS - 1] = [0.267, 0.293, 0.0525, 0.0775, 0.3425, 0.076, 0.097];

    #[test]
    fn links_have_the_makers_lengths_however_the_arm_bends() {
        for shift in 0..50 {
            let joints = PAPER_HOME_DEG.map(f64::to_radians);
            let joints =
                std::array::from_fn(|joint| joints[joint] + (f64::from(shift) * (joint as f64 + 1.3)).sin());
            let points = points(&joints);
            for (link, length) in LENGTHS.into_iter().enumerate() {
                let found = (points[link + 1] - points[link]).norm();
                assert!((found - length).abs() < 1e-9, "link {link} is {found} m long");
            }
            assert!((points[POINTS - 1] - forward(&joints).position_m).norm() < 1e-12);
        }
    }

    #[test]
    fn the_arm_holds_the_hand() {
        let report = |secs: f64, elbow: f64| {
            let mut measured = PAPER_HOME_DEG.map(f64::to_radians).to_vec();
            measured[3] += elbow;
            (secs, ArmMessage { measured, sent: None, rail_m: 0.1 })
        };
        // On its way to the keyboard it is elsewhere.
        let way = (0..9).map(|index| report(0.0, 0.1 * f64::from(index)));
        let song = [report(0.01, 0.0), report(0.02, 0.0), report(0.03, 0.0), report(0.04, 0.5)];
        let mut recording = Recording { arm: way.chain(song).collect(), ..Recording::default() };
        recording.arm.push(report(0.2, 0.0));
        let found = arm(&recording, 3, 20.0).unwrap();
        assert_eq!((found.points.len(), found.points[0].len()), (3, 3 * POINTS));
        let flange = &found.points[2][3 * (POINTS - 1)..];
        let expected = [MOUNT[0] - FLANGE_END[2], 0.1, MOUNT[1] - FLANGE_END[0]];
        assert!(flange.iter().zip(expected).all(|(ours, theirs)| (ours - theirs).abs() < 1e-4), "{flange:?}");
        // The base stands on the player's side.
        assert!(found.points[0][0] > 0.6);
        recording.arm.clear();
        assert!(arm(&recording, 3, 20.0).is_none());
    }
}
