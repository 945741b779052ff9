//! Where the flange of an xArm7 is for given joints, and which joints bring it to a given pose.
//!
//! The arm has one joint more than a pose needs. The redundancy is used to stay near the previous
//! joints, so that a path travelled forth and back ends where it began.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Cholesky, Matrix3, Matrix6, Rotation3, SMatrix, SVector, Vector3, Vector6};

pub use super::pose::{Pose, logarithm};

/// Joints of the arm.
pub const ARM_JOINTS: usize = 7;

/// Derivative of the pose with respect to the joints: three rows in m/rad, then three in rad/rad.
pub type Jacobian = SMatrix<f64, 6, ARM_JOINTS>;

/// What every hardware model of the arm can reach, rad (joint limits in xArm-Python-SDK, models
/// from 1305).
pub const JOINT_LIMITS_RAD: [(f64, f64); ARM_JOINTS] = [
    (-2.0 * PI, 2.0 * PI),
    (-2.042035, 2.024581),
    (-2.0 * PI, 2.0 * PI),
    (-0.10472, 3.92699),
    (-2.0 * PI, 2.0 * PI),
    (-1.692969, PI),
    (-2.0 * PI, 2.0 * PI),
];

/// What some hardware model of the arm can reach, rad (joint limits in xArm-Python-SDK, other
/// models).
pub const WIDEST_LIMITS_RAD: [(f64, f64); ARM_JOINTS] = [
    (-2.0 * PI, 2.0 * PI),
    (-2.059488, 2.094395),
    (-2.0 * PI, 2.0 * PI),
    (-0.191986, 3.92699),
    (-2.0 * PI, 2.0 * PI),
    (-1.692969, PI),
    (-2.0 * PI, 2.0 * PI),
];

/// Where the paper's rig begins and ends, degrees (lasr-lab/learning-to-play-piano).
pub const PAPER_HOME_DEG: [f64; ARM_JOINTS] = [0.0, 10.0, 0.0, 107.3, 180.0, -10.9, -225.0];

/// Modified Denavit-Hartenberg rows: angle to the previous axis (rad), distance from it (m), offset
/// along the own (m) (ufactory_docs, kinematics).
const LINKS: [(f64, f64, f64); ARM_JOINTS] = [
    (0.0, 0.0, 0.267),
    (-FRAC_PI_2, 0.0, 0.0),
    (FRAC_PI_2, 0.0, 0.293),
    (FRAC_PI_2, 0.0525, 0.0),
    (FRAC_PI_2, 0.0775, 0.3425),
    (FRAC_PI_2, 0.0, 0.0),
    (-FRAC_PI_2, 0.076, 0.097),
];

/// Largest shift of the target in one iteration of the inverse, m (our choice).
const STEP_M: f64 = 0.02;
/// The same for the orientation.
const STEP_RAD: f64 = 0.1;
/// Four metres of steps: more than twice the reach.
const MAX_ITERATIONS: usize = 200;
/// Nearer than this, in m and in rad, only the target counts.
const SETTLED: f64 = 1e-5;
/// An answer is one whose pose differs by less than this, in m and in rad.
const RESIDUAL: f64 = 1e-10;
/// An answer with a smaller singular value of the Jacobian is refused: joint speeds would be far
/// too high there.
const SINGULAR: f64 = 0.02;
/// Keeps the linear system solvable at singular joints; far below what moves an answer elsewhere.
const DAMPING: f64 = 1e-9;

/// The pose cannot be reached as asked.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum KinematicsError {
    /// A target or starting joint is not a number.
    #[error(
        "the pose or the joints to start from hold a value that is not a number; check what computes them"
    )]
    NotFinite,
    /// No joints reach the pose.
    #[error(
        "no joints reach the pose: {short_by_m:.3} m are missing; move the keyboard or the slide's ends nearer to the arm"
    )]
    OutOfReach {
        /// How much is missing at the nearest point found, m.
        short_by_m: f64,
    },
    /// The nearest joints that reach the pose are beyond a limit.
    #[error(
        "joint {joint} would be at {angle_rad:.3} rad, allowed are {lowest_rad:.3} to {highest_rad:.3}; \
         start from other joints or move the target"
    )]
    BeyondLimit {
        /// Which joint, counted from 1 as on the arm.
        joint: usize,
        /// Where it would have to be, rad.
        angle_rad: f64,
        /// Smallest allowed angle, rad.
        lowest_rad: f64,
        /// Largest allowed angle, rad.
        highest_rad: f64,
    },
    /// The arm is (nearly) stretched or folded there, and cannot move in every direction.
    #[error(
        "the arm is nearly singular there (smallest singular value {singular_value:.4}); bend it more, or move the target"
    )]
    NearSingular {
        /// Smallest singular value of the Jacobian.
        singular_value: f64,
    },
}

