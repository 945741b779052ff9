//! The gain of gravity compensation (`joint_loop.gravity_pwm_per_nm` of a rig): duty of the motors
//! for each N·m that holds the fingers.
//!
//! While a joint turns freely, its duty is, with g and the dead band shared by all joints and the
//! rest its own,
//!
//! ```text
//! pwm = g · torque that holds the finger here + inertia · acceleration + damping · velocity + friction · sign(velocity) + dead band · sign(pwm)
//! ```
//!
//! which is linear in what is not known. A joint at rest is left out: its friction holds any part
//! of the weight.

use etude_robot::allegro::{self, holding_torques};
use etude_robot::joints::HAND_DRIVEN_JOINTS;
use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use crate::motion::RecordedMotion;

/// Readings to each side from which velocity and acceleration are taken: 15 ms.
const HALF_WINDOW: usize = 5;
/// A joint that is slower may be held by its friction, rad/s.
const TURNING_RAD_PER_SEC: f64 = 0.05;
/// A joint with more acceleration turns the others of its finger too, rad/s².
const STEADY_RAD_PER_SEC2: f64 = 5.0;
/// Terms that all joints share, and those of each.
const SHARED: usize = 2;
const TERMS: usize = 3;
const UNKNOWNS: usize = SHARED + TERMS * HAND_DRIVEN_JOINTS;
/// Folds of the jackknife, and Student's t of so many folds for 95 %.
const FOLDS: usize = 10;
const STUDENT_T: f64 = 2.262;
/// Error of what the terms above leave out, such as friction that is greater at rest: half of a 95
/// % interval, as a share. [our estimate, from twins with known motors]
const MODEL_ERROR_SHARE: f64 = 0.03;
/// A smaller gain means no weight: a motor would make 12 N·m at full duty.
const MIN_PWM_PER_NM: f64 = 100.0;
/// Readings that a fold needs: a second of one joint.
const MIN_SAMPLES_PER_FOLD: usize = 333;

/// The gain of gravity compensation that the recordings show.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct GravityCompensation {
    /// Duty (of 1200) for each N·m that holds the fingers.
    pub pwm_per_nm: f64,
    /// Its 95 % interval: by the jackknife over tenths of the recordings, with a share of 3 % for
    /// what the model leaves out.
    pub interval: [f64; 2],
}

impl GravityCompensation {
    /// What an operator does about it, on a rig whose feed-forward is `configured`.
    pub fn advice(&self, configured: f64) -> String {
        let [low, high] = self.interval;
        let found =
            format!("{:.0} of full duty 1200 for each N·m (95 %: {low:.0} to {high:.0})", self.pwm_per_nm);
        if self.pwm_per_nm < MIN_PWM_PER_NM {
            return format!(
                "the fingers show no weight, {found}: gravity_pwm_per_nm = 0 fits, and the rig has {configured:.0}"
            );
        }
        format!("the fingers weigh {found}; gravity_pwm_per_nm of the rig is {configured:.0}")
    }
}

/// A reading of a joint that turns: shared terms, of which the first is the torque that holds its
/// finger (N·m), its own terms, and its duty.
struct TurningSample {
    joint: usize,
    shared: [f64; SHARED],
    terms: [f64; TERMS],
    pwm: f64,
}

/// The normal equations of a fold.
struct NormalEquations {
    matrix: DMatrix<f64>,
    right: DVector<f64>,
}

impl NormalEquations {
    fn new(rows: &[TurningSample]) -> Self {
        let mut equations =
            Self { matrix: DMatrix::zeros(UNKNOWNS, UNKNOWNS), right: DVector::zeros(UNKNOWNS) };
        for TurningSample { joint, shared, terms, pwm } in rows {
            let row = || (0..).zip(*shared).chain((SHARED + TERMS * joint..).zip(*terms));
            for (column, value) in row() {
                for (other, with) in row() {
                    equations.matrix[(column, other)] += value * with;
                }
                equations.right[column] += value * pwm;
            }
        }
        equations
    }

