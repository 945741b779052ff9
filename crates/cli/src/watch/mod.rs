//! The full-screen view of running trainings.

mod chart;
mod draw;
mod rows;
mod screen;
#[cfg(test)]
mod tests;
pub mod text;
mod view;

pub use screen::show;
pub use view::View;