/// The pose of the flange for joints in rad.
pub fn forward(joints_rad: &[f64; ARM_JOINTS]) -> Pose {
    let mut pose = Pose { position_m: Vector3::zeros(), rotation: Rotation3::identity() };
    walk(joints_rad, |_, link| pose = link);
    pose
}

/// The Jacobian of [`forward`] for joints in rad.
pub fn jacobian(joints_rad: &[f64; ARM_JOINTS]) -> Jacobian {
    forward_and_jacobian(joints_rad).1
}

/// The joints (rad) that bring the flange to `target`: of all that do, those that a path from
/// `near` leads to.
///
/// # Errors
/// If there are none, if they are outside [`JOINT_LIMITS_RAD`], or if the arm is nearly singular
/// there.
pub fn inverse(target: &Pose, near: &[f64; ARM_JOINTS]) -> Result<[f64; ARM_JOINTS], KinematicsError> {
    let wanted = target.position_m.iter().chain(target.rotation.matrix().iter());
    if !wanted.chain(near).all(|value| value.is_finite()) {
        return Err(KinematicsError::NotFinite);
    }
    let near = SVector::from(*near);
    let mut joints = near;
    for _ in 0..MAX_ITERATIONS {
        let (pose, jacobian) = forward_and_jacobian(&joints.into());
        let twist = pose.twist_to(target);
        let (shift, turn) = lengths(&twist);
        if shift < RESIDUAL && turn < RESIDUAL {
            return accept(joints.into(), &jacobian);
        }
        let share = (STEP_M / shift.max(STEP_M)).min(STEP_RAD / turn.max(STEP_RAD));
        // The step that reaches the target, and of all those the one that ends nearest to `near`;
        // without the latter at the end, where it would only slow the convergence.
        let home = if shift.max(turn) > SETTLED { near - joints } else { SVector::zeros() };
        let damped = jacobian * jacobian.transpose() + Matrix6::identity() * DAMPING;
        let Some(factors) = Cholesky::new(damped) else { break };
        let step: SVector<f64, ARM_JOINTS> =
            home + jacobian.transpose() * factors.solve(&(twist * share - jacobian * home));
        // A step of a rad or more means that the linear picture no longer holds.
        joints += step * (0.5 / step.amax().max(0.5));
    }
    let (short_by_m, _) = lengths(&forward(&joints.into()).twist_to(target));
    Err(KinematicsError::OutOfReach { short_by_m })
}

/// Checks that every joint is within its limits; the error names the first that is not.
pub(crate) fn within_limits(joints_rad: &[f64; ARM_JOINTS]) -> Result<(), KinematicsError> {
    for (index, (&angle_rad, (lowest_rad, highest_rad))) in
        joints_rad.iter().zip(JOINT_LIMITS_RAD).enumerate()
    {
        if !(lowest_rad..=highest_rad).contains(&angle_rad) {
            return Err(KinematicsError::BeyondLimit {
                joint: index + 1,
                angle_rad,
                lowest_rad,
                highest_rad,
            });
        }
    }
    Ok(())
}

fn accept(joints: [f64; ARM_JOINTS], jacobian: &Jacobian) -> Result<[f64; ARM_JOINTS], KinematicsError> {
    within_limits(&joints)?;
    let squares = (jacobian * jacobian.transpose()).symmetric_eigenvalues();
    let singular_value = squares.min().max(0.0).sqrt();
    if singular_value < SINGULAR {
        return Err(KinematicsError::NearSingular { singular_value });
    }
    Ok(joints)
}

/// Lengths of the shift (m) and the turn (rad) of a twist.
fn lengths(twist: &Vector6<f64>) -> (f64, f64) {
    (twist.fixed_rows::<3>(0).norm(), twist.fixed_rows::<3>(3).norm())
}

fn forward_and_jacobian(joints: &[f64; ARM_JOINTS]) -> (Pose, Jacobian) {
    let mut axes = [(Vector3::zeros(), Vector3::zeros()); ARM_JOINTS];
    let mut pose = Pose { position_m: Vector3::zeros(), rotation: Rotation3::identity() };
    walk(joints, |joint, link| {
        axes[joint] = (link.rotation.matrix().column(2).into_owned(), link.position_m);
        pose = link;
    });
    let mut jacobian = Jacobian::zeros();
    for (mut column, (axis, origin)) in jacobian.column_iter_mut().zip(axes) {
        column.fixed_rows_mut::<3>(0).copy_from(&axis.cross(&(pose.position_m - origin)));
        column.fixed_rows_mut::<3>(3).copy_from(&axis);
    }
    (pose, jacobian)
}

