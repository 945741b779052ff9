//! The configuration of a run, in layers: preset, then file, then single overrides.

mod layers;

use std::path::Path;

use anyhow::{anyhow, bail};
use etude_learn::{DroqConfig, TrainerConfig};
use etude_perform::SCORES;
use etude_task::{CorpusConfig, TaskConfig};
use serde::{Deserialize, Serialize};

pub use self::layers::toml_error;
use self::layers::{meant, merge, override_table, parse};

/// Everything that decides a training, apart from the song; with a corpus, everything.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RunConfig {
    /// The trainer: steps, environments, intervals, seed.
    pub trainer: TrainerConfig,
    /// The algorithm.
    pub droq: DroqConfig,
    /// The world and the task.
    pub task: TaskConfig,
    /// The pieces to learn from, where no song is named.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub corpus: Option<CorpusConfig>,
}

/// The preset that is used where none is named.
pub const DEFAULT_PRESET: &str = "fast";

/// The presets: name and text.
const PRESETS: &[(&str, &str)] = &[
    ("fast", include_str!("../../../../configs/presets/fast.toml")),
    ("expressive", include_str!("../../../../configs/presets/expressive.toml")),
    ("paper", include_str!("../../../../configs/presets/paper.toml")),
    ("appendix", include_str!("../../../../configs/presets/appendix.toml")),
    ("sight-reader", include_str!("../../../../configs/presets/sight-reader.toml")),
];

/// Names of the presets.
pub fn presets() -> Vec<&'static str> {
    PRESETS.iter().map(|(name, _)| *name).collect()
}

/// Settings that may change when a run is resumed: none of them affects the steps that are already
/// made.
const CHANGEABLE: &[&str] = &[
    "trainer.total_steps",
    "trainer.log_every_steps",
    "trainer.evaluate_every_steps",
    "trainer.checkpoint_every_steps",
    "trainer.threads",
    "trainer.overlap",
];

impl RunConfig {
    /// With the weight of every reward term, so that the file has the same meaning over any preset.
    pub fn complete(mut self) -> Self {
        for term in etude_task::reward::TERMS {
            self.task.reward.entry(term.name.to_string()).or_insert(term.default_weight);
        }
        self
    }

    /// Checks the settings of learner and trainer before anything is built or written.
    ///
    /// # Errors
    /// If a setting cannot work.
    pub fn check(&self) -> anyhow::Result<()> {
        self.droq.check()?;
        self.trainer.check()?;
        let best_by = self.trainer.best_by.as_str();
        if !best_by.is_empty() && !SCORES.contains(&best_by) {
            bail!("trainer.best_by is `{best_by}`, which is no score; there are: {}", SCORES.join(", "));
        }
        Ok(())
    }
}

/// Merges the layers: `preset`, then the TOML `file`, then `overrides` of the form `a.b=value`, the
/// later ones winning.
///
/// # Errors
/// If a layer cannot be read, or the result has an unknown key or a value of the wrong type; the
/// message names the key.
pub fn resolve(preset: &str, file: Option<&Path>, overrides: &[String]) -> anyhow::Result<RunConfig> {
    let Some((_, text)) = PRESETS.iter().find(|(name, _)| *name == preset) else {
        bail!("there is no preset `{preset}`; there are: {}", presets().join(", "));
    };
    let mut table = parse(text, &format!("preset {preset}"))?;
    if let Some(path) = file {
        merge(&mut table, read(path)?);
    }
    finish(table, overrides)
}

/// The configuration in the TOML `file` over the defaults of the code, without a preset.
///
/// # Errors
/// As [`resolve`].
pub fn stored_config(file: &Path) -> anyhow::Result<RunConfig> {
    finish(read(file)?, &[])
}

fn read(path: &Path) -> anyhow::Result<toml::Table> {
    let text = std::fs::read_to_string(path)
        .map_err(|error| anyhow!("cannot read the configuration {}: {error}", path.display()))?;
    parse(&text, &path.display().to_string())
}

/// `config` with single values changed.
///
/// # Errors
/// As [`resolve`].
pub(crate) fn change(config: &RunConfig, overrides: &[String]) -> anyhow::Result<RunConfig> {
    finish(toml::Table::try_from(config)?, overrides)
}

/// `config` with single values changed, of those that a run may change when it is continued.
pub(crate) fn change_resumable(config: &RunConfig, overrides: &[String]) -> anyhow::Result<RunConfig> {
    let key = |text: &String| text.split('=').next().unwrap_or_default().trim().to_string();
    let changed = change(config, overrides)?;
    match overrides.iter().map(key).find(|key| !CHANGEABLE.contains(&key.as_str())) {
        Some(key) => bail!(
            "`{key}` cannot be changed in a run that has begun, only {}; start a new run with it instead",
            CHANGEABLE.join(", ")
        ),
        None => Ok(changed),
    }
}