    /// The gain by the sum of these equations. A joint that never turned does not contribute.
    fn gain<'a>(folds: impl Iterator<Item = &'a Self>) -> Option<f64> {
        let mut sum = Self::new(&[]);
        for fold in folds {
            sum.matrix += &fold.matrix;
            sum.right += &fold.right;
        }
        // Columns have different units: each is scaled to length one.
        let scale: Vec<f64> = sum.matrix.diagonal().iter().map(|square| square.sqrt()).collect();
        if scale[0] == 0.0 {
            return None;
        }
        let inverse = |value: f64| if value > 0.0 { 1.0 / value } else { 0.0 };
        let scaled = DMatrix::from_fn(UNKNOWNS, UNKNOWNS, |row, column| {
            sum.matrix[(row, column)] * inverse(scale[row]) * inverse(scale[column])
        });
        let right = DVector::from_fn(UNKNOWNS, |row, _| sum.right[row] * inverse(scale[row]));
        let solved = scaled.svd(true, true).solve(&right, 1e-9).ok()?;
        Some(solved[0] / scale[0])
    }
}

/// Fits the gain to motions that touch no key, with the palm facing down; `None` if the joints turn
/// too little.
pub fn fit_gravity_compensation(motions: &[RecordedMotion]) -> Option<GravityCompensation> {
    let mut rows = Vec::new();
    for motion in motions.iter().filter(|motion| motion.keys.is_empty()) {
        for index in HALF_WINDOW..motion.fingers.len().saturating_sub(HALF_WINDOW) {
            add_samples(motion, index, &mut rows);
        }
    }
    if rows.len() < FOLDS * MIN_SAMPLES_PER_FOLD {
        return None;
    }
    let folds: Vec<NormalEquations> =
        rows.chunks(rows.len().div_ceil(FOLDS)).map(NormalEquations::new).collect();
    let pwm_per_nm = NormalEquations::gain(folds.iter())?;
    let without = |left_out: usize| {
        NormalEquations::gain(
            folds.iter().enumerate().filter(|(fold, _)| *fold != left_out).map(|(_, fold)| fold),
        )
    };
    let without: Vec<f64> = (0..FOLDS).map(without).collect::<Option<_>>()?;
    let mean = without.iter().sum::<f64>() / FOLDS as f64;
    let squares: f64 = without.iter().map(|value| (value - mean).powi(2)).sum();
    let half = (STUDENT_T * (squares * (FOLDS - 1) as f64 / FOLDS as f64).sqrt())
        .hypot(MODEL_ERROR_SHARE * pwm_per_nm);
    Some(GravityCompensation { pwm_per_nm, interval: [pwm_per_nm - half, pwm_per_nm + half] })
}

/// Adds the readings of the joints that turn.
fn add_samples(motion: &RecordedMotion, index: usize, rows: &mut Vec<TurningSample>) {
    let reading = |at: usize| motion.fingers[at];
    let ((before, from), (now, at), (after, to)) =
        (reading(index - HALF_WINDOW), reading(index), reading(index + HALF_WINDOW));
    let mut positions = [0.0; allegro::WIRE_JOINTS];
    positions[..HAND_DRIVEN_JOINTS].copy_from_slice(&at);
    let holding = holding_torques(&positions);
    for joint in 0..HAND_DRIVEN_JOINTS {
        let [came, went] =
            [(at[joint] - from[joint]) / (now - before), (to[joint] - at[joint]) / (after - now)];
        let velocity = (to[joint] - from[joint]) / (after - before);
        let acceleration = 2.0 * (went - came) / (after - before);
        let turns = velocity.abs() > TURNING_RAD_PER_SEC && acceleration.abs() < STEADY_RAD_PER_SEC2;
        if !turns {
            continue;
        }
        let Some(pwm) = motion.pwm.get(index).map(|pwm| pwm[joint]) else { continue };
        let shared = [holding[joint], if pwm == 0.0 { 0.0 } else { pwm.signum() }];
        rows.push(TurningSample { joint, shared, terms: [acceleration, velocity, velocity.signum()], pwm });
    }
}
