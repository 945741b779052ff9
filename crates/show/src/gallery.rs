//! A gallery: an index page of recordings, each with a still picture, its sound, and its replay behind it.

use std::path::{Path, PathBuf};

use anyhow::bail;
use etude_lab::{Interrupted, make_folder};
use etude_music::sound;
use etude_perform::{Job, write_file};
use etude_stage::{PictureError, View};
use maud::html;
use serde::Serialize;

use crate::html::page;
use crate::render::Studio;
use crate::replay::{PlayedNote, Take, read_take, replay_page, roll_svg};
use crate::slug;

/// Size of a still, pixels.
const STILL: [u32; 2] = [960, 540];
/// Name of the index page.
pub const INDEX: &str = "index.html";

/// The contents of a gallery.
#[derive(Clone, Debug, Serialize)]
pub struct Gallery {
    /// The index page.
    pub index: PathBuf,
    /// The recordings that it shows.
    pub exhibits: Vec<Exhibit>,
    /// Why other recordings are missing.
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

/// Makes a gallery of `recordings` in `folder`. Reports the index of the recording that is next.
///
/// # Errors
/// If no recording can be shown, or a file cannot be written; [`Interrupted`] if the job is interrupted.
pub fn gallery(recordings: &[PathBuf], folder: &Path, job: &mut Job<'_, usize>) -> anyhow::Result<Gallery> {
    make_folder(folder)?;
    let mut gallery = Gallery {
        index: folder.join(INDEX),
        exhibits: Vec::new(),
        left_out: Vec::new(),
        without_pictures: None,
    };
    for (number, path) in recordings.iter().enumerate() {
        if job.is_interrupted() {
            let text = format!("stopped on request; what was made so far is in {}", folder.display());
            return Err(Interrupted(text).into());
        }
        job.tell(&number);
        // A damaged file must not prevent the others from being shown.
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
        sound::write_wav(folder.join(file("wav")), &take.sound()?)?;
        let mut picture = file("png");
        let drawn =
            if gallery.without_pictures.is_none() { still(&take, &folder.join(&picture)) } else { Ok(false) };
        let is_drawn = match drawn {
            // Without OpenGL no other picture can be drawn either.
            Err(error) if error.is::<PictureError>() => {
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
        // The index is complete after each recording, so a gallery that is stopped can be opened.
        write_file(&gallery.index, &index(&gallery.exhibits))?;
    }
    if gallery.exhibits.is_empty() {
        bail!("nothing to show: {}", gallery.left_out.first().map_or("", String::as_str));
    }
    Ok(gallery)
}

/// Draws a moment in which a key sounds; `false` if the recording has no motion.
fn still(take: &Take, path: &Path) -> anyhow::Result<bool> {
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
    let name = slug(&format!("{} {} {}", take.song, take.rig, take.mode));
    format!("{:03}-{}", number + 1, name.chars().take(80).collect::<String>())
}

fn index(exhibits: &[Exhibit]) -> String {
    let body = html! {
        p {
            "Each picture leads to its replay: the hand in motion, what was due and what was played, and the sound. F1 is the \
             paper's, by control step."
        }
        div.pictures {
            @for exhibit in exhibits {
                figure {
                    h2 { (exhibit.song) }
                    a href=(exhibit.replay) {
                        img src=(exhibit.picture) alt=(exhibit.song) width="100%" loading="lazy";
                    }
                    figcaption {
                        (exhibit.rig)
                        @if !exhibit.mode.is_empty() { ", " (exhibit.mode) }
                        ": "
                        @if let Some(f1) = exhibit.f1 { "F1 " (format!("{f1:.3}")) ", " }
                        (format!("{:.0}", exhibit.secs)) " s, played by " (exhibit.player) "."
                        @if let Some(text) = &exhibit.incomplete { " " (text) }
                        br;
                        code { (exhibit.recording) }
                    }
                    audio controls preload="none" src=(exhibit.sound) {}
                }
            }
        }
    };
    page("Étude: recordings", &body)
}
