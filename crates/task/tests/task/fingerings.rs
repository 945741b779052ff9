//! A planned fingering where a policy meets it: its goals, the columns of the observation, the
//! rail's range and the reward.

use etude_music::{KeySet, Note, Song, repertoire};
use etude_stage::geometry::{KeyShape, WHITE_PITCH, key_lateral};
use etude_stage::hand::{JOINTS_PER_FINGER, TIP_RADIUS};
use etude_stage::{DRIVEN_JOINTS, FINGERS, RAIL, kinematics};
use etude_task::fingering::AHEAD_STEPS;
use etude_task::{
    ACTION_LEN, Environment, Fingering, History, Piece, TargetRange, TaskConfig, layout, observe,
};

fn with_fingering() -> TaskConfig {
    TaskConfig { fingering: true, ..TaskConfig::default() }
}

/// Middle C for half a second, then after half a second the C above it, both at the end of a second
/// of silence.
fn two_notes() -> (Song, Piece) {
    let note = |pitch, start_secs| Note { pitch, velocity: 64, start_secs, end_secs: start_secs + 0.5 };
    let song = Song::new("two notes", vec![note(60, 0.0), note(72, 1.0)], 2.0).unwrap();
    let piece = Piece::for_task(&song, &with_fingering()).unwrap();
    (song, piece)
}

const FIRST: (usize, usize) = (24, 20);
const SECOND: (usize, usize) = (36, 40);

#[test]
fn a_finger_has_its_key_as_goal_from_half_a_second_before_until_the_note_ends() {
    let (_, piece) = two_notes();
    let fingering = piece.fingering().unwrap();
    for ((key, start), played) in [FIRST, SECOND].into_iter().zip(fingering.notes()) {
        assert_eq!((played.key, played.start, played.end), (key, start, start + 10));
        for step in 0..piece.steps() + 5 {
            let goal = piece.goals(step)[played.finger].filter(|goal| goal.key == key);
            let expected =
                (start - AHEAD_STEPS..start + 10).contains(&step).then(|| start.saturating_sub(step));
            assert_eq!(goal.map(|goal| goal.wait_steps), expected, "key {key}, step {step}");
            assert_eq!(goal.is_some_and(|goal| goal.begins()), step == start, "key {key}, step {step}");
            if let Some(goal) = goal {
                assert!((goal.over[1] - key_lateral(key)).abs() < 1e-9, "{goal:?}");
            }
        }
    }
    let goals = (0..piece.steps()).map(|step| piece.goals(step).iter().flatten().count());
    assert_eq!(goals.sum::<usize>(), 2 * (AHEAD_STEPS + 10), "one goal a note and no other");
}

#[test]
fn the_rail_waits_where_the_finger_that_plays_is_over_its_key() {
    let (_, piece) = two_notes();
    let fingering = piece.fingering().unwrap();
    let range = TargetRange::new(&piece);
    for (played, (key, start)) in fingering.notes().iter().zip([FIRST, SECOND]) {
        let place = fingering.rail_at(start);
        let straight = etude_stage::hand::root_lateral(TaskConfig::default().stage.side, played.finger);
        assert!((place + straight - key_lateral(key)).abs() < WHITE_PITCH, "{place} for key {key}");
        let [low, high] = range.ends(RAIL, start);
        assert!((low - (place - 0.04)).abs() < 1e-12 && (high - (place + 0.04)).abs() < 1e-12);
        assert!((range.targets(&[0.0; ACTION_LEN], start)[RAIL] - place).abs() < 1e-9);
        let mut targets = range.targets(&[0.25; ACTION_LEN], start);
        assert!((targets[RAIL] - (place + 0.01)).abs() < 1e-9);
        assert!((range.action(&targets, start)[RAIL] - 0.25).abs() < 1e-6);
        targets[RAIL] = place - 1.0;
        assert_eq!(range.action(&targets, start)[RAIL], -1.0);
    }
    assert_ne!(range.ends(RAIL, FIRST.1), range.ends(RAIL, SECOND.1));
    // The fingers' ranges are those of their joints, at any time, unless the task asks for others.
    assert_eq!(range.ends(0, 0), range.ends(0, SECOND.1));
    // After the end, the hand stays.
    assert_eq!(range.ends(RAIL, piece.steps() + 100), range.ends(RAIL, piece.steps() - 1));
}

