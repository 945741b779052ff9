//! Pieces that players who are ready play: songs and test melodies, by what makes them hard.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{Context as _, anyhow};
use etude_lab::{Pianist, find_song, load_pianist, shipped_policy};
use etude_learn::seed::fnv;
use etude_music::{Part, Song, chords, key_is_black, melody};

use crate::config::{Experiment, PlayConfig};
use crate::plan::all_or_first;
use crate::trial::{Trial, Work, id, json};

/// Name of the scripted player.
const SCRIPTED: &str = "scripted";
/// What the name of a melody begins with; its seed follows.
const MELODY: &str = "melody-";
/// Kind of the songs that the experiment names.
const SONGS: &str = "songs";
/// Kinds of melodies, easy and hard: by tempo, leaps, chords and black keys.
const KINDS: [[&str; 2]; 4] = [
    ["slow", "quick"],
    ["few leaps", "many leaps"],
    ["few chords", "many chords"],
    ["few black keys", "many black keys"],
];

/// From so many onsets a second on a melody is quick.
const QUICK_PER_SEC: f64 = 2.0;
/// A step of more semitones from top note to top note is a leap.
const LEAP_SEMITONES: u8 = 5;
/// From this share of leaps among the steps on, of chords among the onsets, and of black keys among the notes, there are many.
const MANY: [f64; 3] = [0.1, 0.1, 0.5];

/// The piece of this name: a built-in id, a MIDI file, or `melody-SEED`.
///
/// # Errors
/// If there is none.
pub(crate) fn piece_called(name: &str) -> anyhow::Result<Song> {
    match name.strip_prefix(MELODY).and_then(|seed| seed.parse().ok()) {
        Some(seed) => Ok(melody(seed)),
        None => Ok(find_song(name)?),
    }
}

/// The player of this name: `scripted`, a policy that comes with Étude, a policy's file, or the folder of a run.
///
/// # Errors
/// If there is none, or it cannot be used.
pub(crate) fn player_called(name: &str) -> anyhow::Result<Pianist> {
    if name == SCRIPTED {
        return Ok(Pianist::scripted());
    }
    load_pianist(&shipped_policy(name).unwrap_or_else(|| PathBuf::from(name)))
}

/// What makes a melody hard or easy: of tempo, leaps, chords and black keys one word each.
pub(crate) fn kinds(song: &Song) -> [&'static str; 4] {
    let chords: Vec<_> = chords(song.notes()).collect();
    let tops: Vec<u8> = chords.iter().filter_map(|chord| chord.iter().map(|note| note.pitch).max()).collect();
    let share = |count: usize, of: usize| count as f64 / of.max(1) as f64;
    let leaps = tops.windows(2).filter(|pair| pair[0].abs_diff(pair[1]) > LEAP_SEMITONES).count();
    let wide = chords.iter().filter(|chord| chord.len() > 1).count();
    let black = song.notes().iter().filter(|note| key_is_black(usize::from(note.pitch % 12))).count();
    let is_hard = [
        chords.len() as f64 / song.duration_secs() >= QUICK_PER_SEC,
        share(leaps, tops.len().saturating_sub(1)) >= MANY[0],
        share(wide, chords.len()) >= MANY[1],
        share(black, song.notes().len()) >= MANY[2],
    ];
    std::array::from_fn(|kind| KINDS[kind][usize::from(is_hard[kind])])
}

