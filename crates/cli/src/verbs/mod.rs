//! One module a verb.

pub mod compare;
pub mod completions;
pub mod doctor;
pub mod evaluate;
pub mod experiment;
pub mod export;
pub mod gallery;
pub mod identify;
pub mod man;
pub mod model;
pub mod perform;
pub mod play;
pub mod record;
pub mod rehearse;
pub mod render;
pub mod replay;
pub mod robot;
pub mod serve;
pub mod songs;
pub mod train;
pub mod twin;
pub mod watch;
