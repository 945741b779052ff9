//! Everything that shows a run: replay pages, galleries, pictures and videos, running trainings,
//! the page of a rehearsal, and models for other programs.

pub mod compare;
pub mod export;
pub mod figure;
pub mod gallery;
pub mod html;
mod rehearsal_page;
pub mod render;
pub mod replay;
mod strip;
pub mod watch;
mod work_page;

pub use rehearsal_page::{REHEARSAL_PAGE, RehearsalPage};
pub use work_page::work_page;
