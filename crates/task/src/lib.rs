//! The task: what the agent sees, does and is paid for, on top of a [`World`](etude_stage::World).
//!
//! A [`Piece`] is the sheet music in control steps. An [`Environment`] plays it once per episode; [`VectorPiano`] runs
//! many of them over threads for the learner; [`rehearse`] plays the whole song with a fixed policy and returns a
//! [`Performance`] with its scores.

mod assignment;
pub mod bench;
mod config;
mod environment;
mod evaluate;
mod observation;
mod performance;
mod piece;
mod randomise;
pub mod reward;
pub mod scripted;
mod vector;

pub use assignment::assign;
pub use config::{TaskConfig, TaskError};
pub use environment::{Environment, Step};
pub use evaluate::SongEvaluator;
pub use observation::{ObservationScale, layout, observe};
pub use performance::{Act, Performance, Watch, rehearse};
pub use piece::Piece;
pub use randomise::{RANDOMISED, Randomisation, RandomisationConfig};
pub use scripted::{ScriptedConfig, ScriptedPlayer};
pub use vector::VectorPiano;

/// Length of an action: one target per driven joint.
pub const ACTION_LEN: usize = etude_stage::JOINTS;

/// Joint targets (rad, the rail in m) of an action in [−1, 1]: −1 and 1 are the ends of each joint's range.
pub fn targets(action: &[f32; ACTION_LEN]) -> [f64; ACTION_LEN] {
    std::array::from_fn(|joint| {
        let [low, high] = etude_stage::joint_range(joint);
        low + (f64::from(action[joint].clamp(-1.0, 1.0)) + 1.0) / 2.0 * (high - low)
    })
}

/// The action whose [`targets`] these are; targets beyond a range give ±1.
pub fn action(targets: &[f64; ACTION_LEN]) -> [f32; ACTION_LEN] {
    std::array::from_fn(|joint| {
        let [low, high] = etude_stage::joint_range(joint);
        (((targets[joint] - low) / (high - low) * 2.0 - 1.0).clamp(-1.0, 1.0)) as f32
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn action_undoes_targets() {
        let action_in: [f32; ACTION_LEN] = std::array::from_fn(|j| j as f32 / 6.0 - 1.0);
        let back = action(&targets(&action_in));
        assert!(action_in.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-6));
        assert_eq!(targets(&[9.0; ACTION_LEN]), targets(&[1.0; ACTION_LEN]));
    }
}
