//! Experiments: files that say what is compared, plans made of them, launchers that do the work, statistics, and reports.

mod config;
mod course;
mod drawings;
mod local;
mod notes;
mod outcome;
mod pieces;
mod plan;
mod plan_file;
mod record;
mod report;
mod slurm;
mod stats;
mod tables;
mod trial;
mod work;

pub use config::{
    Experiment, FigureConfig, FigureKind, FitConfig, PerformConfig, Published, RehearseConfig, Variant, names,
};
pub use local::{BUSY, LOG, LaunchProgress, LaunchReport, LocalConfig, launch_local};
pub use outcome::{Row, TrialEnd, TrialProgress, TrialResult, TrialState, TrialTimes, Values};
pub use plan::PlanConfig;
pub use plan_file::{plan_file, plan_text, read_plan, write_plan};
pub use report::{ReportPage, write_report};
pub use slurm::{SlurmConfig, open_trials, slurm_script, submit};
pub use trial::{TrainingConfig, Trial, Work};
pub use work::run_trial;
