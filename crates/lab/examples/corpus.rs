//! Figures of the first melodies of a part, planned as the preset `sight-reader` plans them:
//! `corpus PART COUNT`.
#![allow(clippy::print_stdout, reason = "it prints what it measures")]

use std::collections::BTreeSet;
use std::time::Instant;

use anyhow::{Context as _, bail};
use etude_lab::{SIGHT_READER, resolve};
use etude_music::{Split, key_is_black, melodies};
use etude_task::Piece;

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [part, count] = arguments.as_slice() else { bail!("corpus PART COUNT") };
    let part = Split::ALL
        .into_iter()
        .find(|known| known.to_string() == *part)
        .context("the parts are training, validation, test")?;
    let task = resolve(SIGHT_READER, None, &[])?.task;
    let count = count.parse()?;
    let songs: Vec<_> = melodies(part, 0).take(count).collect();
    let begun = Instant::now();
    let pieces = songs.iter().map(|song| Piece::for_task(song, &task)).collect::<Result<Vec<_>, _>>()?;
    let planning = begun.elapsed().as_secs_f64();

    let notes = || songs.iter().flat_map(|song| song.notes());
    let total = notes().count() as f64;
    let secs: f64 = songs.iter().map(|song| song.duration_secs()).sum();
    println!(
        "{count} melodies, {total} notes, {secs:.0} s; a melody {:.1} notes, {:.1} s",
        total / count as f64,
        secs / count as f64
    );
    println!("planning: {:.1} ms a melody", planning * 1e3 / count as f64);
    let pitches: BTreeSet<u8> = notes().map(|note| note.pitch).collect();
    println!("pitches: {} from {:?} to {:?}", pitches.len(), pitches.first(), pitches.last());
    let black = notes().filter(|note| key_is_black(usize::from(note.pitch - 36))).count() as f64;
    println!("black keys: {:.3} of the notes", black / total);
    let velocities: Vec<u8> = notes().map(|note| note.velocity).collect();
    println!("velocities: {:?} to {:?}", velocities.iter().min(), velocities.iter().max());

    let mut sizes = [0usize; 4];
    let (mut waits, mut widths, mut repeats) = (Vec::new(), Vec::new(), 0);
    for song in &songs {
        let chords: Vec<_> =
            song.notes().chunk_by(|one, next| next.start_secs - one.start_secs < 0.005).collect();
        for chord in &chords {
            sizes[chord.len().min(3)] += 1;
        }
        for pair in chords.windows(2) {
            let [from, to] = [pair[0], pair[1]].map(|chord| chord[chord.len() - 1]);
            waits.push(to.start_secs - from.start_secs);
            widths.push(to.pitch.abs_diff(from.pitch));
            repeats += usize::from(to.pitch == from.pitch);
        }
    }
    waits.sort_by(f64::total_cmp);
    widths.sort_unstable();
    let onsets = sizes.iter().sum::<usize>() as f64;
    println!(
        "onsets with one, two, three notes: {:.3} {:.3} {:.3}",
        sizes[1] as f64 / onsets,
        sizes[2] as f64 / onsets,
        sizes[3] as f64 / onsets
    );
    let at = |share: f64| (waits.len() as f64 * share) as usize;
    println!(
        "from onset to onset, s: 5 % {:.2}, half {:.2}, 95 % {:.2}",
        waits[at(0.05)],
        waits[at(0.5)],
        waits[at(0.95)]
    );
    println!(
        "semitones from top note to top note: half {}, 95 % {}; repeated {:.3}",
        widths[at(0.5)],
        widths[at(0.95)],
        repeats as f64 / waits.len() as f64
    );

    let limits: Vec<_> =
        pieces.iter().filter_map(Piece::fingering).map(|fingering| fingering.unplayed()).collect();
    let skipped: usize = limits.iter().map(|limits| limits.omitted().count()).sum();
    let early: usize = limits.iter().map(|limits| limits.notes.len()).sum::<usize>() - skipped;
    let lost: usize = limits.iter().map(|limits| limits.lost_steps()).sum();
    let due: usize = pieces.iter().flat_map(|piece| piece.frames()).map(|keys| keys.len()).sum();
    println!(
        "the fingering skips {:.4} of the notes, ends {:.3} early, and loses {:.3} of the key steps",
        skipped as f64 / total,
        early as f64 / total,
        lost as f64 / due as f64
    );
    let whole = limits.iter().filter(|limits| limits.omitted().count() == 0).count();
    println!("melodies without a skipped note: {:.3}", whole as f64 / count as f64);
    Ok(())
}