#[test]
fn the_observation_shows_the_way_to_each_goal_and_who_plays_when() {
    let config = TaskConfig { previous_actions: 1, ..with_fingering() };
    let (_, piece) = two_notes();
    let (real, ways) = (2 * DRIVEN_JOINTS + ACTION_LEN, 3 * FINGERS);
    let (keys, playing) = (49 * (config.lookahead + 2), FINGERS * (config.lookahead + 1));
    assert_eq!((layout(&config).real, layout(&config).binary), (real + ways, keys + playing));

    let finger = piece.fingering().unwrap().notes()[0].finger;
    let history = History { joints: [0.0; DRIVEN_JOINTS], actions: [[0.5; ACTION_LEN]; 4] };
    let shown = |joints: &[f64; DRIVEN_JOINTS], step: usize| {
        let mut out = vec![9.0; layout(&config).len()];
        observe(&config, joints, &history, KeySet::EMPTY, &piece, step, &mut out);
        let way: [f32; 3] = out[real + 3 * finger..].first_chunk().copied().unwrap();
        (way, out)
    };
    // Three steps before the note, in a pose like any other.
    let step = FIRST.1 - 3;
    let mut joints: [f64; DRIVEN_JOINTS] = std::array::from_fn(|joint| 0.02 * joint as f64);
    joints[RAIL] = 0.01;
    let goal = piece.goals(step)[finger].unwrap();
    let angles = joints[finger * JOINTS_PER_FINGER..].first_chunk().unwrap();
    let tip = kinematics::fingertip(config.stage.side, finger, angles, joints[RAIL]);
    let (way, out) = shown(&joints, step);
    let expected = [(tip[0] - goal.over[0]) / WHITE_PITCH, (tip[1] - goal.over[1]) / WHITE_PITCH, 0.3];
    for (shown, expected) in way.iter().zip(expected) {
        assert!((f64::from(*shown) - expected.clamp(-4.0, 4.0)).abs() < 1e-5, "{way:?}, not {expected:?}");
    }
    assert!(way[1].abs() < 3.9, "far enough from the limit that a move shows: {way:?}");
    // The hand one white key further along the keyboard.
    joints[RAIL] += WHITE_PITCH;
    let (moved, _) = shown(&joints, step);
    assert!((moved[1] - way[1] - 1.0).abs() < 1e-5 && moved[0] == way[0], "{way:?} {moved:?}");
    // Who plays: from the third of the shown steps on, and nobody else.
    let plays = &out[real + ways + keys..];
    assert_eq!(plays.len(), playing);
    for (slot, column) in plays.iter().enumerate() {
        let expected = slot % FINGERS == finger && slot / FINGERS >= 3;
        assert_eq!(*column, f32::from(u8::from(expected)), "column {slot}");
    }
    // Without a goal.
    assert_eq!(shown(&joints, 0).0, [0.0, 0.0, 1.0]);
}

#[test]
fn a_piece_and_a_task_agree_about_the_fingering() {
    let (song, fingered) = two_notes();
    let plain = Piece::new(&song, 1.0).unwrap();
    assert!(Environment::new(&with_fingering(), &fingered, 0).is_ok());
    for (config, piece) in [(TaskConfig::default(), &fingered), (with_fingering(), &plain)] {
        let refused = Environment::new(&config, piece, 0).err().unwrap().to_string();
        assert!(refused.contains("Piece::for_task"), "{refused}");
    }
    for term in ["fingering", "holding"] {
        let mut config = TaskConfig::default();
        config.reward.insert(term.to_string(), 0.5);
        let refused = config.check().unwrap_err().to_string();
        assert!(refused.contains(term) && refused.contains("task.fingering = true"), "{refused}");
        config.fingering = true;
        config.check().unwrap();
    }
}

#[test]
fn every_song_has_a_plan_with_a_finger_for_every_note_that_three_fingers_can_play() {
    for known in etude_music::repertoire::SONGS {
        let piece = Piece::for_task(&known.song(), &with_fingering()).unwrap();
        let fingering: &Fingering = piece.fingering().unwrap();
        assert_eq!(fingering.rail().len(), piece.steps());
        assert_eq!(fingering.notes().len(), known.song().notes().len(), "{}", known.id);
        for played in fingering.notes() {
            let goal = piece.goals(played.start)[played.finger].unwrap();
            assert_eq!((goal.key, goal.wait_steps), (played.key, 0), "{}: {played:?}", known.id);
            assert!(piece.due(played.start).contains(played.key));
        }
    }
}

