//! The observation relative to the hand.

use etude_music::{KeySet, Note, Song};
use etude_stage::geometry::{WHITE_PITCH, key_lateral};
use etude_stage::{DRIVEN_JOINTS, FINGERS, RAIL};
use etude_task::{ACTION_LEN, Environment, History, ObservationView, Piece, TaskConfig, layout, observe};

const SLOTS: usize = 21;
const MIDDLE: usize = 10;

fn config() -> TaskConfig {
    TaskConfig { fingering: true, view: ObservationView::Hand, ..TaskConfig::default() }
}

/// D2, F#2 and, after a leap, A3; all `up` semitones higher.
fn piece(up: u8) -> Piece {
    let note = |pitch: u8, start_secs: f64| Note {
        pitch: pitch + up,
        velocity: 80,
        start_secs,
        end_secs: start_secs + 0.4,
    };
    let song = Song::new("", vec![note(38, 0.0), note(42, 0.5), note(57, 1.5)], 0.0).unwrap();
    Piece::for_task(&song, &config()).unwrap()
}

/// The observation where the rail reads `rail`, and read `before` one step ago; `pressed` is down.
fn shown(piece: &Piece, step: usize, rail: f64, before: f64, pressed: KeySet) -> Vec<f32> {
    let joints = |rail: f64| {
        let mut joints: [f64; DRIVEN_JOINTS] = std::array::from_fn(|joint| 0.02 * joint as f64);
        joints[RAIL] = rail;
        joints
    };
    let history = History { joints: joints(before), actions: [[0.5; ACTION_LEN]; 4] };
    let mut out = vec![9.0; layout(&config()).len()];
    observe(&config(), &joints(rail), &history, pressed, piece, step, &mut out);
    out
}

/// But for the black keys of the window, which end with the keyboard.
#[test]
fn a_passage_looks_the_same_in_every_octave() {
    let (low, high) = (piece(0), piece(12));
    let black = layout(&config()).real + SLOTS * (config().lookahead + 2);
    let octave = 7.0 * WHITE_PITCH;
    for step in 0..low.steps() {
        let place = low.fingering().unwrap().rail_at(step);
        assert!((high.fingering().unwrap().rail_at(step) - place - octave).abs() < 1e-9, "the plans agree");
        let pressed = |up: u8| KeySet::from_pitches([36 + up, 39 + up]);
        let one = shown(&low, step, place + 0.01, place, pressed(0));
        let other = shown(&high, step, place + octave + 0.01, place + octave, pressed(12));
        for (column, (one, other)) in one.iter().zip(&other).enumerate() {
            if (black..black + SLOTS).contains(&column) {
                continue;
            }
            assert!((one - other).abs() < 1e-4, "step {step}, column {column}: {one} and {other}");
        }
    }
}

