//! What the choices that make the engine fast do to the music, and what some that were not made
//! would: the shipped policies play in plain MuJoCo on the exported model, once as it is and once
//! without each choice. `--nocapture` prints the table of `docs/physics.md`.

use std::path::Path;
use std::time::Instant;

use etude_learn::Policy;
use etude_music::metrics::frame_scores;
use etude_music::{KEY_COUNT, KeySet, repertoire};
use etude_stage::geometry::KeyShape;
use etude_stage::params::WorldRow;
use etude_stage::{PhysicalParams, RAIL, StageConfig, World, joint_range};
use etude_task::{ACTION_LEN, Piece, RigState, Stepper, TaskConfig, layout};

use crate::bench::play_nominal;
use crate::replica::{Moment, Replica, swap};

/// Another model than ours.
struct Change {
    name: &'static str,
    /// Whether it undoes a choice of ours; else it is one that was not made.
    undoes: bool,
    edit: fn(String) -> String,
}

const fn change(name: &'static str, undoes: bool, edit: fn(String) -> String) -> Change {
    Change { name, undoes, edit }
}

const CHANGES: [Change; 8] = [
    change("keys never sleep", true, |xml| swap(xml, r#"<flag sleep="enable"/>"#, "")),
    change("gravity, compensated in the hand", true, gravity),
    change("no room above the keys' rest", true, |xml| swap(xml, r#"range="-0.01 "#, r#"range="0 "#)),
    change("all of the hand may touch itself and the keys", true, open_masks),
    change("solver to 1e-14 in 1,000 iterations", true, |xml| {
        option(xml, r#"iterations="1000" ls_iterations="1000" ls_tolerance="1e-6" tolerance="1e-14""#)
    }),
    change("solver to 1e-6", false, |xml| option(xml, r#"tolerance="1e-6""#)),
    change("impratio 1", false, |xml| swap(xml, r#"impratio="10""#, r#"impratio="1""#)),
    change("pyramidal cone", false, |xml| swap(xml, r#"cone="elliptic""#, r#"cone="pyramidal""#)),
];

fn option(xml: String, attributes: &str) -> String {
    swap(xml, "<option ", &format!("<option {attributes} "))
}

/// The model's text up to the hand, and from there.
fn at_hand(xml: &str) -> (String, String) {
    let (rest, hand) = xml.split_at(xml.find(r#"<body name="palm""#).unwrap());
    (rest.to_owned(), hand.to_owned())
}

/// Gravity; the hand's bodies float, and the springs of the keys hold them where they rest without
/// it.
fn gravity(xml: String) -> String {
    let (mut keys, hand) = at_hand(&swap(xml, r#"gravity="0 0 0""#, r#"gravity="0 0 -9.81""#));
    let stiffness = PhysicalParams::default().world(WorldRow::KeyStiffness);
    for key in 0..KEY_COUNT {
        let shape = KeyShape::of(key);
        let rest = -shape.mass * 9.81 * shape.size[0] / 2.0 / stiffness;
        let joint = format!(r#"<joint name="key_{key}" "#);
        keys = swap(keys, &joint, &format!(r#"{joint}springref="{rest}" "#));
    }
    keys + &swap(hand, "<body name=", r#"<body gravcomp="1" name="#)
}

/// Every part of the hand tests contacts with every other (but the one it hangs on) and with keys
/// and fences.
fn open_masks(xml: String) -> String {
    let (keys, mut hand) = at_hand(&xml);
    for closed in [
        r#"class="visual""#,
        r#"contype="2" conaffinity="0""#,
        r#"contype="0" conaffinity="2""#,
        r#"contype="3" conaffinity="0""#,
        r#"contype="1" conaffinity="2""#,
    ] {
        hand = swap(hand, closed, r#"contype="3" conaffinity="2""#);
    }
    keys + &hand
}

/// A shipped policy and what it plays.
struct Player {
    policy: Policy,
    config: TaskConfig,
    piece: Piece,
}

impl Player {
    fn shipped(song: &str) -> Self {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../policies");
        let policy = Policy::load(&folder.join(format!("{song}.safetensors"))).unwrap();
        let config = &policy.header().notes["training"]["config"]["task"];
        let config: TaskConfig = serde_json::from_value(config.clone()).unwrap();
        let piece = Piece::for_task(&repertoire::get(song).unwrap(), &config).unwrap();
        Self { policy, config, piece }
    }

    fn act(&mut self, observation: &[f32]) -> [f32; ACTION_LEN] {
        let mut action = [0.0; ACTION_LEN];
        self.policy.act(observation, &mut action);
        action
    }

    /// Keys pressed at the end of each control step in the environment.
    fn play(&mut self) -> Vec<KeySet> {
        play_nominal(&self.config, &self.piece, &mut self.policy)
    }

    /// The same in a replica, and what moved on the way.
    fn play_on(&mut self, replica: &mut Replica) -> (Vec<KeySet>, Vec<Moment>) {
        let mut observation = vec![0.0; layout(&self.config).len()];
        let (mut pressed, mut moments) = (Vec::new(), Vec::new());
        let state = |replica: &Replica, keys: KeySet| RigState {
            joints: replica.joints(),
            set_points: replica.references(),
            keys,
        };
        let mut now = state(replica, KeySet::EMPTY);
        let mut stepper = Stepper::new(&self.config, &self.piece, &now).unwrap();
        while !stepper.is_over() {
            stepper.observe(&now, &mut observation);
            let action = self.act(&observation);
            moments.extend(replica.record(&[stepper.command(&action).targets]));
            stepper.advance(&now, &action);
            now = state(replica, replica.down(replica.data.qpos()));
            pressed.push(now.keys);
        }
        (pressed, moments)
    }
}

/// Root mean squares of the differences of finger joints (rad) and of the rail (m) between two
/// performances.
fn apart(replica: &Replica, a: &[Moment], b: &[Moment]) -> [f64; 2] {
    [&replica.dofs[..RAIL], &replica.dofs[RAIL..]].map(|dofs| {
        let squares = a
            .iter()
            .zip(b)
            .flat_map(|(a, b)| dofs.iter().map(|&dof| (a.positions[dof] - b.positions[dof]).powi(2)));
        (squares.sum::<f64>() / (a.len() * dofs.len()) as f64).sqrt()
    })
}

/// A row of zeros could also come of an edit that does nothing.
#[test]
fn a_fist_touches_itself_only_without_masks() {
    let world = World::new(&StageConfig::default(), &PhysicalParams::default()).unwrap();
    let fist = std::array::from_fn(|joint| match joint {
        RAIL => 0.0,
        joint if joint % 4 == 0 => 0.0,
        joint => joint_range(joint)[1],
    });
    let [closed, open] = [|xml| xml, open_masks].map(|edit: fn(String) -> String| {
        let mut replica = Replica::of(&world, edit);
        replica.record(&[fist; 40]);
        replica.data.ncon()
    });
    assert!(open > closed, "{open} contacts without masks, {closed} with");
}

/// What became of one song in one changed model.
struct Row {
    change: usize,
    /// F1 less that in the model as it is.
    f1: f64,
    /// Share of the control steps in which the same keys sound.
    alike: f64,
    /// As [`apart`] has them.
    apart: [f64; 2],
    /// Time that it took, as a multiple of that in the model as it is.
    time: f64,
}

#[test]
fn what_makes_the_engine_fast_does_not_change_what_policies_play() {
    let mut rows = Vec::new();
    for song in repertoire::ids() {
        let mut player = Player::shipped(song);
        let world = World::new(&player.config.stage, &player.config.params().unwrap()).unwrap();
        let mut timed = |edit: fn(String) -> String| {
            let mut replica = Replica::of(&world, edit);
            let begin = Instant::now();
            let (frames, moments) = player.play_on(&mut replica);
            (frames, moments, replica, begin.elapsed().as_secs_f64())
        };
        let (frames, moments, _, secs) = timed(|xml| xml);
        let played: Vec<_> = (0..CHANGES.len()).map(|change| timed(CHANGES[change].edit)).collect();
        assert_eq!(frames, player.play(), "{song}: plain MuJoCo and the environment play alike");
        assert!(moments.len() > 1_000);
        let score = |pressed: &[KeySet]| frame_scores(player.piece.frames(), pressed).f1;
        for (change, (others, other_moments, replica, other_secs)) in played.iter().enumerate() {
            let alike = frames.iter().zip(others).filter(|(a, b)| a == b).count();
            rows.push(Row {
                change,
                f1: score(others) - score(&frames),
                alike: alike as f64 / frames.len() as f64,
                apart: apart(replica, &moments, other_moments),
                time: other_secs / secs,
            });
        }
    }
    for (change, Change { name, undoes, .. }) in CHANGES.into_iter().enumerate() {
        let of_change = || rows.iter().filter(|row| row.change == change);
        let mean = |value: fn(&Row) -> f64| of_change().map(value).sum::<f64>() / of_change().count() as f64;
        let most = |value: fn(&Row) -> f64| of_change().map(value).fold(0.0, f64::max);
        println!(
            "| {name} | {:+.4} | {:.4} | {:.1} % | {:.1e} | {:.1e} | {:.2} |",
            mean(|row| row.f1),
            most(|row| row.f1.abs()),
            100.0 * mean(|row| row.alike),
            most(|row| row.apart[0]),
            most(|row| row.apart[1]),
            mean(|row| row.time),
        );
        // On another processor a contact may fall the other way: hence not as close as it is on
        // one.
        let close = most(|row| row.f1.abs()) < 0.02 && of_change().all(|row| row.alike > 0.97);
        assert!(close || !undoes, "{name}");
    }
}