#[test]
fn a_melody_is_not_left_out_for_one_long_note_below_it() {
    let note = |pitch, start_secs, end_secs| Note { pitch, velocity: 64, start_secs, end_secs };
    // Twelve notes over one that lasts as long as all of them, two octaves below.
    let melody = [72, 74, 76, 77, 79, 77, 76, 74, 72, 74, 76, 72];
    let above = melody.into_iter().enumerate();
    let above = above.map(|(beat, pitch)| note(pitch, 0.5 * beat as f64, 0.5 * beat as f64 + 0.45));
    let notes: Vec<Note> = std::iter::once(note(48, 0.0, 6.0)).chain(above).collect();
    let piece = Piece::for_task(&Song::new("", notes, 0.0).unwrap(), &with_fingering()).unwrap();
    let skipped: Vec<usize> = piece.fingering().unwrap().unplayed().omitted().map(|note| note.key).collect();
    assert_eq!(skipped, [48 - 36], "the bass alone");
    // Two voices in parallel, too far apart: the upper one is played.
    let two = melody.into_iter().enumerate().flat_map(|(beat, pitch)| {
        let start = 0.5 * beat as f64;
        [pitch - 24, pitch].map(|pitch| note(pitch, start, start + 0.45))
    });
    let piece = Piece::for_task(&Song::new("", two.collect(), 0.0).unwrap(), &with_fingering()).unwrap();
    let played = piece.fingering().unwrap().notes();
    let upper = played.iter().filter(|note| note.key >= 72 - 36).count();
    assert!(upper == 12 && played.len() == 12, "{upper} of {} notes", played.len());
}

#[test]
fn a_rail_that_starts_late_is_sent_earlier_and_loses_no_notes() {
    let song = repertoire::get("c-major-scale").expect("built in");
    let lost = |delay: f64, lead_steps: usize| {
        let mut config = with_fingering();
        config.physics.insert("joint.rail.delay".to_string(), delay);
        let piece = Piece::for_task(&song, &config).unwrap();
        let fingering = piece.fingering().unwrap();
        let rail = fingering.rail();
        for left in fingering.notes().iter().filter(|note| note.cut.is_some()) {
            let leaves = left.end - lead_steps;
            assert!(
                rail[leaves - 1] != rail[leaves],
                "{left:?}: the rail is not sent away {lead_steps} steps before"
            );
        }
        fingering.unplayed().lost_steps()
    };
    let punctual = lost(0.0, 2);
    assert!(punctual > 0, "the rail has to hurry in this song");
    assert_eq!(lost(0.1, 4), punctual);
}

#[test]
fn keys_are_held_while_they_are_due_and_some_are_left_early() {
    let song = repertoire::get("chord-progression").expect("built in");
    let piece = Piece::for_task(&song, &with_fingering()).unwrap();
    let steps = || 0..piece.steps();
    assert!(steps().all(|step| piece.held(step).difference(piece.due(step)).is_empty()));
    let early: usize = steps().map(|step| piece.due(step).difference(piece.held(step)).len()).sum();
    // Each is left one step later than the plan says.
    let lost = piece.fingering().unwrap().unplayed().notes.iter().map(|note| note.lost_steps - 1);
    assert!(early > 0);
    assert_eq!(early, lost.sum::<usize>());
    // Without a fingering nobody leaves early.
    let piece = Piece::for_task(&song, &TaskConfig::default()).unwrap();
    assert!((0..piece.steps()).all(|step| piece.held(step) == piece.due(step)));
}

#[test]
fn a_finger_that_changes_keys_in_fewer_steps_holds_them_longer() {
    let song = repertoire::get("chord-progression").expect("built in");
    let gaps = |change_steps: usize| {
        let config = TaskConfig { change_steps, ..with_fingering() };
        config.check().unwrap();
        let piece = Piece::for_task(&song, &config).unwrap();
        let fingering = piece.fingering().unwrap();
        let of_a_finger = |finger: usize| {
            let notes: Vec<_> = fingering.notes().iter().filter(|note| note.finger == finger).collect();
            notes.windows(2).map(|two| two[1].start - two[0].end).min()
        };
        let shortest = (0..FINGERS).filter_map(of_a_finger).min().unwrap();
        (shortest, fingering.unplayed().lost_steps())
    };
    let [one, two, three] = [1, 2, 3].map(gaps);
    assert_eq!([one.0, two.0, three.0], [1, 2, 3]);
    assert!(one.1 < two.1 && two.1 < three.1, "{one:?} {two:?} {three:?}");
    let never = TaskConfig { change_steps: 0, ..with_fingering() };
    assert!(never.check().unwrap_err().to_string().contains("task.change_steps is 0: it must be from 1"));
}

#[test]
fn a_strike_past_a_neighbour_costs_a_little_less_than_a_note_that_ends_early() {
    let lost = |song: &str| {
        let song = repertoire::get(song).expect("built in");
        let piece = Piece::for_task(&song, &TaskConfig { change_steps: 2, ..with_fingering() }).unwrap();
        piece.fingering().unwrap().unplayed().lost_steps()
    };
    // With the two at the same cost it is 14: longer moves of the rail, and no finger in another's
    // way.
    assert_eq!(lost("d-major-scale"), 10);
    // If the strike costs nothing it is 6.
    assert_eq!(lost("c-major-scale"), 8);
}

