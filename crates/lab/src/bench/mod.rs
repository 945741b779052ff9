//! Speed: of environments, learner and whole trainings, beside other programs.

mod measure;
mod peer;
mod rate;

pub use measure::{BenchReport, Row, measure};
pub use rate::training_rate;
