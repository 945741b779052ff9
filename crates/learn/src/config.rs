//! All constants of the algorithm and of a training, with the paper's values as defaults.
//!
//! The paper gives few of them; the others are those of github.com/kevinzakka/robopianist-rl
//! (`run.sh`), which it builds on.

use etude_checks::{RangeError, check_range, positive_to};
use serde::{Deserialize, Serialize};

/// A configured value that cannot work. The text says why.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct ConfigError(pub(crate) String);

impl From<RangeError> for ConfigError {
    fn from(error: RangeError) -> Self {
        Self(error.to_string())
    }
}

/// Arithmetic of the matrix products between hidden layers in an update.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Arithmetic {
    /// In single precision.
    #[default]
    F32,
    /// Operands rounded to bfloat16, sums in single precision: faster on processors with AVX-512
    /// BF16. On others, and where the width of a layer or the rows of a batch are not a multiple of
    /// 32, it is the same as [`F32`](Self::F32); a training can be resumed on another kind of
    /// processor, but not bit for bit. Parameters, optimiser and everything between the products
    /// are in single precision.
    Bf16,
}

/// The algorithm: soft actor-critic whose two critics have dropout and LayerNorm ("DroQ" in the
/// RoboPianist line).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DroqConfig {
    /// Widths of the hidden layers, the same in the actor and in both critics.
    pub hidden: Vec<usize>,
    /// Arithmetic of the products between hidden layers.
    pub arithmetic: Arithmetic,
    /// Probability with which a critic's unit is dropped, in online, target and actor passes alike.
    pub dropout: f64,
    /// Transitions a batch, drawn uniformly with replacement.
    pub batch: usize,
    /// Transitions in the replay buffer; the oldest are overwritten.
    pub replay_capacity: usize,
    /// Weight of the next step's value, per control step.
    pub discount: f64,
    /// Control steps whose rewards are summed before the critics' value of the next state is added
    /// (n-step returns); fewer where the episode ends earlier. The paper's is 1.
    pub n_step: usize,
    /// Fraction of the distance that the target critics move towards the critics at each update.
    pub polyak: f64,
    /// Fraction of the distance that the policy moves towards the actor at each update. The policy,
    /// which is evaluated and saved, is thus an average over about `1 / policy_polyak` updates of
    /// the actor. With 1 it is the actor itself (the paper).
    pub policy_polyak: f64,
    /// Weight of the squared change of the policy's action from one control step to the next, mean
    /// over the actions, in the actor's loss (CAPS, arXiv 2012.06644): without it the hand
    /// trembles. The paper has none.
    pub smoothness: f64,
    /// Adam step size of the actor.
    pub actor_learning_rate: f64,
    /// Adam step size of the critics.
    pub critic_learning_rate: f64,
    /// Adam step size of the logarithm of the temperature.
    pub temperature_learning_rate: f64,
    /// Temperature (weight of the entropy) at the start; learned from there.
    pub initial_temperature: f64,
    /// Entropy that the temperature is steered towards, in nats per action dimension.
    pub target_entropy_per_action: f64,
    /// Bounds of the logarithm of the policy's standard deviation, before squashing.
    pub log_std_bounds: [f64; 2],
}

impl Default for DroqConfig {
    fn default() -> Self {
        Self {
            hidden: vec![128, 128, 128],
            arithmetic: Arithmetic::F32,
            dropout: 0.01,
            batch: 256,
            replay_capacity: 1_000_000,
            discount: 0.8,
            n_step: 1,
            polyak: 0.005,
            policy_polyak: 1.0,
            smoothness: 0.0,
            actor_learning_rate: 3e-4,
            critic_learning_rate: 3e-4,
            temperature_learning_rate: 3e-4,
            initial_temperature: 1.0,
            target_entropy_per_action: -0.5,
            log_std_bounds: [-20.0, 2.0],
        }
    }
}

/// Maximum number of units of a layer; also prevents overflow by the sizes in a damaged file.
pub(crate) const MAX_LAYER_WIDTH: usize = 8192;
/// Maximum number of hidden layers of a network.
pub(crate) const MAX_LAYERS: usize = 16;

impl DroqConfig {
    /// Refuses values that cannot work, naming the field.
    pub fn check(&self) -> Result<(), ConfigError> {
        let hidden = &self.hidden;
        let widths = hidden.iter().all(|&width| (1..=MAX_LAYER_WIDTH).contains(&width));
        if !widths || !(1..=MAX_LAYERS).contains(&hidden.len()) {
            return Err(ConfigError(format!(
                "droq.hidden is {hidden:?}: it must list 1 to {MAX_LAYERS} layers of 1 to {MAX_LAYER_WIDTH} units"
            )));
        }
        check_range("droq.dropout", self.dropout, 0.0..=0.9)?;
        check_range("droq.batch", self.batch as f64, 1.0..=65_536.0)?;
        check_range("droq.replay_capacity", self.replay_capacity as f64, 1.0..=2_147_483_648.0)?;
        check_range("droq.discount", self.discount, 0.0..1.0)?;
        check_range("droq.n_step", self.n_step as f64, 1.0..=100.0)?;
        check_range("droq.polyak", self.polyak, positive_to(1.0))?;
        check_range("droq.policy_polyak", self.policy_polyak, positive_to(1.0))?;
        check_range("droq.smoothness", self.smoothness, 0.0..=1000.0)?;
        check_range("droq.actor_learning_rate", self.actor_learning_rate, 0.0..=1.0)?;
        check_range("droq.critic_learning_rate", self.critic_learning_rate, 0.0..=1.0)?;
        check_range("droq.temperature_learning_rate", self.temperature_learning_rate, 0.0..=1.0)?;
        check_range("droq.initial_temperature", self.initial_temperature, positive_to(1e6))?;
        check_range("droq.target_entropy_per_action", self.target_entropy_per_action, ..)?;
        let [low, high] = self.log_std_bounds;
        if !(low >= -40.0 && low < high && high <= 20.0) {
            let why = "the two bounds must ascend and lie within -40 and 20";
            return Err(ConfigError(format!("droq.log_std_bounds is [{low}, {high}]: {why}")));
        }
        Ok(())
    }
}

