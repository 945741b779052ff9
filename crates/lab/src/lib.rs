//! Runs: from names and files to a trained policy, its scores, and a simulator fitted to the robot.
//!
//! [`RunConfig`] is everything that decides a training; it comes in layers (preset, file, overrides) and is written
//! into the run's folder, where it is itself a valid config file. A [`Run`] makes policies, [`play`](play()) plays them in simulation,
//! [`play_on_robot`] on a robot or its twin, [`identify_robot`] fits the simulator to recordings, and [`rehearse_on_robot`] does
//! all of it in rounds.

mod adapt;
mod at_sight;
pub mod bench;
mod config;
mod correction;
mod doctor;
mod earlier;
mod errors;
mod excitations;
mod folder;
mod grid;
mod identify;
mod kept;
pub mod machine;
mod pianist;
mod planning;
mod play;
mod record;
mod rehearse;
mod robot;
mod run;
mod warm;

pub use adapt::{AdaptConfig, AdaptRun, AdaptStep, Adapted, adapt_on_robot, adapted_before};
pub use at_sight::{Arrangement, AtSight, cannot_be_played, easier, predicted_at_sight};
pub use config::{DEFAULT_PRESET, RunConfig, presets, resolve, toml_error};
pub use correction::CorrectionFile;
pub use doctor::{Finding, examine};
pub use earlier::{earlier_of, is_of_another_performance};
pub use errors::{Interrupted, released};
pub use excitations::record_excitations;
pub use folder::{CONFIG, META, SONG, make_folder, slug};
pub use grid::{GridConfig, GridReport, Marginal, WorldScores, evaluate_grid};
pub use identify::{IDENTIFIED, Identification, IdentifyMethod, IdentifyReport, identify_robot};
pub use kept::{Kept, player_slug};
pub use pianist::{
    Chosen, Pianist, SIGHT_READER, load_pianist, pianist_for, policies, policy_called, shipped_policy,
};
pub use planning::planning_told;
pub use play::{Files, PAGE, PlayReport, PlayStep, RECORDING, REPORT, play, scores_in_simulation};
pub use record::{Motion, Recorded, record_robot};
pub use rehearse::{RehearsalConfig, RehearsalStep, Round, best_round, name_the_lead, rehearse_on_robot};
pub use robot::{MeanNotes, RobotPlay, RobotReport, RobotRun, RobotStep, play_on_robot, run_file};
pub use run::{Run, TrainingProgress, find_song};
pub use warm::beginning_with;
