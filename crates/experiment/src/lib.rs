//! Experiments: files that say what is compared, plans made of them, launchers that do the work,
//! statistics, and reports.

mod config;
mod curves;
mod duration;
mod figures;
mod local;
mod outcome;
mod playing;
mod report;
mod results;
mod run;
mod slurm;
mod stats;
mod tables;
mod trial;
mod trial_plan;
mod trial_plan_file;

pub use config::{
    Experiment, FigureConfig, FigureKind, FitConfig, PerformConfig, Published, RehearseConfig, Variant, names,
};
pub use duration::WorkEstimate;
pub use local::{ATTENDED, BUSY, LOG, Launch, LocalConfig, launch_local};
pub use outcome::{ResultRow, TrialEnd, TrialProgress, TrialResult, TrialState, TrialTimes, Values};
pub use report::{ReportPage, write_report};
pub use run::run_trial;
pub use slurm::{SlurmConfig, open_trials, slurm_script, submit};
pub use trial::{TrainingConfig, Trial, TrialWork};
pub use trial_plan::ExperimentConfig;
pub use trial_plan_file::{plan_file, plan_text, read_plan, write_plan};