/// Calls `visit` with the index and the frame of each link, from the base outwards. The last one is
/// the flange.
fn walk(joints: &[f64; ARM_JOINTS], mut visit: impl FnMut(usize, Pose)) {
    let (mut position_m, mut rotation) = (Vector3::zeros(), Matrix3::identity());
    for (index, (angle, (twist, length, offset))) in joints.iter().zip(LINKS).enumerate() {
        let ((sin, cos), (sin_twist, cos_twist)) = (angle.sin_cos(), twist.sin_cos());
        position_m += rotation * Vector3::new(length, -sin_twist * offset, cos_twist * offset);
        rotation *= Matrix3::new(
            cos,
            -sin,
            0.0,
            sin * cos_twist,
            cos * cos_twist,
            -sin_twist,
            sin * sin_twist,
            cos * sin_twist,
            cos_twist,
        );
        visit(index, Pose { position_m, rotation: Rotation3::from_matrix_unchecked(rotation) });
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Points of the slide's path, computed by an independent program: y and z in mm, joints in
    /// degrees.
    const SLIDE_DEG: [(f64, f64, [f64; ARM_JOINTS]); 5] = [
        (336.5, 169.0, [23.56, 39.75, 16.95, 74.83, 219.55, 67.36, -255.95]),
        (166.835, 169.755, [11.94, 27.38, 9.63, 56.29, 202.81, 64.28, -240.06]),
        (-2.83, 170.51, [-0.48, 23.04, 0.10, 50.14, 179.56, 62.90, -224.84]),
        (-169.665, 171.255, [-12.65, 27.27, -9.24, 56.50, 156.71, 64.04, -209.82]),
        (-336.5, 172.0, [-23.98, 39.28, -16.43, 74.78, 140.13, 66.93, -194.06]),
    ];

    fn radians(degrees: [f64; ARM_JOINTS]) -> [f64; ARM_JOINTS] {
        degrees.map(f64::to_radians)
    }

    fn over_keys(y_mm: f64, z_mm: f64) -> Pose {
        let rpy = [-90.0_f64, 225.0, -90.0].map(f64::to_radians);
        Pose::from_rpy([0.485, y_mm * 1e-3, z_mm * 1e-3], rpy)
    }

    /// Travels in a straight line in steps of a millimetre.
    fn travel(from: (f64, f64), to: (f64, f64), mut joints: [f64; ARM_JOINTS]) -> [f64; ARM_JOINTS] {
        let steps = (to.0 - from.0).abs().ceil().max(1.0) as usize;
        for step in 1..=steps {
            let share = step as f64 / steps as f64;
            let at = (from.0 + (to.0 - from.0) * share, from.1 + (to.1 - from.1) * share);
            joints = inverse(&over_keys(at.0, at.1), &joints).unwrap();
        }
        joints
    }

    #[track_caller]
    fn close(ours: &[f64], theirs: &[f64], tolerance: f64) {
        let apart = ours.iter().zip(theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < tolerance, "{ours:?} and {theirs:?} are {apart} apart");
    }

    #[test]
    fn poses_of_an_independent_program() {
        let zero = forward(&[0.0; ARM_JOINTS]);
        close(zero.position_m.as_slice(), &[0.206, 0.0, 0.1205], 1e-12);
        close(&zero.rpy_rad().map(f64::abs), &[PI, 0.0, 0.0], 1e-12);
        let home = forward(&radians(PAPER_HOME_DEG));
        close(home.position_m.as_slice(), &[0.524494, 0.0, 0.584883], 1e-6);
        close(&home.rpy_rad().map(f64::to_degrees), &[95.084, -44.887, 86.407], 1e-3);
        // The same orientation, said in two ways.
        let ways = [[-90.0_f64, 225.0, -90.0], [90.0, -45.0, 90.0]]
            .map(|rpy| Pose::from_rpy([0.0; 3], rpy.map(f64::to_radians)).rotation);
        assert!(ways[0].angle_to(&ways[1]) < 1e-12);
    }

    #[test]
    fn the_slide_of_an_independent_program() {
        let (y, z, listed) = SLIDE_DEG[2];
        let at_centre = inverse(&over_keys(y, z), &radians(listed)).unwrap();
        // The redundant joint makes the answer depend on the path from home, of which the table
        // does not say all.
        let from_home = inverse(&over_keys(y, z), &radians(PAPER_HOME_DEG)).unwrap();
        close(&from_home.map(f64::to_degrees), &listed, 0.2);
        for (y, z, expected) in SLIDE_DEG {
            let joints = travel((SLIDE_DEG[2].0, SLIDE_DEG[2].1), (y, z), at_centre);
            let (at, wanted) = (forward(&joints), over_keys(y, z));
            assert!(at.twist_to(&wanted).norm() < 1e-9);
            close(&joints.map(f64::to_degrees), &expected, 0.015);
            let squares = (jacobian(&joints) * jacobian(&joints).transpose()).symmetric_eigenvalues();
            assert!((0.17..0.21).contains(&squares.min().sqrt()), "{}", squares.min().sqrt());
        }
    }

    #[test]
    fn of_all_answers_a_near_one_is_found() {
        let home = radians(PAPER_HOME_DEG);
        let found = inverse(&over_keys(336.5, 169.0), &home).unwrap();
        let (away, jacobian) = (SVector::from(home) - SVector::from(found), jacobian(&found));
        // What of the way back changes no pose.
        let squares = (jacobian * jacobian.transpose()).try_inverse().unwrap();
        let idle = away - jacobian.transpose() * squares * jacobian * away;
        assert!(idle.norm() < 0.01, "{} of {}", idle.norm(), away.norm());
    }

    #[test]
    fn there_and_back_ends_where_it_began() {
        let (left, right) = ((336.5, 169.0), (-336.5, 172.0));
        let start = radians(SLIDE_DEG[0].2);
        let mut joints = inverse(&over_keys(left.0, left.1), &start).unwrap();
        let before = joints;
        joints = travel(right, left, travel(left, right, joints));
        close(&joints.map(f64::to_degrees), &before.map(f64::to_degrees), 0.001);
    }

    #[test]
    fn what_cannot_be_reached_is_refused() {
        let home = radians(PAPER_HOME_DEG);
        let far = Pose::from_rpy([1.5, 0.0, 0.3], [0.0; 3]);
        assert!(
            matches!(inverse(&far, &home), Err(KinematicsError::OutOfReach { short_by_m }) if short_by_m > 0.3)
        );
        let odd = Pose::from_rpy([f64::NAN, 0.0, 0.3], [0.0; 3]);
        assert_eq!(inverse(&odd, &home), Err(KinematicsError::NotFinite));
        let mut bent = [0.0, 0.3, 0.0, -0.4, 0.0, 0.5, 0.0];
        let refused = inverse(&forward(&bent), &bent).unwrap_err();
        assert!(matches!(refused, KinematicsError::BeyondLimit { joint: 4, .. }), "{refused}");
        // Both shoulder axes in one line, and both wrist axes.
        bent = [0.0; ARM_JOINTS];
        let refused = inverse(&forward(&bent), &bent).unwrap_err();
        assert!(matches!(refused, KinematicsError::NearSingular { .. }), "{refused}");
    }

    fn any_joints() -> impl Strategy<Value = [f64; ARM_JOINTS]> {
        JOINT_LIMITS_RAD.map(|(lowest, highest)| lowest..highest)
    }

    proptest! {
        #[test]
        fn the_jacobian_is_the_derivative(joints in any_joints()) {
            let (pose, jacobian) = forward_and_jacobian(&joints);
            for joint in 0..ARM_JOINTS {
                let mut moved = joints;
                moved[joint] += 1e-6;
                let change = pose.twist_to(&forward(&moved)) / 1e-6;
                prop_assert!((change - jacobian.column(joint)).norm() < 1e-5);
            }
        }

        #[test]
        fn the_inverse_inverts(joints in any_joints(), nudge in prop::array::uniform7(-0.1..0.1)) {
            let target = forward(&joints);
            let near = std::array::from_fn(|joint| joints[joint] + nudge[joint]);
            if let Ok(found) = inverse(&target, &near) {
                let left = forward(&found).twist_to(&target);
                prop_assert!(left.norm() < 1e-9);
                prop_assert!(within_limits(&found).is_ok());
            }
        }

        #[test]
        fn poses_survive_the_wire(joints in any_joints()) {
            let pose = forward(&joints);
            let back = Pose::from_wire(pose.to_wire());
            prop_assert!(pose.twist_to(&back).norm() < 2e-6, "{pose:?} {back:?}");
        }
    }
}
