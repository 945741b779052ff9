//! Position and orientation of the flange.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Rotation3, Vector3, Vector6};

/// Position and orientation of the flange in the frame of the robot's base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Position, m.
    pub position_m: Vector3<f64>,
    /// Orientation: turns flange coordinates into base coordinates.
    pub rotation: Rotation3<f64>,
}

impl Pose {
    /// From a position and roll, pitch and yaw about the fixed axes x, y and z (rad), which is the
    /// arm's convention (ufactory_docs).
    pub fn from_rpy(position_m: [f64; 3], rpy_rad: [f64; 3]) -> Self {
        let [roll, pitch, yaw] = rpy_rad;
        Self {
            position_m: Vector3::from(position_m),
            rotation: Rotation3::from_euler_angles(roll, pitch, yaw),
        }
    }

    /// Roll, pitch and yaw about the fixed axes, rad.
    pub fn rpy_rad(&self) -> [f64; 3] {
        let matrix = self.rotation.matrix();
        let level = matrix[(2, 1)].hypot(matrix[(2, 2)]);
        let pitch = (-matrix[(2, 0)]).atan2(level);
        if level < 1e-6 {
            // Straight up or down, roll and yaw turn about the same axis: all of it is called roll.
            return [(-matrix[(1, 2)]).atan2(matrix[(1, 1)]), pitch, 0.0];
        }
        [matrix[(2, 1)].atan2(matrix[(2, 2)]), pitch, matrix[(1, 0)].atan2(matrix[(0, 0)])]
    }

    /// As the arm writes it: x, y, z in mm, then roll, pitch, yaw in rad.
    pub fn to_wire(&self) -> [f32; 6] {
        let ([x, y, z], [roll, pitch, yaw]) = (self.position_m.into(), self.rpy_rad());
        [x * 1e3, y * 1e3, z * 1e3, roll, pitch, yaw].map(|value| value as f32)
    }

    /// Reads what [`to_wire`](Self::to_wire) writes.
    pub fn from_wire(wire: [f32; 6]) -> Self {
        let [x, y, z, roll, pitch, yaw] = wire.map(f64::from);
        Self::from_rpy([x * 1e-3, y * 1e-3, z * 1e-3], [roll, pitch, yaw])
    }

    /// What leads from here to `target`: a shift (m) and a turn about a base-frame axis (rad).
    pub(super) fn twist_to(&self, target: &Self) -> Vector6<f64> {
        let shift = target.position_m - self.position_m;
        let turn = logarithm(&(target.rotation * self.rotation.inverse()));
        Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z)
    }
}

/// Axis times angle (rad) of a rotation, to the last digit for small angles, where the arc cosine
/// of the trace is not.
pub fn logarithm(rotation: &Rotation3<f64>) -> Vector3<f64> {
    let matrix = rotation.matrix();
    let sines = Vector3::new(
        matrix[(2, 1)] - matrix[(1, 2)],
        matrix[(0, 2)] - matrix[(2, 0)],
        matrix[(1, 0)] - matrix[(0, 1)],
    ) / 2.0;
    let (sin, cos) = (sines.norm(), (matrix.trace() - 1.0) / 2.0);
    if sin > 1e-6 {
        return sines * (sin.atan2(cos) / sin);
    }
    if cos > 0.0 {
        return sines;
    }
    // Half a turn: matrix + 1 is twice the axis times its transpose.
    let doubled = matrix + Matrix3::identity();
    let longest = if doubled[(0, 0)] > 0.5 {
        0
    } else if doubled[(1, 1)] > 0.5 {
        1
    } else {
        2
    };
    doubled.column(longest).normalize() * PI
}