#[test]
fn the_columns_are_what_they_are_said_to_be() {
    let config = config();
    let piece = piece(12);
    let (tips, places) = (2 * DRIVEN_JOINTS, 2 * DRIVEN_JOINTS + 3 * FINGERS);
    let layout = layout(&config);
    assert_eq!(layout.real, places + config.lookahead + 1);
    assert_eq!(layout.binary, SLOTS * (config.lookahead + 3) + FINGERS * (config.lookahead + 1));

    // F#3, three steps before it; D3 sounds until then.
    let step = 20 + 10 - 3;
    let place = piece.fingering().unwrap().rail_at(step);
    let out = shown(&piece, step, place + WHITE_PITCH, place - 2.0 * WHITE_PITCH, KeySet::from_pitches([50]));
    assert!((out[RAIL] - 1.0).abs() < 1e-5 && (out[DRIVEN_JOINTS + RAIL] + 2.0).abs() < 1e-5);
    assert!((out[0] - shown(&piece, 0, 0.0, 0.0, KeySet::EMPTY)[0]).abs() < 1e-9, "fingers as ever");
    assert!(out[tips..places].iter().any(|value| *value != 0.0));

    // The middle of the window is the slot nearest to the rail's place, and the first column says
    // how far it is.
    let half = WHITE_PITCH / 2.0;
    let middle = (place / half).round();
    assert!((f64::from(out[places]) - (place / WHITE_PITCH - middle / 2.0)).abs() < 1e-5);
    assert!(out[places].abs() <= 0.25);
    let column = |key: usize| (key_lateral(key) / half - middle).round() as i64 + MIDDLE as i64;
    let rows: Vec<&[f32]> =
        out[layout.real..][..SLOTS * (config.lookahead + 3)].chunks_exact(SLOTS).collect();
    let expect = |row: &[f32], keys: &[usize]| {
        let mut expected = [0.0; SLOTS];
        for key in keys {
            expected[usize::try_from(column(*key)).unwrap()] = 1.0;
        }
        assert_eq!(row, expected, "{keys:?}");
    };
    let (d, f_sharp) = (50 - 36, 54 - 36);
    expect(rows[0], &[d]);
    for ahead in 0..=config.lookahead {
        let due: Vec<usize> = piece.due(step + ahead).iter().collect();
        expect(rows[1 + ahead], &due);
    }
    assert!(piece.due(step + 3).contains(f_sharp) && !piece.due(step + 2).contains(f_sharp));
    // The black keys of the window.
    let black: Vec<usize> = (0..49)
        .filter(|key| etude_music::key_is_black(*key) && (0..SLOTS as i64).contains(&column(*key)))
        .collect();
    assert!(black.len() >= 6);
    expect(rows[config.lookahead + 2], &black);

    // Where the place moves within the steps that are shown, the columns after the first say how
    // far.
    let rail = piece.fingering().unwrap().rail();
    let leap = (0..rail.len() - 1).max_by(|a, b| {
        let distance = |step: usize| (rail[step + 1] - rail[step]).abs();
        distance(*a).total_cmp(&distance(*b))
    });
    let leap = leap.unwrap();
    let out = shown(&piece, leap, rail[leap], rail[leap], KeySet::EMPTY);
    let distance = (rail[leap + 1] - rail[leap]) / WHITE_PITCH;
    assert!(distance.abs() > 4.0, "a leap: {distance}");
    assert_eq!(out[places + 1], distance.signum() as f32 * 4.0, "at most four white keys are shown");
}

#[test]
fn the_hand_needs_a_fingering_and_is_named_in_files() {
    let without = TaskConfig { fingering: false, ..config() };
    assert!(without.check().unwrap_err().to_string().contains("task.view"));
    let text = serde_json::to_string(&config()).unwrap();
    assert!(text.contains(r#""view":"hand""#), "{text}");
    assert_eq!(serde_json::from_str::<TaskConfig>(&text).unwrap(), config());
}

/// In a simulation, too: after a jump of its target the rail's set-point is ahead of its place.
#[test]
fn an_environment_shows_the_rails_set_point_if_the_task_says_so() {
    let shown = |rail_set_point: bool| {
        let config = TaskConfig { rail_set_point, ..TaskConfig::default() };
        let song = etude_music::repertoire::get("c-major-scale").expect("built in");
        let piece = Piece::for_task(&song, &config).unwrap();
        let mut environment = Environment::new(&config, &piece, 0).unwrap();
        let mut parts = vec![0.0; environment.reward().names().len()];
        environment.step(&[1.0; ACTION_LEN], &mut parts);
        environment.step(&[1.0; ACTION_LEN], &mut parts);
        let mut out = vec![0.0; layout(&config).len()];
        environment.observe(&mut out);
        let (set, is) = (environment.world().references()[RAIL], environment.world().joints()[RAIL]);
        (out, set / WHITE_PITCH, is / WHITE_PITCH)
    };
    let (measured, set, is) = shown(false);
    let (commanded, ..) = shown(true);
    assert!(set > is + 0.05, "{set} and {is} white keys");
    assert!((f64::from(measured[RAIL]) - is).abs() < 1e-5 && (f64::from(commanded[RAIL]) - set).abs() < 1e-5);
    assert_eq!(measured[..RAIL], commanded[..RAIL]);
    let previous = DRIVEN_JOINTS + RAIL;
    assert!(commanded[previous] > measured[previous], "one step ago it was ahead, too");
}
