//! Writes the songs that come as files into `songs/`: `cargo run -p etude-music --example
//! write_songs`.
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

/// Haydn, symphony 94, the theme of the second movement: soft, softer, and the surprise. The
/// crescendos are ours.
const SURPRISE: &str = "
    p C4 C4 E4 E4 | G4 G4 E4:2 | mp F4 F4 mf D4 D4 | f B3 B3 mf G3:2 |
    p C4 C4 E4 E4 | mp G4 G4 E4:2 | mf C4 C4 f F#4> F#4 | G4:4 |
    pp C4 C4 E4 E4 | G4 G4 E4:2 | F4 F4 D4 D4 | B3 B3 G3:2 |
    C4 C4 E4 E4 | G4 G4 E4:2 | C4 C4 F#4 F#4 | G4:2 ff G4+B4+D5>:2";

fn main() -> Result<(), SongError> {
    let songs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../songs");
    let song = notation::read("Au clair de la lune", AU_CLAIR_DE_LA_LUNE, 0.625, 4)?;
    song.save(songs.join("au-clair-de-la-lune.mid"))?;
    let song = notation::read("Surprise Symphony", SURPRISE, 0.5, 4)?;
    song.save(songs.join("surprise-symphony.mid"))
}
