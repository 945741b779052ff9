//! Environments that play another piece in every episode.

use std::collections::BTreeSet;
use std::sync::Arc;

use etude_learn::{StepBatch, VectorEnvironment as _};
use etude_music::{KeySet, Split, melodies, melody};
use etude_task::{Corpus, CorpusConfig, Environment, PianoVectorEnv, Piece, TargetRange, TaskConfig};

use crate::bench::{Actions, batch, play};

const ENVS: usize = 2;

fn task() -> TaskConfig {
    TaskConfig { fingering: true, initial_silence_secs: 0.1, ..TaskConfig::default() }
}

/// A folder with the melodies of these seeds, each cut after its first second.
fn folder(seeds: impl IntoIterator<Item = u64>) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for seed in seeds {
        short(seed).save(folder.path().join(format!("{seed:03}.mid"))).unwrap();
    }
    folder
}

fn short(seed: u64) -> etude_music::Song {
    let song = melody(seed);
    let notes = song.notes().iter().filter(|note| note.end_secs < 2.5).copied().collect();
    etude_music::Song::new(song.title(), notes, 0.0).unwrap()
}

fn of_folder(folder: &tempfile::TempDir) -> Arc<Corpus> {
    let config = CorpusConfig { folder: Some(folder.path().to_path_buf()), validation_pieces: 3 };
    Arc::new(Corpus::new(&config, &task()).unwrap())
}

fn due(piece: &Piece) -> Vec<KeySet> {
    piece.frames().to_vec()
}

#[test]
fn what_is_trained_is_never_what_is_held_out() {
    let config = CorpusConfig { validation_pieces: 4, ..CorpusConfig::default() };
    let corpus = Corpus::new(&config, &task()).unwrap();
    assert!(corpus.learned_sample().is_empty(), "no melody is learned twice");
    let of = |part, count| -> BTreeSet<Vec<KeySet>> {
        let songs = melodies(part, 0).take(count);
        songs.map(|song| due(&Piece::for_task(&song, &task()).unwrap())).collect()
    };
    let (validation, test) = (of(Split::Validation, 4), of(Split::Test, 4));
    assert_eq!(corpus.validation().iter().map(due).collect::<BTreeSet<_>>(), validation);
    // Around the seeds of the held-out melodies, and far away from them.
    let held_out = (0..200).filter(|seed| melody(*seed).split() != Split::Training).take(4);
    for number in held_out.chain([1, 2, 1 << 31]) {
        let piece = corpus.piece(number);
        let seed: u64 = piece.title().trim_start_matches("Melody ").parse().unwrap();
        assert!(seed >= number && melody(seed).split() == Split::Training, "{number}: {}", piece.title());
        assert!(!validation.contains(&due(&piece)) && !test.contains(&due(&piece)));
        assert_eq!(due(&piece), due(&corpus.piece(number)), "the same number, the same piece");
    }
}

