//! The two methods on the same recordings, from the same starts: the replays and seconds that each
//! needs to reach the same error. Prints a table: `cargo run
//! --release -p etude-identify --example methods -- chirp.mcap [--seeds N]`.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "printing is what it is for")]

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use etude_identify::{
    BoConfig, IdentifyConfig, IdentifyError, LmConfig, MethodConfig, Pass, Progress, RecordedMotion, identify,
};
use etude_perform::Job;
use etude_stage::params::JointRow;
use etude_stage::{JOINT_NAMES, PhysicalParams};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

/// Errors at which the methods are compared, as multiples of the smallest error of all fits.
const LEVELS: [f64; 4] = [3.0, 1.5, 1.1, 1.02];
/// Largest factor between a start and the default.
const START: f64 = 2.0;

/// Error after so many replays and seconds.
#[derive(Clone, Copy)]
struct Point {
    replays: u64,
    secs: f64,
    rms: f64,
}

fn methods() -> [(&'static str, MethodConfig); 2] {
    [("lm", MethodConfig::Lm(LmConfig::for_replays())), ("bo", MethodConfig::Bo(BoConfig::default()))]
}

/// Start values of each joint, drawn by `seed`.
fn start(seed: u64) -> BTreeMap<String, f64> {
    let mut random = Pcg64::seed_from_u64(seed);
    let defaults = PhysicalParams::default();
    let mut start = BTreeMap::new();
    for (joint, name) in JOINT_NAMES.iter().enumerate() {
        for quantity in [JointRow::Stiffness, JointRow::Damping, JointRow::LowPass] {
            let factor = START.powf(random.random_range(-1.0..=1.0));
            start.insert(
                format!("joint.{name}.{}", quantity.row().name),
                factor * defaults.joint(quantity, joint),
            );
        }
    }
    start
}

/// The error of all joints while each is fitted by itself.
fn course(motions: &[RecordedMotion], method: MethodConfig, seed: u64) -> Result<Vec<Point>, IdentifyError> {
    let config = IdentifyConfig { method, seed, start: start(seed) };
    let state = std::env::temp_dir().join(format!("methods-{seed}-{}.json", std::process::id()));
    let (begun, interrupt) = (Instant::now(), AtomicBool::new(false));
    let mut points: Vec<Point> = Vec::new();
    // The count of replays restarts in each round.
    let (mut before, mut last) = (0, 0);
    let mut tell = |progress: &Progress| {
        if progress.pass == Pass::Joints {
            if progress.replays < last {
                before += last;
            }
            last = progress.replays;
            let (replays, secs) = (before + last, begun.elapsed().as_secs_f64());
            points.push(Point { replays, secs, rms: progress.rms });
        } else {
            interrupt.store(true, Ordering::Relaxed);
        }
    };
    let ended = identify(motions, &config, &state, &mut Job::new(&mut tell, &interrupt));
    let _ = std::fs::remove_file(&state);
    match ended {
        Ok(_) | Err(IdentifyError::Interrupted) => Ok(points),
        Err(error) => Err(error),
    }
}

/// Median, and the range in brackets.
fn spread(mut values: Vec<f64>, digits: usize) -> String {
    values.sort_by(f64::total_cmp);
    match (values.first(), values.last()) {
        (Some(low), Some(high)) => {
            format!("{:.digits$} ({low:.digits$}–{high:.digits$})", values[values.len() / 2])
        }
        _ => "–".to_string(),
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut paths: Vec<String> = std::env::args().skip(1).collect();
    let seeds: u64 = match paths.iter().position(|text| text == "--seeds") {
        Some(place) => paths.split_off(place).get(1).ok_or("--seeds needs a number")?.parse()?,
        None => 5,
    };
    let motions: Vec<RecordedMotion> =
        paths.iter().map(|path| RecordedMotion::load(Path::new(path))).collect::<Result<_, _>>()?;
    let mut courses: Vec<(&str, Vec<Vec<Point>>)> = Vec::new();
    for (name, method) in methods() {
        let mut all = Vec::new();
        for seed in 0..seeds {
            let course = course(&motions, method.clone(), seed)?;
            let last = course.last().ok_or("nothing was fitted")?;
            eprintln!(
                "{name}, seed {seed}: {:.2} after {} replays, {:.1} s",
                last.rms, last.replays, last.secs
            );
            all.push(course);
        }
        courses.push((name, all));
    }
    let last = |course: &Vec<Point>| course.last().map_or(f64::INFINITY, |point| point.rms);
    let least = courses.iter().flat_map(|(_, all)| all.iter().map(last)).fold(f64::INFINITY, f64::min);
    println!(
        "Smallest error {least:.2} standard deviations of the encoders' noise; at the starts {}.\n",
        spread(
            courses[0].1.iter().map(|course| course.first().map_or(f64::NAN, |point| point.rms)).collect(),
            0
        )
    );
    println!("| error | method | reached | replays | seconds |\n|---|---|---|---|---|");
    for level in LEVELS {
        for (name, all) in &courses {
            let reached: Vec<Point> = all
                .iter()
                .filter_map(|course| course.iter().find(|point| point.rms <= level * least).copied())
                .collect();
            println!(
                "| {level} × the smallest | {name} | {} of {seeds} | {} | {} |",
                reached.len(),
                spread(reached.iter().map(|point| point.replays as f64).collect(), 0),
                spread(reached.iter().map(|point| point.secs).collect(), 1)
            );
        }
    }
    println!("| where it ended | | | | |");
    for (name, all) in &courses {
        println!(
            "| {} × the smallest | {name} | | {} | {} |",
            spread(all.iter().map(|course| last(course) / least).collect(), 2),
            spread(all.iter().filter_map(|c| c.last()).map(|point| point.replays as f64).collect(), 0),
            spread(all.iter().filter_map(|c| c.last()).map(|point| point.secs).collect(), 1)
        );
    }
    Ok(())
}
