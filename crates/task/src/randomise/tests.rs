use std::collections::BTreeMap;

use etude_stage::params::{JointRow, WorldRow};
use etude_stage::{DRIVEN_JOINTS, RAIL};
use proptest::prelude::*;
use rand::SeedableRng as _;

use super::*;

const ROOT: u64 = 3;

fn config(intensity: f64, widths: Widths) -> RandomisationConfig {
    RandomisationConfig { intensity, widths }
}

fn randomisation(nominal: &PhysicalParams, config: &RandomisationConfig) -> Randomisation {
    Randomisation::new(nominal.clone(), config, Actuation::Controlled).unwrap()
}

fn identified(widths: &[(&str, f64)]) -> Widths {
    Widths::Identified(widths.iter().map(|(path, width)| (path.to_string(), *width)).collect())
}

fn draw(randomisation: &Randomisation, worlds: usize) -> Vec<PhysicalParams> {
    let mut random = Pcg64::seed_from_u64(ROOT);
    (0..worlds).map(|_| randomisation.draw(&mut random)).collect()
}

fn draws(intensity: f64) -> Vec<PhysicalParams> {
    draw(&randomisation(&PhysicalParams::default(), &config(intensity, Widths::default())), 500)
}

#[test]
fn no_intensity_is_the_nominal_world() {
    assert!(draws(0.0).iter().all(|p| *p == PhysicalParams::default()));
}

