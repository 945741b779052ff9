//! Recordings of excitations, for a fit.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use etude_perform::session::RigChoice;
use etude_perform::{Ending, Excitation};

use crate::errors::{Interrupted, safety_stop, unusable};
use crate::folder::make_folder;
use crate::record::{RobotMotion, record_robot};

/// Records these excitations into `folder`, except those that are there already, and returns their
/// paths. `on_progress` is called after each new one, with which it is, from 1, and how many there
/// are.
///
/// # Errors
/// If the robot does not get ready or stops itself, or a recording cannot be written;
/// [`Interrupted`] if `interrupt` is set.
pub fn record_excitations(
    rig: &RigChoice,
    excitations: &[Excitation],
    folder: &Path,
    seed: u64,
    interrupt: &AtomicBool,
    on_progress: &mut dyn FnMut(Excitation, [usize; 2]),
) -> anyhow::Result<Vec<PathBuf>> {
    make_folder(folder)?;
    let mut paths = Vec::new();
    for (index, excitation) in Excitation::ALL.into_iter().enumerate() {
        if !excitations.contains(&excitation) {
            continue;
        }
        let path = folder.join(format!("{excitation}.mcap"));
        if !path.is_file() {
            let partial = path.with_extension("partial");
            let motion = RobotMotion::Excitation(excitation);
            let seed = seed.wrapping_add(index as u64);
            match record_robot(rig, motion, true, seed, &partial, interrupt)?.ending {
                Ending::Complete => {}
                Ending::Interrupted => return Err(Interrupted::resumable().into()),
                Ending::Fault(fault) => return Err(safety_stop("recording", &fault)),
            }
            std::fs::rename(&partial, &path).map_err(|error| unusable(&path, error))?;
            on_progress(excitation, [paths.len() + 1, excitations.len()]);
        }
        paths.push(path);
    }
    Ok(paths)
}