/// A training: its length, its updates per step, and its intervals of logs, evaluations and
/// checkpoints.
///
/// A *vector step* is `num_envs` environment steps and `updates_per_vector_step` updates from the
/// replay buffer before them. All lengths are counted in environment steps and take effect at the
/// end of the vector step that reaches them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainerConfig {
    /// Root seed of all random draws.
    pub seed: u64,
    /// Environment steps after which the training is finished.
    pub total_steps: u64,
    /// Environments that step together.
    pub num_envs: usize,
    /// Updates a vector step, once the warm-up is over.
    pub updates_per_vector_step: usize,
    /// Environment steps with uniformly random actions, before the first update.
    pub warmup_steps: u64,
    /// Environment steps between rows of metrics.
    pub log_every_steps: u64,
    /// Environment steps between evaluations; 0 for none.
    pub evaluate_every_steps: u64,
    /// Name of the evaluator's score that decides which policy is the best; its first score if this
    /// is empty.
    pub best_by: String,
    /// Environment steps between checkpoints.
    pub checkpoint_every_steps: u64,
    /// Threads for environments and learning together; 0 for one a processor core. The result does
    /// not depend on it.
    pub threads: usize,
    /// Whether the environments step while the learner updates. The result does not depend on it.
    pub overlap: bool,
}

impl Default for TrainerConfig {
    fn default() -> Self {
        Self {
            seed: 0,
            total_steps: 3_000_000,
            num_envs: 1,
            updates_per_vector_step: 1,
            warmup_steps: 5_000,
            log_every_steps: 2_000,
            evaluate_every_steps: 10_000,
            best_by: String::new(),
            checkpoint_every_steps: 50_000,
            threads: 0,
            overlap: true,
        }
    }
}

/// Maximum number of environments. Each is a whole simulation, so a typing error could fill the
/// memory.
const MAX_ENVS: f64 = 4096.0;

impl TrainerConfig {
    /// Refuses values that cannot work, naming the field.
    pub fn check(&self) -> Result<(), ConfigError> {
        check_range("trainer.num_envs", self.num_envs as f64, 1.0..=MAX_ENVS)?;
        check_range("trainer.updates_per_vector_step", self.updates_per_vector_step as f64, ..=1024.0)?;
        check_range("trainer.threads", self.threads as f64, ..=1024.0)?;
        // Updates need something to learn from.
        check_range("trainer.warmup_steps", self.warmup_steps as f64, 1.0..)?;
        check_range("trainer.total_steps", self.total_steps as f64, 1.0..)?;
        check_range("trainer.log_every_steps", self.log_every_steps as f64, 1.0..)?;
        Ok(check_range("trainer.checkpoint_every_steps", self.checkpoint_every_steps as f64, 1.0..)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_valid_and_survive_json() {
        DroqConfig::default().check().unwrap();
        TrainerConfig::default().check().unwrap();
        let text = serde_json::to_string(&DroqConfig::default()).unwrap();
        assert_eq!(serde_json::from_str::<DroqConfig>(&text).unwrap(), DroqConfig::default());
        assert!(serde_json::from_str::<TrainerConfig>(r#"{"sead": 1}"#).is_err());
    }

    #[test]
    fn errors_name_the_field() {
        type Spoil = fn(&mut DroqConfig);
        let broken: [(&str, Spoil); 9] = [
            ("droq.hidden", |c| c.hidden.clear()),
            ("droq.dropout", |c| c.dropout = f64::NAN),
            ("droq.batch", |c| c.batch = 0),
            ("droq.replay_capacity", |c| c.replay_capacity = 0),
            ("droq.discount", |c| c.discount = 1.0),
            ("droq.n_step", |c| c.n_step = 0),
            ("droq.polyak", |c| c.polyak = 0.0),
            ("droq.critic_learning_rate", |c| c.critic_learning_rate = -1.0),
            ("droq.log_std_bounds", |c| c.log_std_bounds = [2.0, -20.0]),
        ];
        for (field, spoil) in broken {
            let mut config = DroqConfig::default();
            spoil(&mut config);
            let error = config.check().unwrap_err();
            assert!(error.to_string().starts_with(&format!("{field} is ")), "{error}");
        }
        assert!(TrainerConfig { num_envs: 0, ..Default::default() }.check().is_err());
    }
}