fn finish(mut table: toml::Table, overrides: &[String]) -> anyhow::Result<RunConfig> {
    for text in overrides {
        let (path, value) = text.split_once('=').ok_or_else(|| {
            anyhow!("`--set {text}` is not of the form path=value, for example trainer.seed=3")
        })?;
        merge(&mut table, override_table(path.trim(), value.trim()));
    }
    serde_path_to_error::deserialize(toml::Value::Table(table)).map_err(|error| {
        let (path, message) = (error.path().to_string(), error.inner().message());
        let settings = toml::Table::try_from(RunConfig::default()).unwrap_or_default();
        let meant =
            if message.starts_with("unknown field") { meant(&path, &settings) } else { String::new() };
        anyhow!("configuration key `{path}`{meant}: {message}")
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use etude_task::Widths;

    #[test]
    fn every_preset_resolves_and_the_paper_is_the_default_in_its_own_world() {
        for (name, _) in PRESETS {
            resolve(name, None, &[]).unwrap();
        }
        let mut paper = resolve("paper", None, &[]).unwrap();
        assert_eq!(etude_task::layout(&paper.task).len(), 369, "as many columns as the paper has");
        assert_eq!(paper.task.physics.len(), 6, "the references of fingers and rail");
        assert_eq!(paper.task.randomisation.intensity, 0.1);
        paper.task.physics.clear();
        paper.task.randomisation.intensity = 0.0;
        (paper.task.previous_joints, paper.task.previous_actions) = (true, 0);
        paper.task.rail_set_point = false;
        paper.task.stage.interlock = false;
        paper.task.reward.clear();
        assert_eq!(paper, RunConfig::default());
    }

    /// `etude train --config RUN/config.toml` repeats a training whatever the preset says.
    #[test]
    fn a_complete_configuration_means_the_same_over_any_preset() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("config.toml");
        for (name, _) in PRESETS {
            let config = resolve(name, None, &[]).unwrap().complete();
            std::fs::write(&file, toml::to_string(&config).unwrap()).unwrap();
            for over in ["paper", "fast", "expressive", "appendix"] {
                let mut again = resolve(over, Some(&file), &[]).unwrap().complete();
                // Not so the physical numbers: those of the preset stay where the file has none.
                again.task.physics.retain(|path, _| config.task.physics.contains_key(path));
                assert_eq!(again, config, "{name} over {over}");
            }
        }
    }

    /// All values of the learner in the preset `paper`, word for word: the paper's where it prints
    /// one, else those of the code that it builds on (`kevinzakka/robopianist-rl`: `sac.py`,
    /// `run.sh`), and for the rest our choice, which does not affect the algorithm. A change of a
    /// default must be deliberate.
    #[test]
    fn the_preset_paper_is_the_published_algorithm() {
        let published: toml::Table = toml::from_str(
            r#"
            [droq]
            hidden = [128, 128, 128] # paper
            arithmetic = "f32"
            dropout = 0.01
            batch = 256
            replay_capacity = 1_000_000
            discount = 0.8
            n_step = 1
            polyak = 0.005
            policy_polyak = 1.0
            smoothness = 0.0
            actor_learning_rate = 3e-4
            critic_learning_rate = 3e-4
            temperature_learning_rate = 3e-4
            initial_temperature = 1.0
            target_entropy_per_action = -0.5
            log_std_bounds = [-20.0, 2.0]

            [trainer]
            seed = 0
            total_steps = 3_000_000 # paper
            num_envs = 1
            updates_per_vector_step = 1
            warmup_steps = 5_000
            log_every_steps = 2_000
            evaluate_every_steps = 10_000
            best_by = ""
            checkpoint_every_steps = 50_000
            threads = 0
            overlap = true
            "#,
        )
        .unwrap();
        let config = toml::Table::try_from(resolve("paper", None, &[]).unwrap()).unwrap();
        assert_eq!(config["droq"], published["droq"]);
        assert_eq!(config["trainer"], published["trainer"]);
        let task = &config["task"];
        assert_eq!(task["lookahead"].as_integer(), Some(5), "paper");
        // "Previous joint positions" are the joints' previous set-points.
        assert_eq!(task["previous_joints"].as_bool(), Some(false));
        assert_eq!(task["previous_actions"].as_integer(), Some(1), "paper");
        // RoboPianist's rule and on its time, keys with one contact, and the main text's five
        // reward terms.
        let config = resolve("paper", None, &[]).unwrap().complete();
        let (task, plan) = (&config.task, &config.task.key_schedule);
        assert_eq!(
            (plan.rule, plan.latency_compensation_secs),
            (etude_music::KeyScheduleRule::Robopianist, 0.0)
        );
        let params = task.params().unwrap();
        assert_eq!(params.world(etude_stage::params::WorldRow::KeyHysteresis), 0.0);
        let weights: Vec<(&str, f64)> = task
            .reward
            .iter()
            .filter(|(_, weight)| **weight != 0.0)
            .map(|(name, weight)| (name.as_str(), *weight))
            .collect();
        let published = [
            ("action_change", 1.0),
            ("collision", 1.0),
            ("energy", 0.005),
            ("key_press", 1.0),
            ("optimal_transport", 1.0),
        ];
        assert_eq!(weights, published, "paper");
    }

    #[test]
    fn later_layers_win_and_the_result_is_a_valid_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("c.toml");
        std::fs::write(&path, "[trainer]\nseed = 4\nnum_envs = 3\n").unwrap();
        let sets = [
            "trainer.seed=9",
            "task.stage.side=right",
            "task.physics.key.threshold=0.6",
            "task.reward.collision=0",
        ];
        let config = resolve("fast", Some(&path), &sets.map(String::from)).unwrap();
        assert_eq!((config.trainer.seed, config.trainer.num_envs), (9, 3));
        assert_eq!(config.task.physics["key.threshold"], 0.6);
        assert_eq!(config.task.reward["collision"], 0.0);
        std::fs::write(&path, toml::to_string(&config).unwrap()).unwrap();
        assert_eq!(stored_config(&path).unwrap(), config);
    }

    #[test]
    fn widths_of_randomisation_are_set_by_path_and_survive_the_file() {
        let sets = |sets: &[&str]| {
            resolve("fast", None, &sets.iter().map(ToString::to_string).collect::<Vec<_>>()).unwrap()
        };
        assert_eq!(sets(&["task.randomisation.widths=paper"]).task, sets(&[]).task);
        let config = sets(&[
            "task.randomisation.intensity=1",
            "task.randomisation.widths.joint.fingers.damping=0.02",
            "task.randomisation.widths.key.stiffness=1",
        ]);
        let Widths::Identified(widths) = &config.task.randomisation.widths else { panic!("{config:?}") };
        assert_eq!((widths["joint.fingers.damping"], widths["key.stiffness"], widths.len()), (0.02, 1.0, 2));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("c.toml");
        std::fs::write(&path, toml::to_string(&config).unwrap()).unwrap();
        assert_eq!(resolve("fast", Some(&path), &[]).unwrap(), config);
        std::fs::write(&path, "[task.randomisation.widths]\n\"key.threshold\" = 0.1\n").unwrap();
        assert!(matches!(
            resolve("fast", Some(&path), &[]).unwrap().task.randomisation.widths,
            Widths::Identified(widths) if widths["key.threshold"] == 0.1
        ));
        let said =
            resolve("fast", None, &["task.randomisation.widths=wide".to_string()]).unwrap_err().to_string();
        assert!(said.contains("task.randomisation.widths") && said.contains("paper"), "{said}");
    }

    #[test]
    fn numbers_may_be_written_as_people_write_them() {
        let set = |text: &str| resolve("fast", None, &[text.to_string()]).unwrap();
        assert_eq!(set("trainer.total_steps=2e6").trainer.total_steps, 2_000_000);
        assert_eq!(set("droq.initial_temperature=1").droq.initial_temperature, 1.0);
        assert_eq!(set("droq.initial_temperature=1.0").droq.initial_temperature, 1.0);
    }

    #[test]
    fn what_cannot_work_is_refused_and_so_is_a_change_of_what_was_learned() {
        let check = |text: &str| resolve("fast", None, &[text.to_string()]).unwrap().check();
        assert!(check("trainer.seed=3").is_ok());
        assert!(
            check("trainer.best_by=overal")
                .unwrap_err()
                .to_string()
                .contains("onset_f1, onset_offset_f1, overall")
        );
        assert!(check("droq.batch=0").unwrap_err().to_string().contains("droq.batch"));
        assert!(check("trainer.num_envs=100000000000").unwrap_err().to_string().contains("from 1 to 4096"));
        let change = |text: &str| change_resumable(&RunConfig::default(), &[text.to_string()]);
        assert_eq!(change("trainer.total_steps=7").unwrap().trainer.total_steps, 7);
        assert!(
            change("task.reward.collision=0").unwrap_err().to_string().contains("`task.reward.collision`")
        );
    }

    #[test]
    fn errors_name_the_key() {
        let message = |set: &str| resolve("fast", None, &[set.to_string()]).unwrap_err().to_string();
        assert!(message("trainer.sead=3").contains("trainer"), "{}", message("trainer.sead=3"));
        assert!(message("trainer.sead=3").contains("`trainer.sead` (did you mean seed?)"));
        // The right name in the wrong place.
        assert!(message("num_envs=3").contains("`num_envs` (did you mean trainer.num_envs?)"));
        assert!(message("droq.seed=3").contains("(did you mean trainer.seed?)"));
        assert!(message("trainr.seed=3").contains("(did you mean trainer?)"));
        assert!(message("task.lookahed=3").contains("(did you mean lookahead?)"));
        assert!(message("droq.batch=many").contains("droq.batch"));
        assert!(message("nonsense").contains("path=value"));
        assert!(message("trainer.num_envs=1.5").contains("trainer.num_envs"));
        assert!(
            resolve("slow", None, &[])
                .unwrap_err()
                .to_string()
                .contains("fast, expressive, paper, appendix, sight-reader")
        );
    }
}
