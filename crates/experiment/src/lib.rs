//! Experiments: files that say what is compared, plans made of them, launchers that do the work, statistics, and reports.

mod config;
mod course;
mod drawings;
mod figure;
mod local;
mod outcome;
mod plan;
mod record;
mod report;
mod slurm;
mod stats;
mod tables;
mod task;

pub use config::{
    Experiment, ExperimentError, FigureConfig, FigureKind, FitConfig, PerformConfig, Published,
    RehearseConfig, Variant, names,
};
pub use local::{BUSY, LOG, LaunchError, LaunchProgress, LaunchReport, LocalConfig, launch_local};
pub use outcome::{Row, TaskEnd, TaskProgress, TaskResult, TaskState, TaskTimes, Values};
pub use plan::{
    Budget, PlanConfig, PlanError, Task, TrainingConfig, TrainingConfigError, Work, plan_file, plan_text,
    read_plan, write_plan,
};
pub use report::{Missing, ReportError, ReportPage, write_report};
pub use slurm::{SlurmConfig, SlurmError, open_tasks, slurm_script, submit};
pub use task::{TaskFailure, run_task};
