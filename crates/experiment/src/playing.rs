//! Trials of players: songs, validation melodies, and test melodies by what makes them hard.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context as _, anyhow};
use etude_lab::{LoadedPlayer, RunConfig, find_song, load_player, policy_called};
use etude_learn::seed::fnv;
use etude_music::{Song, Split, chords, key_is_black, melody};

use crate::config::{Experiment, LearnerConfig, PlayConfig, Variant};
use crate::trial::{TrainingConfig, Trial, TrialWork, fingerprint, id, json};
use crate::trial_plan::{ExperimentConfig, all_or_first, notes_of};

/// Name of the scripted baseline.
const SCRIPTED: &str = "scripted";
/// What the name of a melody begins with; its seed follows.
const MELODY: &str = "melody-";
/// Kind of the songs that the experiment names.
const SONGS: &str = "songs";
/// Kind of the melodies by which the best policy of a sight-reader's training is chosen.
const VALIDATION: &str = "validation";
/// Stands for the seed in the name of a player.
const SEED: &str = "{seed}";
/// Kinds of melodies, easy and hard: by tempo, leaps, chords and black keys.
const KINDS: [[&str; 2]; 4] = [
    ["slow", "quick"],
    ["few leaps", "many leaps"],
    ["few chords", "many chords"],
    ["few black keys", "many black keys"],
];

/// A melody of this many onsets a second or more is quick.
const QUICK_PER_SEC: f64 = 2.0;
/// A step of more semitones from top note to top note is a leap.
const LEAP_SEMITONES: u8 = 5;
/// There are many from this share on: leaps among the steps, chords among the onsets, black keys
/// among the notes.
const MANY: [f64; 3] = [0.1, 0.1, 0.5];

/// The piece of this name: a built-in id, a MIDI file, or `melody-SEED`.
///
/// # Errors
/// If there is none.
pub(crate) fn find_piece(name: &str) -> anyhow::Result<Song> {
    match name.strip_prefix(MELODY).and_then(|seed| seed.parse().ok()) {
        Some(seed) => Ok(melody(seed)),
        None => Ok(find_song(name, false)?),
    }
}

/// The player of this name: `scripted`, a policy that comes with Étude, a policy's file, or the
/// folder of a run.
///
/// # Errors
/// If there is none, or it cannot be used.
pub(crate) fn find_player(name: &str) -> anyhow::Result<LoadedPlayer> {
    if name == SCRIPTED {
        return Ok(LoadedPlayer::scripted());
    }
    load_player(&policy_called(Path::new(name))?)
}

/// A piece to play.
struct NamedPiece {
    name: String,
    song: Song,
    kinds: Vec<&'static str>,
}

