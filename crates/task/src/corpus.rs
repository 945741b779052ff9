//! The pieces of a training that plays another one in every episode: drawn melodies, or the MIDI
//! files of a folder.
//!
//! Both are split into parts by their notes ([`Song::split`]). Episodes play pieces of
//! [`Split::Training`], evaluations a fixed set of [`Split::Validation`].

use std::path::{Path, PathBuf};

use etude_checks::check_range;
use etude_learn::seed::fnv;
use etude_music::{Song, SongError, Split, is_named_midi, melodies};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use walkdir::WalkDir;

use crate::{Piece, TaskConfig, TaskError};

/// Where the pieces of a training come from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CorpusConfig {
    /// A folder of MIDI files (`.mid`), searched with the folders in it; without one, melodies are
    /// drawn ([`etude_music::melody`]).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub folder: Option<PathBuf>,
    /// Held-out pieces that an evaluation plays.
    pub validation_pieces: usize,
}

impl Default for CorpusConfig {
    fn default() -> Self {
        Self { folder: None, validation_pieces: 8 }
    }
}

/// Drawn melodies that distinguish one generator from another.
const DISTINCTIVE: usize = 4;

impl CorpusConfig {
    /// A checksum of the notes: other files in the folder, or melodies drawn in another way, have
    /// another one.
    ///
    /// # Errors
    /// If the folder or a file in it cannot be read.
    pub fn checksum(&self) -> Result<u64, TaskError> {
        let songs = match &self.folder {
            Some(folder) => FoundSongs::below(folder)?.songs,
            None => melodies(Split::Validation, 0).take(DISTINCTIVE).collect(),
        };
        let notes: Vec<_> = songs.iter().map(Song::notes).collect();
        Ok(fnv(format!("{notes:?}").as_bytes()))
    }

    /// The MIDI files of the folder that are not used, and why: damaged ones, and songs that are
    /// wider than the keyboard.
    ///
    /// # Errors
    /// If the folder or a file in it cannot be read.
    pub fn left_out(&self) -> Result<Vec<String>, TaskError> {
        self.folder.as_ref().map_or_else(|| Ok(Vec::new()), |folder| Ok(FoundSongs::below(folder)?.left_out))
    }
}

/// The most held-out pieces of an evaluation. Each has a world of its own.
const MAX_VALIDATION_PIECES: f64 = 1024.0;

/// The pieces, planned for one task.
#[derive(Debug)]
pub struct Corpus {
    task: TaskConfig,
    /// The pieces of the folder that are learned; none where melodies are drawn.
    files: Vec<Piece>,
    validation: Vec<Piece>,
}

impl Corpus {
    /// The corpus of a task. The files of a folder are planned at once, melodies when they are
    /// played.
    ///
    /// # Errors
    /// If the folder or a file in it cannot be read, or there are too few pieces.
    pub fn new(config: &CorpusConfig, task: &TaskConfig) -> Result<Self, TaskError> {
        let wanted = config.validation_pieces;
        check_range("corpus.validation_pieces", wanted as f64, 1.0..=MAX_VALIDATION_PIECES)?;
        let planned = |songs: Vec<Song>| -> Result<Vec<Piece>, TaskError> {
            songs.par_iter().map(|song| Piece::for_task(song, task)).collect()
        };
        let Some(folder) = &config.folder else {
            let validation = planned(melodies(Split::Validation, 0).take(wanted).collect())?;
            return Ok(Self { task: task.clone(), files: Vec::new(), validation });
        };
        let FoundSongs { songs, left_out } = FoundSongs::below(folder)?;
        let of = |part| songs.iter().filter(|song| song.split() == part).cloned().collect::<Vec<_>>();
        let (training, mut validation) = (of(Split::Training), of(Split::Validation));
        validation.truncate(wanted);
        if training.is_empty() || validation.is_empty() {
            return Err(TaskError::Value(format!(
                "corpus.folder = {}: of its {} songs that fit the keyboard {} are for training and {} for validation; each part \
                 needs one at least, and one song in twenty is for validation{}",
                folder.display(),
                songs.len(),
                training.len(),
                validation.len(),
                left_out.first().map_or_else(String::new, |first| format!(
                    "; files that are not used: {}, the first: {first}",
                    left_out.len()
                ))
            )));
        }
        Ok(Self { task: task.clone(), files: planned(training)?, validation: planned(validation)? })
    }

    /// A piece of the training's part: the same for the same number.
    pub fn piece(&self, number: u64) -> Piece {
        if let Some(piece) = self.files.get((number % self.files.len().max(1) as u64) as usize) {
            return piece.clone();
        }
        let song = melodies(Split::Training, number).next().expect("there is no end of melodies");
        Piece::for_task(&song, &self.task).expect("a melody fits the keyboard, and the task was checked")
    }

    /// The held-out pieces that an evaluation plays.
    pub fn validation(&self) -> &[Piece] {
        &self.validation
    }

    /// At most as many learned pieces of a folder, from all over it, for the training score beside
    /// the validation score. None where melodies are drawn: no melody is learned twice, so every
    /// one is as new as those of the validation.
    pub fn learned_sample(&self) -> Vec<Piece> {
        let every = self.files.len().div_ceil(self.validation.len());
        self.files.iter().step_by(every.max(1)).cloned().collect()
    }
}

/// What the MIDI files below a folder hold.
#[derive(Default)]
struct FoundSongs {
    /// The songs in the order of their paths, each moved onto the keyboard by the smallest
    /// transposition.
    songs: Vec<Song>,
    /// The files that are not used, and why.
    left_out: Vec<String>,
}

impl FoundSongs {
    fn below(folder: &Path) -> Result<Self, TaskError> {
        let mut found = Self::default();
        for entry in WalkDir::new(folder).follow_links(true).sort_by_file_name() {
            let unreadable =
                |error: walkdir::Error| SongError::Read { path: folder.to_path_buf(), source: error.into() };
            let path = entry.map_err(unreadable)?.into_path();
            if path.is_dir() || !is_named_midi(&path) {
                continue;
            }
            match Song::load(&path).map(|song| song.without_initial_silence()).and_then(on_the_keyboard) {
                Ok(Some(song)) => found.songs.push(song),
                Ok(None) => found.left_out.push(format!("{} is wider than the keyboard", path.display())),
                Err(error @ SongError::Read { .. }) => return Err(error.into()),
                Err(error) => found.left_out.push(error.to_string()),
            }
        }
        Ok(found)
    }
}

/// The song, transposed if that brings it onto the keyboard; none if it is wider.
fn on_the_keyboard(song: Song) -> Result<Option<Song>, SongError> {
    let Err(error) = song.check_range() else { return Ok(Some(song)) };
    let SongError::OutOfRange(out) = &error else { return Err(error) };
    let least = out.transpositions.iter().min_by_key(|semitones| semitones.abs());
    least.map(|semitones| song.transpose(*semitones)).transpose()
}