impl Experiment {
    /// The trials of players that are ready: each piece by each. A melody is in four kinds, and is played once.
    pub(crate) fn plays(&self, play: &PlayConfig, seed: u64, smoke: bool) -> anyhow::Result<Vec<Trial>> {
        let melodies = if smoke { play.melodies.min(1) } else { play.melodies };
        let mut pieces: Vec<(String, Song, Vec<&str>)> = Vec::new();
        for name in all_or_first(&self.songs, smoke) {
            pieces.push((name.clone(), find_song(name)?, vec![SONGS]));
        }
        let seeds = (0..).filter(|seed| melody(*seed).part() == Part::Test);
        for melody_seed in seeds.take(melodies) {
            let song = melody(melody_seed);
            let kinds = kinds(&song).to_vec();
            pieces.push((format!("{MELODY}{melody_seed}"), song, kinds));
        }
        let (perform, on_twin) = self.performance(None, smoke)?;
        let mut trials = Vec::new();
        for player in &play.players {
            let wrong = |error| anyhow!("experiment {}: player `{player}`: {error:#}", self.name);
            let content = content(&player_called(player).map_err(wrong)?).map_err(wrong)?;
            for (name, song, kinds) in &pieces {
                let work =
                    Work::Play { song: name.clone(), player: player.clone(), perform: perform.clone(), seed };
                let all = format!("{:?}{content}{on_twin}{seed}", song.notes());
                let id = id("play", name, seed, &all);
                for kind in kinds {
                    let labels = [("song", name.as_str()), ("player", player), ("pieces", kind)];
                    let mut labels: BTreeMap<String, String> =
                        labels.map(|(key, value)| (key.to_string(), value.to_string())).into();
                    labels.insert("seed".to_string(), seed.to_string());
                    trials.push(Trial { id: id.clone(), labels, work: work.clone() });
                }
            }
        }
        // Tables and figures have the kinds in this order.
        let order = |trial: &Trial| {
            let kind = trial.labels["pieces"].as_str();
            KINDS.iter().flatten().position(|known| *known == kind)
        };
        trials.sort_by_key(order);
        Ok(trials)
    }
}

/// What a player's result depends on: its task and, of a policy, the bytes of its file.
fn content(pianist: &Pianist) -> anyhow::Result<String> {
    let task = json(&pianist.config.task);
    let Some(file) = pianist.file() else { return Ok(task) };
    let bytes = std::fs::read(file).with_context(|| format!("cannot read {}", file.display()))?;
    Ok(format!("{task}{:016x}", fnv(&bytes)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::PlanConfig;
    use crate::plan::tests::plan;
    use etude_music::Note;

    fn kinds_of(secs: f64, chords: &[&[u8]]) -> [&'static str; 4] {
        let notes = chords.iter().enumerate().flat_map(|(at, chord)| {
            let start_secs = secs * at as f64;
            chord.iter().map(move |pitch| Note {
                pitch: *pitch,
                start_secs,
                end_secs: start_secs + secs,
                velocity: 80,
            })
        });
        kinds(&Song::new("T", notes.collect(), secs * chords.len() as f64).unwrap())
    }

    #[test]
    fn melodies_are_of_the_kinds_that_their_notes_say() {
        let easy = ["slow", "few leaps", "few chords", "few black keys"];
        assert_eq!(kinds_of(0.55, &[&[60], &[62], &[64], &[65]]), easy);
        assert_eq!(kinds_of(0.45, &[&[60], &[62], &[64], &[65]])[0], "quick");
        // A fourth is no leap, a tritone is one, upwards and downwards.
        assert_eq!(kinds_of(0.5, &[&[60], &[65], &[60]])[1], "few leaps");
        assert_eq!(kinds_of(0.5, &[&[60], &[66], &[60]])[1], "many leaps");
        assert_eq!(kinds_of(0.55, &[&[60, 64], &[62], &[64]]), ["slow", "few leaps", "many chords", easy[3]]);
        assert_eq!(kinds_of(0.5, &[&[61], &[63], &[64]])[3], "many black keys");
    }

    const MINE: &str = "title = 'T'\nsource = 'S'\nsongs = ['twinkle']\nseeds = 2\n[play]\nplayers = ['sight-reader', 'scripted']\nmelodies = 3\n";

    #[test]
    fn each_player_plays_each_piece_once_and_a_melody_stands_in_four_kinds() {
        let trials = plan(MINE, &PlanConfig::default());
        assert_eq!(trials.len(), 2 * 2 * (1 + 3 * 4));
        let ids: std::collections::BTreeSet<_> = trials.iter().map(|trial| &trial.id).collect();
        assert_eq!(ids.len(), 2 * 2 * (1 + 3));
        for trial in &trials {
            let Work::Play { song, .. } = &trial.work else { panic!("{trial:?}") };
            let is_song = trial.labels["pieces"] == SONGS;
            assert_eq!(is_song, song == "twinkle");
            assert!(is_song || piece_called(song).unwrap().part() == Part::Test, "{song}");
        }
        let smoke = plan(MINE, &PlanConfig { smoke: true, ..PlanConfig::default() });
        assert_eq!(smoke.len(), 2 * (1 + 4));
    }
}
