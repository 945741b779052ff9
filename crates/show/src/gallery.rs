//! A gallery: an index page of recordings, each with a still picture, its piano roll, its sound,
//! and its replay behind them.

use std::path::{Path, PathBuf};

use anyhow::bail;
use etude_lab::{Interrupted, make_folder, readable};
use etude_music::metrics::NoteScores;
use etude_music::sound;
use etude_perform::{Job, NoteCounts, write_file};
use etude_stage::{PictureError, View};
use maud::html;
use serde::Serialize;

use crate::html::page;
use crate::render::Studio;
use crate::replay::{Take, TakeNote, read_take, replay_page, roll_svg};

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
    /// Why there are piano rolls only, if there are.
    pub without_pictures: Option<String>,
}

/// One recording in a gallery. Files are named as the index page links them.
#[derive(Clone, Debug, Serialize)]
pub struct Exhibit {
    /// Path of the recording.
    pub recording: String,
    /// Title of the song.
    pub song: String,
    /// The player.
    pub player: String,
    /// The same in short, for people.
    #[serde(skip)]
    pub who: String,
    /// On what.
    pub rig: String,
    /// The execution mode; empty in simulation.
    pub mode: String,
    /// F1 by control step; none without a song.
    pub f1: Option<f64>,
    /// Scores by note; none if the recording does not say which were due.
    pub notes: Option<NoteScores>,
    /// Length, s.
    pub secs: f64,
    /// The replay.
    pub replay: String,
    /// A still picture; none without OpenGL, or if the recording has no motion.
    pub picture: Option<String>,
    /// The piano roll.
    pub roll: String,
    /// The sound.
    pub sound: String,
    /// What is missing in the recording.
    pub incomplete: Option<String>,
}

/// Makes a gallery of `recordings` in `folder`. Reports the index of the next recording.
///
/// # Errors
/// If no recording can be shown, or a file cannot be written; [`Interrupted`] if the job is
/// interrupted.
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
        job.report(&number);
        // A damaged file does not stop the others.
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
        write_file(&folder.join(file("svg")), &roll_svg(&take))?;
        let picture = file("png");
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
        gallery.exhibits.push(Exhibit {
            replay: file("html"),
            picture: is_drawn.then_some(picture),
            roll: file("svg"),
            sound: file("wav"),
            notes: take.note_scores,
            f1: take.last.map(|scores| scores.f1),
            secs: take.secs(),
            recording: take.name,
            song: take.song,
            who: take.who,
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

/// Draws the fingers at the time of most keys; `false` if the recording has no motion.
fn still(take: &Take, path: &Path) -> anyhow::Result<bool> {
    if take.positions.is_empty() {
        return Ok(false);
    }
    Studio::without_roll(take, STILL, View::Fingers)?.still(best_moment(take), path)?;
    Ok(true)
}

/// The middle of the note with which the most others sound; of several, the longest.
fn best_moment(take: &Take) -> f64 {
    let middle = |note: &TakeNote| (note.start + note.end) / 2.0;
    let others = |secs: f64| take.notes.iter().filter(|note| (note.start..note.end).contains(&secs)).count();
    let length = |note: &TakeNote| note.end - note.start;
    let best = take.notes.iter().max_by(|one, other| {
        let counts = others(middle(one)).cmp(&others(middle(other)));
        counts.then(length(one).total_cmp(&length(other)))
    });
    best.map_or(take.secs() / 2.0, middle).clamp(0.0, take.secs())
}

/// Name of an exhibit's files: in order, and readable.
fn stem(number: usize, take: &Take) -> String {
    let name = readable(&format!("{} {} {}", take.song, take.rig, take.mode));
    format!("{:03}-{}", number + 1, name.chars().take(80).collect::<String>())
}

fn index(exhibits: &[Exhibit]) -> String {
    let body = html! {
        p {
            "Each picture links to its replay. In the piano roll, a right note is filled, one too early or too late is pale with a purple \
             outline, a missed one is hatched in red, and a wrong stroke is a narrow orange bar."
        }
        div.cards {
            @for exhibit in exhibits {
                article.card {
                    a href=(exhibit.replay) {
                        @if let Some(picture) = &exhibit.picture {
                            img src=(picture) alt="" width=(STILL[0]) height=(STILL[1]) loading="lazy";
                        }
                        img.roll src=(exhibit.roll) alt={ "Replay of " (exhibit.song) ", " (played_on(exhibit)) } loading="lazy";
                    }
                    h2 { (exhibit.song) }
                    p {
                        (format!("{:.0} s", exhibit.secs))
                        @if let Some(notes) = &exhibit.notes { " · " strong { (NoteCounts::from(notes)) } }
                    }
                    p.quiet {
                        @if let Some(f1) = exhibit.f1 { "F1 " (format!("{f1:.3}")) " · " }
                        (exhibit.who) ", " (played_on(exhibit)) "."
                        @if let Some(text) = &exhibit.incomplete { " " (text) }
                        br;
                        code { (exhibit.recording) }
                    }
                    audio controls preload="none" src=(exhibit.sound) aria-label={ "Sound of " (exhibit.song) } {}
                }
            }
        }
        p.quiet { "F1 is by control step." }
    };
    page("Recordings", &body)
}

fn played_on(exhibit: &Exhibit) -> String {
    match exhibit.mode.as_str() {
        "" => exhibit.rig.clone(),
        mode => format!("{}, {mode}", exhibit.rig),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use etude_perform::{Activity, Header, Recording, StepMessage};
    use etude_stage::DRIVEN_JOINTS;

    #[test]
    fn the_picture_is_of_most_keys_then_of_the_longest_note() {
        let steps = vec![StepMessage { positions: vec![0.0; DRIVEN_JOINTS], ..StepMessage::default() }; 100];
        let header = Header { control_hz: 20.0, activity: Activity::Rest, ..Header::default() };
        let recording = Recording { header, steps, complete: true, ..Recording::default() };
        let mut take = Take::new(&recording, "r".to_string()).unwrap();
        let note = |start, end| TakeNote { pitch: 60, start, end, velocity: 60 };
        for (notes, secs) in [
            (vec![], 2.5),
            (vec![note(0.0, 0.5), note(1.0, 3.0)], 2.0),
            (vec![note(0.0, 1.9), note(2.0, 3.0), note(2.2, 2.9)], 2.5),
            (vec![note(4.5, 9.0)], 5.0),
        ] {
            take.notes = notes;
            assert_eq!(best_moment(&take), secs);
        }
    }
}
