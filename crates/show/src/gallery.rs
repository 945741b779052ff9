//! A gallery: an index page of recordings, each with a still picture, its sound, and its replay behind it.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use etude_identify::html::{escape, page};
use etude_music::sound;
use etude_perform::{FileError, write_file};
use etude_stage::View;
use serde::Serialize;

use crate::render::{RenderError, Studio};
use crate::replay::{PlayedNote, ReplayError, Take, read_take, replay_page, roll_svg};

/// Size of a still, pixels.
const STILL: [u32; 2] = [960, 540];
/// Name of the index page.
pub const INDEX: &str = "index.html";

/// A gallery could not be made.
#[derive(Debug, thiserror::Error)]
pub enum GalleryError {
    /// A recording cannot be shown.
    #[error(transparent)]
    Replay(#[from] ReplayError),
    /// A picture or the sound cannot be made.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] FileError),
    /// The folder cannot be made.
    #[error("cannot make the folder {path}: {source}; choose another with -o")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// No recording can be shown.
    #[error("nothing to show: {0}")]
    Nothing(String),
    /// It was asked to stop.
    #[error("stopped on request; what was made so far is in {0}")]
    Stopped(PathBuf),
}

/// What a gallery came to.
#[derive(Clone, Debug, Serialize)]
pub struct Gallery {
    /// The index page.
    pub index: PathBuf,
    /// What hangs in it.
    pub exhibits: Vec<Exhibit>,
    /// Why recordings are not among them.
    pub left_out: Vec<String>,
    /// Why the pictures are piano rolls, if they are.
    pub without_pictures: Option<String>,
}

/// One recording in a gallery. Files are named as the index page links them.
#[derive(Clone, Debug, Serialize)]
pub struct Exhibit {
    /// Path of the recording.
    pub recording: String,
    /// Title of the song.
    pub song: String,
    /// Who played.
    pub player: String,
    /// On what.
    pub rig: String,
    /// The execution mode; empty in simulation.
    pub mode: String,
    /// F1 by control step; none without a song.
    pub f1: Option<f64>,
    /// Length, s.
    pub secs: f64,
    /// The replay.
    pub replay: String,
    /// A still picture, or the piano roll.
    pub picture: String,
    /// The sound.
    pub sound: String,
    /// What is missing in the recording.
    pub incomplete: Option<String>,
}

/// Makes a gallery of `recordings` in `folder`. `tell` hears which one is at work.
///
/// # Errors
/// If a recording cannot be read or a file not written.
pub fn gallery(
    recordings: &[PathBuf],
    folder: &Path,
    interrupt: &AtomicBool,
    tell: &mut dyn FnMut(usize, &Path),
) -> Result<Gallery, GalleryError> {
    std::fs::create_dir_all(folder)
        .map_err(|source| GalleryError::Folder { path: folder.to_path_buf(), source })?;
    let mut gallery = Gallery {
        index: folder.join(INDEX),
        exhibits: Vec::new(),
        left_out: Vec::new(),
        without_pictures: None,
    };
    for (number, path) in recordings.iter().enumerate() {
        if interrupt.load(Ordering::Relaxed) {
            return Err(GalleryError::Stopped(folder.to_path_buf()));
        }
        tell(number, path);
        // One damaged file must not keep the others from being shown.
        let take = match read_take(path) {
            Ok(take) => take,
            Err(error) => {
                gallery.left_out.push(error.to_string());
                continue;
            }
        };
        let stem = stem(number, &take);
        let file = |ending: &str| format!("{stem}.{ending}");
        replay_page(std::slice::from_ref(&take), &folder.join(file("html")))?;
        let samples = take.sound().map_err(RenderError::from)?;
        sound::write_wav(folder.join(file("wav")), &samples).map_err(RenderError::from)?;
        let mut picture = file("png");
        let drawn =
            if gallery.without_pictures.is_none() { still(&take, &folder.join(&picture)) } else { Ok(false) };
        let is_drawn = match drawn {
            // Without OpenGL no other picture can be drawn either.
            Err(RenderError::Picture(error)) => {
                gallery.without_pictures = Some(error.to_string());
                false
            }
            drawn => drawn?,
        };
        if !is_drawn {
            picture = file("svg");
            write_file(&folder.join(&picture), &roll_svg(&take))?;
        }
        gallery.exhibits.push(Exhibit {
            replay: file("html"),
            picture,
            sound: file("wav"),
            f1: take.last.map(|scores| scores.f1),
            secs: take.secs(),
            recording: take.name,
            song: take.song,
            player: take.player,
            rig: take.rig,
            mode: take.mode,
            incomplete: take.incomplete,
        });
        // The index is there from the first one on: a gallery that is stopped can be looked at.
        write_file(&gallery.index, &index(&gallery.exhibits))?;
    }
    if gallery.exhibits.is_empty() {
        return Err(GalleryError::Nothing(gallery.left_out.into_iter().next().unwrap_or_default()));
    }
    Ok(gallery)
}

/// Draws a moment in which something sounds; `false` if nothing moves in the recording.
fn still(take: &Take, path: &Path) -> Result<bool, RenderError> {
    if take.positions.is_empty() {
        return Ok(false);
    }
    // The middle of the longest note.
    let length = |note: &&PlayedNote| note.end - note.start;
    let longest = take.notes.iter().max_by(|one, other| length(one).total_cmp(&length(other)));
    let secs = longest.map_or(take.secs() / 2.0, |note| (note.start + note.end) / 2.0);
    Studio::new(take, STILL, View::Player)?.still(secs, path)?;
    Ok(true)
}

/// Name of an exhibit's files: in order, and readable.
fn stem(number: usize, take: &Take) -> String {
    let words = format!("{} {} {}", take.song, take.rig, take.mode).to_lowercase();
    let plain: String = words.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
    let parts: Vec<&str> = plain.split('-').filter(|part| !part.is_empty()).collect();
    let name: String = parts.join("-").chars().take(80).collect();
    format!("{:03}-{name}", number + 1)
}

fn index(exhibits: &[Exhibit]) -> String {
    let mut body = String::from(
        "<p>Each picture leads to its replay: the hand in motion, what was due and what was played, and the sound. F1 is the \
         paper's, by control step.</p>\n<div class=\"pictures\">\n",
    );
    for exhibit in exhibits {
        let on = if exhibit.mode.is_empty() {
            exhibit.rig.clone()
        } else {
            format!("{}, {}", exhibit.rig, exhibit.mode)
        };
        let f1 = exhibit.f1.map_or_else(String::new, |f1| format!("F1 {f1:.3}, "));
        let missing = exhibit.incomplete.as_deref().map_or_else(String::new, |text| format!(" {text}"));
        let caption = format!("{on}: {f1}{:.0} s, played by {}.{missing}", exhibit.secs, exhibit.player);
        // Writing to a string cannot fail.
        let _ = writeln!(
            body,
            "<figure><h2>{song}</h2><a href=\"{}\"><img src=\"{}\" alt=\"{song}\" width=\"100%\" loading=\"lazy\"/></a>\n\
             <figcaption>{}<br/><code>{}</code></figcaption>\n<audio controls=\"\" preload=\"none\" src=\"{}\"></audio></figure>",
            exhibit.replay,
            exhibit.picture,
            escape(&caption),
            escape(&exhibit.recording),
            exhibit.sound,
            song = escape(&exhibit.song),
        );
    }
    body.push_str("</div>\n");
    page("Étude: recordings", &body)
}