#[test]
fn a_folder_is_split_by_its_notes_and_what_does_not_fit_is_moved_or_left_out() {
    let of = |part| (0..).filter(move |seed| short(*seed).split() == part);
    let seeds: Vec<u64> = of(Split::Training).take(3).chain(of(Split::Validation).take(1)).collect();
    let folder = folder(seeds.iter().copied().chain(of(Split::Test).take(1)));
    // Beyond the keyboard, in a folder of its own, and wider than the keyboard.
    std::fs::create_dir(folder.path().join("more")).unwrap();
    let high = short(seeds[3]);
    let highest = high.notes().iter().map(|note| note.pitch).max().unwrap();
    let high = high.transpose(90 - i32::from(highest)).unwrap();
    assert!(high.check_range().is_err());
    high.save(folder.path().join("more/high.MID")).unwrap();
    let note = |pitch, start_secs: f64| etude_music::Note {
        pitch,
        velocity: 60,
        start_secs,
        end_secs: start_secs + 0.3,
    };
    let wide = etude_music::Song::new("", vec![note(30, 0.0), note(90, 1.0)], 0.0).unwrap();
    wide.save(folder.path().join("wide.mid")).unwrap();
    std::fs::write(folder.path().join("readme.txt"), "no song").unwrap();
    // One damaged file does not keep the others from being learned.
    std::fs::write(folder.path().join("more/damaged.mid"), "no MIDI").unwrap();
    let config = CorpusConfig { folder: Some(folder.path().to_path_buf()), validation_pieces: 3 };
    let left_out = config.left_out().unwrap();
    assert_eq!(left_out.len(), 2, "{left_out:?}");
    assert!(left_out[0].contains("damaged.mid") && left_out[1].contains("wide.mid is wider"), "{left_out:?}");

    let corpus = of_folder(&folder);
    assert_eq!(corpus.validation().len(), 2, "the transposed song is in the part of the original");
    let learned: BTreeSet<String> = (0..20).map(|number| corpus.piece(number).title().to_string()).collect();
    let expected: BTreeSet<String> = seeds[..3].iter().map(|seed| format!("{seed:03}")).collect();
    assert_eq!(learned, expected);
    // Two pieces are for validation, so two of the three learned ones, from all over the folder,
    // are scored beside them.
    let sample = corpus.learned_sample();
    let titles: Vec<&str> = sample.iter().map(Piece::title).collect();
    assert_eq!(titles, [0, 2].map(|number| format!("{:03}", seeds[number])));

    let refused = |config: CorpusConfig| Corpus::new(&config, &task()).unwrap_err().to_string();
    let empty = tempfile::tempdir().unwrap();
    let said = refused(CorpusConfig { folder: Some(empty.path().to_path_buf()), ..CorpusConfig::default() });
    assert!(said.contains("corpus.folder") && said.contains("0 are for training"), "{said}");
    std::fs::write(empty.path().join("damaged.mid"), "no MIDI").unwrap();
    let said = refused(CorpusConfig { folder: Some(empty.path().to_path_buf()), ..CorpusConfig::default() });
    assert!(said.contains("files that are not used: 1, the first") && said.contains("damaged.mid"), "{said}");
    let said = refused(CorpusConfig { folder: Some(empty.path().join("none")), ..CorpusConfig::default() });
    assert!(said.contains("none"), "{said}");
    let said = refused(CorpusConfig { validation_pieces: 0, ..CorpusConfig::default() });
    assert!(said.contains("corpus.validation_pieces"), "{said}");
}

#[test]
fn every_episode_plays_another_piece_from_its_beginning() {
    let corpus = Arc::new(
        Corpus::new(&CorpusConfig { validation_pieces: 1, ..CorpusConfig::default() }, &task()).unwrap(),
    );
    let mut environment = Environment::of_corpus(&task(), &corpus, 3).unwrap();
    let mut seen = BTreeSet::new();
    for _ in 0..6 {
        assert_eq!(environment.next_step(), 0);
        seen.insert(environment.piece().title().to_string());
        environment.reset();
    }
    assert_eq!(seen.len(), 6, "{seen:?}");
    // The rail's range follows the piece.
    let piece = environment.piece().clone();
    let step = piece.steps() - 1;
    let place = piece.fingering().unwrap().rail_at(step);
    let [low, high] = TargetRange::new(&piece).ends(etude_stage::RAIL, step);
    assert!(((low + high) / 2.0 - place).abs() < 1e-9);
}

#[test]
fn a_saved_state_has_the_piece_in_play_and_threads_change_nothing() {
    let seeds: Vec<u64> = (0..60).collect();
    let folder = folder(seeds);
    let corpus = of_folder(&folder);
    let make = |seed| PianoVectorEnv::of_corpus(&task(), &corpus, ENVS, seed).unwrap();
    let longest = (0..60).map(|number| corpus.piece(number).steps()).max().unwrap();
    let on_threads = |threads: usize| -> (Vec<StepBatch>, Vec<u8>) {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut piano = make(5);
            let batches = play(&mut piano, &mut Actions::new(ENVS, 1), 2 * longest);
            (batches, piano.save_state())
        })
    };
    let one = on_threads(1);
    assert!(one.0.iter().filter(|batch| batch.truncated[0]).count() >= 2, "episodes end within the test");
    assert!(on_threads(2) == one);

    for stop in [3, longest + 1] {
        let mut stayed = make(5);
        let mut actions = Actions::new(ENVS, 2);
        play(&mut stayed, &mut actions, stop);
        let saved = stayed.save_state();
        let mut resumed = make(6);
        play(&mut resumed, &mut Actions::new(ENVS, 9), 7);
        resumed.load_state(&saved).unwrap();
        assert_eq!(resumed.save_state(), saved);
        let (mut a, mut b) = (batch(&stayed), batch(&stayed));
        for step in 0..longest {
            let actions = actions.next().to_vec();
            stayed.step(&actions, &mut a);
            resumed.step(&actions, &mut b);
            assert!(a == b, "stopped at {stop}, differs {step} steps later");
        }
        let mut of_one = PianoVectorEnv::new(&task(), &corpus.piece(0), ENVS, 5).unwrap();
        let refused = of_one.load_state(&saved).unwrap_err().to_string();
        assert!(refused.contains("corpus"), "{refused}");
    }
}