/// FNV-1a over the bits of every number, as the default world gives them:
/// recorded runs depend on it.
#[test]
fn the_papers_draws_are_those_of_recorded_runs() {
    let nominal = PhysicalParams::default();
    for (intensity, recorded) in [(0.3, 0x8c84_9a59_f08f_ccc0_u64), (1.0, 0x4d37_c3f9_e3cc_8388_u64)] {
        let mut sum = 0xcbf2_9ce4_8422_2325_u64;
        for params in draws(intensity) {
            // These were added later, and are not drawn.
            let later = ["hysteresis", "preload", "friction_at_rest", "dead_band", "load"];
            let is_later = |path: &str| later.iter().any(|row| path.ends_with(&format!(".{row}")));
            for (path, ..) in PhysicalParams::rows().filter(|row| !is_later(&row.0)) {
                // The torque limit follows the stiffness; in recorded runs it stayed.
                let stayed = path.ends_with(".torque_limit");
                let params = if stayed { &nominal } else { &params };
                for byte in params.get(&path).unwrap().to_bits().to_le_bytes() {
                    sum = (sum ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
                }
            }
        }
        assert_eq!(sum, recorded, "intensity {intensity}");
    }
}

#[test]
fn full_intensity_fills_the_ranges_and_half_stays_inside() {
    for (intensity, low, high) in [(1.0, 0.1, 0.9), (0.5, 0.3, 0.7)] {
        let values: Vec<f64> = draws(intensity).iter().map(|p| p.world(WorldRow::KeyThreshold)).collect();
        assert!(values.iter().all(|v| (low..=high).contains(v)));
        let (least, most) = values.iter().fold((1.0f64, 0.0f64), |(l, m), v| (l.min(*v), m.max(*v)));
        assert!(least < low + 0.03 && most > high - 0.03);
    }
}

#[test]
fn exactly_the_papers_seven_quantities_vary() {
    assert_eq!(RANDOMISED.len(), 7);
    let nominal = PhysicalParams::default();
    let drawn = draws(1.0);
    let changed = |path: &String| drawn.iter().any(|p| p.get(path) != nominal.get(path));
    let varied: Vec<String> = PhysicalParams::rows().map(|row| row.0).filter(changed).collect();
    let mut said: Vec<String> = randomisation(&nominal, &config(1.0, Widths::default())).paths().collect();
    assert_eq!(said.len(), 5 + 2 * DRIVEN_JOINTS);
    let place = |path: &String| PhysicalParams::rows().position(|row| row.0 == *path);
    // The force of an actuator is its stiffness and its torque limit.
    said.extend(
        said.clone()
            .iter()
            .filter(|path| path.ends_with("stiffness") && path.starts_with("joint"))
            .map(|path| path.replace("stiffness", "torque_limit")),
    );
    said.sort_by_key(place);
    assert_eq!(varied, said);
}

/// A joint that is twice as strong follows twice as stiffly and pushes twice as hard.
#[test]
fn the_force_of_an_actuator_is_its_stiffness_and_its_torque_limit() {
    let nominal = PhysicalParams::default();
    let (mut weakest, mut strongest) = (1.0_f64, 1.0_f64);
    for params in draws(0.5) {
        for joint in 0..DRIVEN_JOINTS {
            let factor = |row| params.joint(row, joint) / nominal.joint(row, joint);
            let (stiffness, limit) = (factor(JointRow::Stiffness), factor(JointRow::TorqueLimit));
            assert!((stiffness - limit).abs() < 1e-12, "joint {joint}: {stiffness} {limit}");
            (weakest, strongest) = (weakest.min(limit), strongest.max(limit));
        }
    }
    assert!((0.55..0.56).contains(&weakest) && (1.44..1.45).contains(&strongest), "{weakest} {strongest}");
}

/// Half of the draws lie on either side of the nominal value, wherever identification has put that.
#[test]
fn worlds_are_centred_on_the_identified_values() {
    let mut nominal = PhysicalParams::default();
    for (path, value) in [
        ("keyboard.height", 0.004),
        ("hand.start", -0.02),
        ("key.threshold", 0.7),
        ("key.stiffness", 0.45),
        ("key.friction", 2.8),
        ("joint.fingers.stiffness", 2.2),
        ("joint.rail.damping", 900.0),
    ] {
        nominal.set(path, value).unwrap();
    }
    let widths =
        identified(&[("key.stiffness", 0.1), ("joint.all.damping", 0.02), ("joint.rail.delay", 0.0)]);
    for widths in [Widths::default(), widths] {
        let randomisation = randomisation(&nominal, &config(0.4, widths));
        let drawn = draw(&randomisation, 2_000);
        for path in randomisation.paths() {
            let middle = nominal.get(&path).unwrap();
            let below = drawn.iter().filter(|p| p.get(&path).unwrap() < middle).count();
            let above = drawn.iter().filter(|p| p.get(&path).unwrap() > middle).count();
            // What cannot rise keeps its nominal value instead: friction is above the paper's
            // range, delays have no width.
            let (fixed, bound) = (path == "joint.rail.delay", path == "key.friction");
            let half = |count: usize| (900..1_100).contains(&count);
            assert!(half(below) || fixed, "{path}: {below} of 2000 below");
            assert!(half(above) || fixed || (bound && above == 0), "{path}: {above} of 2000 above");
        }
    }
}

#[test]
fn identified_widths_are_half_widths_and_the_more_exact_path_counts() {
    let widths = identified(&[
        ("joint.all.damping", 0.05),
        ("joint.fingers.damping", 0.02),
        ("joint.index_1.damping", 0.01),
        ("key.threshold", 0.8),
    ]);
    let nominal = PhysicalParams::default();
    let randomisation = randomisation(&nominal, &config(0.5, widths));
    let paths: Vec<String> = randomisation.paths().collect();
    assert_eq!((paths.len(), paths[0].as_str()), (1 + DRIVEN_JOINTS, "key.threshold"));
    let drawn = draw(&randomisation, 1_000);
    let farthest = |path: &str| {
        let off = |p: &PhysicalParams| (p.get(path).unwrap() - nominal.get(path).unwrap()).abs();
        drawn.iter().map(off).fold(0.0, f64::max)
    };
    for (path, width) in
        [("joint.index_1.damping", 0.01), ("joint.ring_3.damping", 0.02), ("joint.rail.damping", 0.05)]
    {
        let share = farthest(path) / (0.5 * width);
        assert!((0.98..=1.0 + 1e-9).contains(&share), "{path}: {share} of the half-width");
    }
    assert_eq!(drawn[0].joint(JointRow::Stiffness, 0), nominal.joint(JointRow::Stiffness, 0));
    // Joints of a group are drawn one by one, and what leaves the row is clamped to it.
    assert_ne!(drawn[0].joint(JointRow::Damping, 0), drawn[0].joint(JointRow::Damping, 4));
    let clamped = drawn.iter().filter(|p| p.world(WorldRow::KeyThreshold) == 0.95).count();
    assert_eq!(clamped, 0, "0.5 + 0.4 is inside");
    assert!((farthest("key.threshold") - 0.4).abs() < 0.01);
}

#[test]
fn widths_that_mean_nothing_are_refused() {
    let message = |path: &str, width: f64| {
        let config = config(0.5, identified(&[(path, width)]));
        Randomisation::new(PhysicalParams::default(), &config, Actuation::Controlled).unwrap_err().to_string()
    };
    for path in ["key.colour", "joint.thumb_0.damping", "joint.fingers.colour", "", "joint.fingers", "joint"]
    {
        let said = message(path, 0.1);
        assert!(
            said.contains(&format!("`{path}`")) && said.contains("`etude model params` lists them"),
            "{said}"
        );
    }
    for width in [-0.1, f64::NAN, f64::INFINITY] {
        let said = message("key.threshold", width);
        assert!(said.contains("key.threshold") && said.contains("at least 0"), "{said}");
    }
}

#[test]
fn configurations_say_paper_or_list_half_widths() {
    let read = |text: &str| serde_json::from_str::<RandomisationConfig>(text);
    assert_eq!(read("{}").unwrap(), RandomisationConfig::default());
    assert_eq!(read(r#"{"widths": "paper"}"#).unwrap().widths, Widths::default());
    let widths = identified(&[("joint.rail.damping", 40.0), ("key.threshold", 0.1)]);
    let config = RandomisationConfig { intensity: 0.5, widths };
    assert_eq!(read(&serde_json::to_string(&config).unwrap()).unwrap(), config);
    for text in [r#"{"widths": "wide"}"#, r#"{"widths": 3}"#, r#"{"widths": ["key.threshold"]}"#] {
        let said = read(text).unwrap_err().to_string();
        assert!(said.contains("\"paper\", or a table of half-widths by path"), "{said}");
    }
}

#[test]
fn a_grid_takes_each_part_of_each_range_once() {
    let nominal = PhysicalParams::default();
    let widths =
        identified(&[("key.threshold", 0.2), ("joint.fingers.damping", 0.05), ("keyboard.height", 0.01)]);
    for (widths, count) in [(Widths::default(), 5 + 2 * DRIVEN_JOINTS), (widths, 2 + RAIL)] {
        let randomisation = randomisation(&nominal, &config(0.5, widths));
        let (worlds, paths) = (24, randomisation.paths().collect::<Vec<_>>());
        assert_eq!(paths.len(), count);
        let grid = randomisation.grid(worlds, 1);
        assert_eq!(grid, randomisation.grid(worlds, 1));
        assert_ne!(grid, randomisation.grid(worlds, 2));
        for path in &paths {
            // Where draws fall into equally likely parts, the grid has one value in each.
            let mut drawn: Vec<f64> =
                draw(&randomisation, 2_400).iter().map(|p| p.get(path).unwrap()).collect();
            drawn.sort_by(f64::total_cmp);
            let mut taken: Vec<f64> = grid.iter().map(|p| p.get(path).unwrap()).collect();
            taken.sort_by(f64::total_cmp);
            let range = drawn[2_399] - drawn[0];
            for (part, value) in taken.iter().enumerate() {
                let (low, high) = (drawn[100 * part], drawn[100 * part + 99]);
                let slack = 0.03 * range;
                assert!((low - slack..=high + slack).contains(value), "{path}: {value} in part {part}");
            }
        }
        // The columns are shuffled apart: no two of them go together.
        let column = |path: &String| grid.iter().map(|p| p.get(path).unwrap()).collect::<Vec<_>>();
        let (a, b) = (column(&paths[0]), column(&paths[count - 1]));
        assert!(correlation(&a, &b).abs() < 0.6, "{}", correlation(&a, &b));
    }
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    let (mean_a, mean_b) = (mean(a), mean(b));
    let sum =
        |x: &[f64], m: f64, y: &[f64], n: f64| x.iter().zip(y).map(|(x, y)| (x - m) * (y - n)).sum::<f64>();
    sum(a, mean_a, b, mean_b) / (sum(a, mean_a, a, mean_a) * sum(b, mean_b, b, mean_b)).sqrt()
}

#[test]
fn no_number_or_world_is_too_few_for_a_grid() {
    let randomisation = randomisation(&PhysicalParams::default(), &config(1.0, identified(&[])));
    assert_eq!(randomisation.grid(3, 0), vec![PhysicalParams::default(); 3]);
    assert_eq!(randomisation.grid(0, 0), vec![]);
    assert_eq!(draw(&randomisation, 2), vec![PhysicalParams::default(); 2]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    /// Whatever the widths, a drawn world lies within its rows and within the half-widths.
    #[test]
    fn drawn_numbers_stay_inside(
        widths in prop::collection::vec((any::<prop::sample::Index>(), 0.0f64..10.0), 0..12),
        intensity in 0.0f64..=1.0,
        seed: u64,
    ) {
        let rows: Vec<_> = PhysicalParams::rows().collect();
        let widths: BTreeMap<String, f64> = widths.iter().map(|(index, width)| {
            let (path, row, _) = &rows[index.index(rows.len())];
            (path.clone(), width * (row.range[1] - row.range[0]))
        }).collect();
        let config = config(intensity, Widths::Identified(widths.clone()));
        let randomisation = randomisation(&PhysicalParams::default(), &config);
        let mut random = Pcg64::seed_from_u64(seed);
        let worlds = (0..4).map(|_| randomisation.draw(&mut random)).chain(randomisation.grid(3, seed));
        for params in worlds.collect::<Vec<_>>() {
            params.check().unwrap();
            for (path, _, default) in &rows {
                let off = (params.get(path).unwrap() - default).abs();
                // A drive that is too strong for a drawn inertia gives way.
                let guarded = path.ends_with("torque_limit") || path == "key.stiffness";
                let most = widths.get(path).map_or(0.0, |width| intensity * width);
                prop_assert!(guarded || off <= most * (1.0 + 1e-9) + 1e-12, "{path}: {off} of {most}");
            }
        }
    }
}

/// A key is silent again at a share of its threshold, so the draws of the threshold move both
/// contacts.
#[test]
fn both_contacts_of_the_keys_are_randomised_together() {
    let nominal = PhysicalParams::default().with(&[("key.hysteresis".to_string(), 0.4)].into()).unwrap();
    let drawn = draw(&randomisation(&nominal, &config(1.0, Widths::default())), 100);
    let silent =
        |p: &PhysicalParams| p.world(WorldRow::KeyThreshold) * (1.0 - p.world(WorldRow::KeyHysteresis));
    let (low, high) = drawn.iter().map(silent).fold((1.0f64, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
    assert!(low < 0.1 && high > 0.5, "{low} … {high}");
    assert!(drawn.iter().all(|p| silent(p) < p.world(WorldRow::KeyThreshold)));
}
