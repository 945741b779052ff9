//! Parameter estimation: the physical parameters with which a simulation repeats recordings, and
//! their uncertainty.
//!
//! A [`Problem`] is a [`Space`] of parameters, the [`Block`]s of residuals between simulation and
//! recording, and a [`Loss`]. A [`Fit`] searches it by one of two methods ([`MethodConfig`]):
//! Levenberg–Marquardt ([`LmConfig`]) or Bayesian optimisation ([`BoConfig`], the paper's). The
//! caller evaluates: [`Fit::ask`] gives a batch of candidates, which may be simulated in any order
//! and on any number of threads, and [`Fit::tell`] takes their residuals. An [`Estimate`] holds
//! intervals, correlations and what is not identifiable.
//!
//! ```
//! use etude_identify::{Block, Fit, LmConfig, Loss, MethodConfig, Parameter, Problem, Space};
//!
//! let space = Space::new(vec![Parameter::new("joint.index_1.damping", 0.0, 1.0, 0.9)])?;
//! let problem = Problem::new(space, vec![Block::new("index_1", 2)], Loss::Squared)?;
//! let mut fit = Fit::new(problem, &MethodConfig::Lm(LmConfig::default()), 1)?;
//! while fit.finished().is_none() {
//!     let simulate = |values: &[f64]| Some(vec![values[0] - 0.3, 2.0 * (values[0] - 0.3)]);
//!     let evaluations: Vec<_> = fit.ask().iter().map(|candidate| simulate(&candidate.values)).collect();
//!     fit.tell(&evaluations)?;
//!     // A long fit can be saved here (it is `Serialize`) and resumed after an interruption.
//! }
//! assert!((fit.best().map_or(0.0, |best| best.values[0]) - 0.3).abs() < 1e-6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Guarantees, each with a test: the same seed and evaluations give the same candidates with any
//! number of threads; a fit that is saved after any tell and loaded ends with the same result;
//! candidates lie inside the bounds; a failed evaluation, or one with a NaN, does not end the fit
//! and never becomes the best; optima and covariances agree with SciPy's
//! (`scripts/golden_identify.py`).

mod assessment;
mod autocorrelation;
mod bayesian;
mod config;
mod error;
mod estimate;
mod fit;
mod gaussian_process;
mod gravity_compensation;
mod group;
mod identification;
mod jacobian;
mod levenberg_marquardt;
mod method;
mod motion;
mod parameter_bounds;
mod presses;
mod problem;
mod replay;
mod report;
mod space;

pub use assessment::{Assessment, JointErrors};
pub use autocorrelation::integrated_autocorrelation;
pub use config::{BoConfig, Differences, LmConfig, MethodConfig};
pub use error::FitError;
pub use estimate::{BlockStatistics, Bound, Estimate, ParameterEstimate, WeakDirection};
pub use fit::{Best, Fit};
pub use gravity_compensation::{GravityCompensation, fit_gravity_compensation};
pub use group::Group;
pub use identification::{Identified, IdentifyConfig, IdentifyError, Pass, PassEnd, Progress, identify};
pub use jacobian::{Jacobian, JacobianPlan, Linearisation};
pub use method::{Candidate, StopReason};
pub use motion::{Commands, MotionError, RecordedMotion};
pub use presses::{Measured, describe as describe_keyboard};
pub use problem::{Block, Evaluation, Loss, Problem};
pub use replay::{Replayer, Trace};
pub use report::{Curve, Figure, Report, ReportInput};
pub use space::{Parameter, Scale, Space};
