//! Runs: from names and files to a trained policy, its scores, and a simulator fitted to the robot.
//!
//! [`RunConfig`] is everything that decides a training; it comes in layers (preset, file,
//! overrides) and is written into the run's folder, where it is itself a valid config file. A
//! [`Training`] makes policies, [`play`](play()) plays them in simulation, [`play_on_robot`] on a
//! robot or its twin, [`identify_robot`] fits the simulator to recordings, and
//! [`rehearse_on_robot`] does all of it in iterations.

mod adapt;
mod choose_player;
mod config;
mod correction;
mod doctor;
mod errors;
mod excitations;
mod folder;
mod identify;
mod json_files;
mod loaded_player;
mod play;
mod policy_files;
mod record;
mod rehearse;
mod results;
mod robot;
mod robustness;
mod song_planner;
mod training;
mod training_progress;
mod warm_start;
mod within_limits;
mod zero_shot;

pub use adapt::{AdaptConfig, AdaptRun, AdaptStep, Adapted, adapt_on_robot, adapted_before};
pub use choose_player::{Chosen, choose_player};
pub use config::{DEFAULT_PRESET, RunConfig, presets, resolve, stored_config, toml_error};
pub use correction::CorrectionFile;
pub use doctor::{Finding, examine};
pub use errors::{Interrupted, SafetyStop, released};
pub use excitations::record_excitations;
pub use folder::{CONFIG, META, SONG, make_folder, player_slug, readable, slug};
pub use identify::{IDENTIFIED, Identification, IdentifyMethod, IdentifyReport, identify_robot};
pub use loaded_player::{LoadedPlayer, load_player};
pub use play::{Files, PAGE, PlayReport, RECORDING, REPORT, play, scores_in_simulation};
pub use policy_files::{policies, policy_called, shipped_policy};
pub use record::{Recorded, RobotMotion, record_robot};
pub use rehearse::{
    Iteration, Prediction, RehearsalConfig, RehearsalFit, RehearsalStep, best_iteration, rehearse_on_robot,
    set_latency_compensation,
};
pub use results::{LATEST, all_results, folder_of_song, is_other_result, latest_result, numbered};
pub use robot::{
    MeanNotes, RobotPlay, RobotReport, RobotRun, RobotScores, RobotStep, play_on_robot, run_file,
};
pub use robustness::{
    Marginal, RobustnessConfig, RobustnessReport, ScoreSummary, WorldScores, evaluate_robustness,
};
pub use song_planner::SongPlanner;
pub use training::{Training, find_song};
pub use training_progress::TrainingProgress;
pub use warm_start::beginning_with;
pub use within_limits::{Remedy, TooFast, slower_rail, too_fast};
pub use zero_shot::{Arrangement, SIGHT_READER, ZeroShot, cannot_be_played, easier, predict_zero_shot};
