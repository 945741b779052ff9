//! Writes the songs that come as files into `songs/`: `cargo run -p etude-music --example write_songs`.
//!
//! They are examples of songs that are not in the repertoire and are found by their path.

use std::path::Path;

use etude_music::{SongError, notation};

/// French, 18th century, public domain; first as a tune for beginners everywhere.
const AU_CLAIR_DE_LA_LUNE: &str = "
    C4 C4 C4 D4 | E4:2 D4:2 | C4 E4 D4 D4 | C4:4 |
    C4 C4 C4 D4 | E4:2 D4:2 | C4 E4 D4 D4 | C4:4 |
    D4 D4 D4 D4 | A3:2 A3:2 | D4 C4 B3 A3 | G3:4 |
    C4 C4 C4 D4 | E4:2 D4:2 | C4 E4 D4 D4 | C4:4 |";

fn main() -> Result<(), SongError> {
    let songs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../songs");
    let song = notation::read("Au clair de la lune", AU_CLAIR_DE_LA_LUNE, 0.625, 4)?;
    song.save(songs.join("au-clair-de-la-lune.mid"))
}
