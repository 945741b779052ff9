//! The passes of an identification, their order and their methods.

use serde::{Deserialize, Serialize};

use crate::config::{Differences, LmConfig, MethodConfig};
use crate::estimate::{HALF_INTERVAL, WEAK_HALF_INTERVAL};
use crate::group::{Group, fingers, joints, keyboard};

/// Maximum number of passes joint by joint.
const MAX_JOINT_PASSES: usize = 6;
/// Another pass joint by joint follows one that reduced the error by at least this share.
const MIN_GAIN: f64 = 0.05;
/// With more residuals than this many standard deviations of the noise, the simulator lacks physics
/// of the robot: what only shows at the noise is then not looked for.
const FAR_FROM_NOISE: f64 = 5.0;
/// Step of the differences for the last pass's Jacobians and for the estimates' intervals, as a
/// share of each range.
pub(super) const ESTIMATE_STEP: f64 = 1e-3;
/// Last step of the differences of the passes joint by joint, and the share of the cost that ends a
/// fit there.
const JOINT_STEP: f64 = 1e-4;
const JOINT_TOLERANCE: f64 = 1e-3;
/// Curvature of the cost along a parameter whose own interval is just identifiable.
const MIN_CURVATURE: f64 = (HALF_INTERVAL / WEAK_HALF_INTERVAL) * (HALF_INTERVAL / WEAK_HALF_INTERVAL);

/// Parts of an identification, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Pass {
    /// Every joint separately.
    Joints,
    /// Every joint separately, from another start, kept where it ends better; Levenberg–Marquardt
    /// only.
    Restart,
    /// Every finger's joints together, and the rail; Levenberg–Marquardt only, the other method
    /// takes few parameters, and only near the noise.
    Fingers,
    /// The keyboard and the encoders' biases, from motions that touch keys.
    Contact,
}

/// The result of a pass.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PassEnd {
    /// The pass.
    pub pass: Pass,
    /// Replays of all motions.
    pub replays: u64,
    /// Time for replays and method, s, interruptions excluded.
    pub secs: f64,
    /// Root mean square of the residuals at its start and at its end, in standard deviations of the
    /// noise.
    pub rms: [f64; 2],
}

impl Pass {
    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Joints => "joint by joint",
            Self::Restart => "joint by joint, restarted",
            Self::Fingers => "finger by finger",
            Self::Contact => "keyboard",
        }
    }

    pub(super) fn groups(self) -> Vec<Group> {
        match self {
            Self::Joints | Self::Restart => joints(),
            Self::Fingers => fingers(),
            Self::Contact => vec![keyboard()],
        }
    }

    /// The pass's method. Pass [`Fingers`](Self::Fingers) decides the drives' parameters, so it
    /// uses wide central differences, which average the roughness of the replays without a bias to
    /// one side. It starts with little damping and a small tolerance, because a joint's scale of
    /// torque changes the cost by only one part in 250. A parameter that the recordings do not
    /// identify stays fixed, because a step along it can leave the region of the minimum. The
    /// passes joint by joint need not converge fully: while one joint is fitted the others move and
    /// disturb it, so that what a finer fit gains is lost in the next pass.
    pub(super) fn method(self, method: &MethodConfig) -> MethodConfig {
        match method {
            MethodConfig::Lm(lm) if self == Self::Fingers => MethodConfig::Lm(LmConfig {
                differences: Differences::Central,
                difference_step: ESTIMATE_STEP,
                first_difference_step: ESTIMATE_STEP,
                initial_damping: 1e-3,
                cost_tolerance: 0.1 * lm.cost_tolerance,
                min_curvature: MIN_CURVATURE,
                ..lm.clone()
            }),
            MethodConfig::Lm(lm) if self != Self::Contact => MethodConfig::Lm(LmConfig {
                difference_step: JOINT_STEP,
                cost_tolerance: JOINT_TOLERANCE,
                ..lm.clone()
            }),
            method => method.clone(),
        }
    }
}

/// The pass that follows those that have ended. `air` and `keys`: whether there are motions without
/// keys and with keys.
pub(super) fn next(ended: &[PassEnd], method: &MethodConfig, air: bool, keys: bool) -> Option<Pass> {
    let lm = matches!(method, MethodConfig::Lm(_));
    let times = |pass: Pass| ended.iter().filter(|end| end.pass == pass).count();
    let error = |end: &PassEnd| end.rms[1];
    let gained = match ended {
        [.., before, last] => error(last) < (1.0 - MIN_GAIN) * error(before),
        _ => true,
    };
    let near = ended.last().is_some_and(|end| error(end) < FAR_FROM_NOISE);
    match ended.last().map(|end| end.pass) {
        None if air => Some(Pass::Joints),
        // All joints move while one is fitted, which disturbs its slopes. The next pass starts with
        // better neighbours.
        Some(Pass::Joints | Pass::Restart) if lm && gained && times(Pass::Joints) < MAX_JOINT_PASSES => {
            Some(Pass::Joints)
        }
        Some(Pass::Joints) if lm && times(Pass::Restart) == 0 => Some(Pass::Restart),
        Some(Pass::Joints | Pass::Restart) if lm && near => Some(Pass::Fingers),
        _ => (keys && times(Pass::Contact) == 0).then_some(Pass::Contact),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The passes of a fit whose residuals after each pass are these.
    fn order(rms: &[f64], [air, keys]: [bool; 2]) -> Vec<Pass> {
        let method = MethodConfig::Lm(LmConfig::for_replays());
        let mut ended: Vec<PassEnd> = Vec::new();
        while let Some(pass) = next(&ended, &method, air, keys) {
            let before = ended.last().map_or(100.0, |end| end.rms[1]);
            let after = rms.get(ended.len()).copied().unwrap_or(before);
            ended.push(PassEnd { pass, replays: 1, secs: 1.0, rms: [before, after] });
        }
        ended.into_iter().map(|end| end.pass).collect()
    }

    #[test]
    fn fingers_are_fitted_as_a_whole_only_near_the_noise() {
        use Pass::{Contact, Fingers, Joints, Restart};
        let near = [Joints, Joints, Joints, Restart, Fingers, Contact];
        assert_eq!(order(&[37.0, 1.1, 1.09, 1.08, 1.08], [true, true]), near);
        assert_eq!(order(&[38.0, 37.0], [true, true]), [Joints, Joints, Restart, Contact]);
        assert_eq!(order(&[], [false, true]), [Contact]);
        assert_eq!(order(&[], [false, false]), []);
    }
}