/// The first `count` melodies of a split.
fn melodies(split: Split, count: usize) -> impl Iterator<Item = (String, Song)> {
    let all = (0..).map(|seed| (format!("{MELODY}{seed}"), melody(seed)));
    all.filter(move |(_, song)| song.split() == split).take(count)
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
    /// The trials of players: each piece by each. A test melody is in four kinds, and is played
    /// once.
    pub(crate) fn plays(
        &self,
        play: &PlayConfig,
        seed: u64,
        config: &ExperimentConfig,
    ) -> anyhow::Result<Vec<Trial>> {
        let pieces = self.pieces(play, config.smoke)?;
        let (perform, on_twin) = self.performance(&Variant::default(), config.smoke)?;
        let wrong = |name: &str, error| anyhow!("experiment {}: player `{name}`: {error:#}", self.name);
        let mut trials = Vec::new();
        let mut add = |player: &str, piece: &NamedPiece, id: &str, work: &TrialWork| {
            for kind in &piece.kinds {
                let labels = [("song", piece.name.as_str()), ("player", player), ("pieces", kind)];
                let mut labels: BTreeMap<String, String> =
                    labels.map(|(key, value)| (key.to_string(), value.to_string())).into();
                labels.insert("seed".to_string(), seed.to_string());
                trials.push(Trial { id: id.to_string(), labels, work: work.clone() });
            }
        };
        for name in &play.players {
            let player = name.replace(SEED, &seed.to_string());
            let content = find_player(&player)
                .and_then(|player| content(&player))
                .map_err(|error| wrong(name, error))?;
            for piece in &pieces {
                let all = format!("{}{content}{on_twin}{seed}", notes_of(&piece.song));
                let work = TrialWork::Play {
                    song: piece.name.clone(),
                    player: player.clone(),
                    perform: perform.clone(),
                    seed,
                };
                add(name, piece, &id("play", &piece.name, seed, &all), &work);
            }
        }
        for learner in &play.learners {
            let (training, resolved, source) =
                learner.training(seed, config).map_err(|error| wrong(&learner.name, error))?;
            for piece in &pieces {
                let all = fingerprint(&notes_of(&piece.song), &resolved) + &source + &on_twin;
                let training = TrainingConfig { song: Some(piece.name.clone()), ..training.clone() };
                let work = TrialWork::Train { training, perform: perform.clone(), rehearse: None };
                add(&learner.name, piece, &id("train", &piece.name, seed, &all), &work);
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

    fn pieces(&self, play: &PlayConfig, smoke: bool) -> anyhow::Result<Vec<NamedPiece>> {
        let mut pieces = Vec::new();
        for name in all_or_first(&self.songs, smoke) {
            pieces.push(NamedPiece { name: name.clone(), song: find_song(name, false)?, kinds: vec![SONGS] });
        }
        let count = |count: usize| if smoke { count.min(1) } else { count };
        for (name, song) in melodies(Split::Validation, count(play.validation_melodies)) {
            pieces.push(NamedPiece { name, song, kinds: vec![VALIDATION] });
        }
        for (name, song) in melodies(Split::Test, count(play.melodies)) {
            let kinds = kinds(&song).to_vec();
            pieces.push(NamedPiece { name, song, kinds });
        }
        Ok(pieces)
    }
}

impl LearnerConfig {
    /// Its training, of no piece yet; the configuration; and a checksum of what it begins with.
    fn training(
        &self,
        seed: u64,
        config: &ExperimentConfig,
    ) -> anyhow::Result<(TrainingConfig, RunConfig, String)> {
        let set = config.complete(self.set.clone(), seed);
        let from = self.from.as_ref().map(|from| from.replace(SEED, &seed.to_string()));
        let training = TrainingConfig { song: None, preset: self.preset.clone(), set, from };
        // A piece is learned, whatever the preset's corpus.
        let resolved = RunConfig { corpus: None, ..training.resolve()? };
        let source = training.source()?.map_or_else(|| Ok(String::new()), |file| checksum_of(&file))?;
        Ok((training, resolved, source))
    }
}

/// What a player's result depends on: its task and, of a policy, the bytes of its file.
fn content(player: &LoadedPlayer) -> anyhow::Result<String> {
    let task = json(&player.config.task);
    Ok(task + &player.file().map_or_else(|| Ok(String::new()), checksum_of)?)
}

fn checksum_of(file: &Path) -> anyhow::Result<String> {
    let bytes = std::fs::read(file).with_context(|| format!("cannot read {}", file.display()))?;
    Ok(format!("{:016x}", fnv(&bytes)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trial_plan::ExperimentConfig;
    use crate::trial_plan::tests::plan;
    use etude_lab::shipped_policy;
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
        let trials = plan(MINE, &ExperimentConfig::default());
        assert_eq!(trials.len(), 2 * 2 * (1 + 3 * 4));
        let ids: std::collections::BTreeSet<_> = trials.iter().map(|trial| &trial.id).collect();
        assert_eq!(ids.len(), 2 * 2 * (1 + 3));
        for trial in &trials {
            let TrialWork::Play { song, .. } = &trial.work else { panic!("{trial:?}") };
            let is_song = trial.labels["pieces"] == SONGS;
            assert_eq!(is_song, song == "twinkle");
            assert!(is_song || find_piece(song).unwrap().split() == Split::Test, "{song}");
        }
        let smoke = plan(MINE, &ExperimentConfig { smoke: true, ..ExperimentConfig::default() });
        assert_eq!(smoke.len(), 2 * (1 + 4));
    }

    #[test]
    fn learners_learn_each_piece_from_what_they_begin_with() {
        let learners = "validation_melodies = 2\n[[play.learners]]\nname = 'tuned'\nfrom = 'sight-reader'\nset = ['trainer.total_steps=2000']\n\
                        [[play.learners]]\nname = 'its own'\n";
        let trials = plan(&format!("{MINE}{learners}"), &ExperimentConfig::default());
        assert_eq!(trials.len(), 2 * 4 * (1 + 2 + 3 * 4));
        let of = |player: &str| -> Vec<&Trial> {
            trials.iter().filter(|trial| trial.labels["player"] == player).collect()
        };
        for (tuned, own) in of("tuned").into_iter().zip(of("its own")) {
            let (TrialWork::Train { training, .. }, TrialWork::Train { training: alone, .. }) =
                (&tuned.work, &own.work)
            else {
                panic!("{tuned:?} {own:?}")
            };
            let (config, alone) = (training.resolve().unwrap(), alone.resolve().unwrap());
            assert_eq!(training.song.as_ref(), tuned.labels.get("song"));
            assert_eq!(config.trainer.seed.to_string(), tuned.labels["seed"]);
            assert_eq!(config.trainer.total_steps, 2000);
            assert_eq!(
                config.task.view,
                etude_task::ObservationView::Hand,
                "the observation is that of the sight-reader"
            );
            assert_ne!(alone.task.view, config.task.view);
            let split = find_piece(&tuned.labels["song"]).unwrap().split();
            match tuned.labels["pieces"].as_str() {
                VALIDATION => assert_eq!(split, Split::Validation),
                SONGS => {}
                _ => assert_eq!(split, Split::Test),
            }
        }
        // What it begins with is part of the work, and one policy a seed may be.
        let folder = tempfile::tempdir().unwrap();
        let ids = |sources: [&str; 2]| {
            for (seed, source) in sources.iter().enumerate() {
                std::fs::copy(
                    shipped_policy(source).unwrap(),
                    folder.path().join(format!("{seed}.safetensors")),
                )
                .unwrap();
            }
            let from = folder.path().join("{seed}.safetensors").display().to_string();
            let text = format!("{MINE}{}", learners.replace("sight-reader", &from));
            let trials = plan(&text, &ExperimentConfig::default());
            let tuned = trials
                .iter()
                .filter(|trial| trial.labels["player"] == "tuned" && trial.labels["song"] == "twinkle");
            tuned.map(|trial| trial.id.clone()).collect::<Vec<_>>()
        };
        let same = ids(["sight-reader", "sight-reader"]);
        assert!(of("tuned").iter().any(|trial| trial.id == same[0]), "the bytes count, not the path");
        let other = ids(["sight-reader", "twinkle"]);
        assert!(same[0] == other[0] && same[1] != other[1]);
        let smoke = plan(
            &format!("{MINE}{learners}"),
            &ExperimentConfig { smoke: true, ..ExperimentConfig::default() },
        );
        let TrialWork::Train { training, .. } = &smoke[smoke.len() - 1].work else { panic!("{smoke:?}") };
        assert_eq!(training.resolve().unwrap().trainer.total_steps, 480);
    }

    #[test]
    fn a_player_can_have_a_policy_for_each_seed() {
        let folder = tempfile::tempdir().unwrap();
        for (seed, song) in ["twinkle", "sight-reader"].iter().enumerate() {
            std::fs::copy(shipped_policy(song).unwrap(), folder.path().join(format!("{seed}.safetensors")))
                .unwrap();
        }
        let name = folder.path().join("{seed}.safetensors").display().to_string();
        let trials = plan(&MINE.replace("'scripted'", &format!("'{name}'")), &ExperimentConfig::default());
        for trial in trials.iter().filter(|trial| trial.labels["player"] == name) {
            let TrialWork::Play { player, .. } = &trial.work else { panic!("{trial:?}") };
            assert_eq!(*player, name.replace(SEED, &trial.labels["seed"]));
        }
        assert_eq!(trials.iter().filter(|trial| trial.labels["player"] == name).count(), 2 * (1 + 3 * 4));
    }
}
