//! Everything that shows a run: replay pages, galleries, pictures and videos, running trainings, the page of a rehearsal, and
//! models for other programs.

pub mod export;
pub mod gallery;
mod rehearsal_page;
pub mod render;
pub mod replay;
pub mod watch;

pub use rehearsal_page::{REHEARSAL_PAGE, RehearsalPage};