#[test]
fn targets_of_the_fingers_are_around_the_pose_that_holds_them_over_their_goals() {
    let (song, _) = two_notes();
    let bias = [("joint.index_1.encoder_bias".to_string(), 0.02)];
    let config = TaskConfig { finger_range: 0.3, physics: bias.into(), ..with_fingering() };
    config.check().unwrap();
    let piece = Piece::for_task(&song, &config).unwrap();
    let range = TargetRange::new(&piece);
    for (played, (key, start)) in piece.fingering().unwrap().notes().iter().zip([FIRST, SECOND]) {
        // The rail has arrived, the finger waits.
        let step = start - 1;
        let targets = range.targets(&[0.0; ACTION_LEN], step);
        let joints = played.finger * JOINTS_PER_FINGER..(played.finger + 1) * JOINTS_PER_FINGER;
        let readings: [f64; JOINTS_PER_FINGER] = targets[joints.clone()].try_into().unwrap();
        let mut angles = readings;
        angles[1] -= if played.finger == 0 { 0.02 } else { 0.0 };
        let [x, y, z] = kinematics::fingertip(config.stage.side, played.finger, &angles, targets[RAIL]);
        let over = piece.goals(step)[played.finger].unwrap().over;
        assert!((x - over[0]).abs() < 1e-6 && (y - over[1]).abs() < 1e-6, "{x}, {y} for {over:?}");
        let clear = z - TIP_RADIUS - KeyShape::of(key).top();
        assert!((0.004..0.01).contains(&clear), "{clear} m over the key");
        for joint in joints {
            let [low, high] = range.ends(joint, step);
            assert!((high - low - 0.6).abs() < 1e-9 && (targets[joint] - (low + high) / 2.0).abs() < 1e-9);
        }
    }
    // A finger that has nothing to play keeps its pose, also after the end.
    assert_eq!(range.ends(0, piece.steps() + 50), range.ends(0, piece.steps() - 1));
    let without = TaskConfig { finger_range: 0.3, ..TaskConfig::default() };
    assert!(without.check().unwrap_err().to_string().contains("task.fingering = true"));
}

#[test]
fn targets_of_the_rail_are_around_its_planned_place() {
    let (song, _) = two_notes();
    for rail_range in [0.02, TaskConfig::default().rail_range] {
        let config = TaskConfig { rail_range, ..with_fingering() };
        let piece = Piece::for_task(&song, &config).unwrap();
        let range = TargetRange::new(&piece);
        for step in [FIRST.1, SECOND.1] {
            let planned = piece.fingering().unwrap().rail_at(step);
            assert_eq!(range.ends(RAIL, step), [planned - rail_range, planned + rail_range]);
        }
    }
    let never = TaskConfig { rail_range: 0.0, ..with_fingering() };
    assert!(never.check().unwrap_err().to_string().contains("task.rail_range is 0: it must be from 0.001"));
}

#[test]
fn velocities_are_a_fourth_column_of_a_goal() {
    let note = |pitch, start_secs, velocity| Note { pitch, velocity, start_secs, end_secs: start_secs + 0.5 };
    let song = Song::new("soft and loud", vec![note(60, 0.0, 40), note(72, 1.0, 110)], 2.0).unwrap();
    let config = TaskConfig { velocities: true, ..with_fingering() };
    config.check().unwrap();
    let piece = Piece::for_task(&song, &config).unwrap();
    let shown = |config: &TaskConfig, step: usize| {
        let range = TargetRange::new(&piece);
        let history = History::at_rest([0.0; DRIVEN_JOINTS], &range, step);
        let mut out = vec![9.0; layout(config).len()];
        observe(config, &[0.0; DRIVEN_JOINTS], &history, KeySet::EMPTY, &piece, step, &mut out);
        out
    };
    let goals = |step: usize| shown(&config, step)[2 * DRIVEN_JOINTS..][..4 * FINGERS].to_vec();
    let plain = |step: usize| shown(&with_fingering(), step)[2 * DRIVEN_JOINTS..][..3 * FINGERS].to_vec();
    for (step, velocities) in [(0, vec![]), (21, vec![40.0 / 127.0]), (FIRST.1 + 12, vec![110.0 / 127.0])] {
        let (goals, plain) = (goals(step), plain(step));
        let of_goals: Vec<f32> = goals.chunks(4).map(|goal| goal[3]).filter(|v| *v > 0.0).collect();
        assert_eq!(of_goals, velocities, "step {step}");
        let places: Vec<f32> = goals.chunks(4).flat_map(|goal| goal[..3].to_vec()).collect();
        assert_eq!(places, plain, "step {step}: the other columns are as without");
    }
    let without = TaskConfig { velocities: true, ..TaskConfig::default() };
    assert!(without.check().unwrap_err().to_string().contains("task.fingering = true"));
}
