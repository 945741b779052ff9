//! A report of a small identification whose numbers are known: that it can be read, says them, and keeps what
//! is foreign in quotes.

use std::collections::BTreeMap;
use std::path::PathBuf;

use etude_stage::params::Joint;
use etude_stage::{JOINT_NAMES, JOINTS, PhysicalParams, RAIL, StageConfig};

use super::overlay::Replayed;
use super::*;
use crate::config::{LmConfig, MethodConfig};
use crate::estimate::{BlockStatistics, Bound, Estimate, ParameterEstimate, WeakDirection};
use crate::identification::{Stage, StageEnd};
use crate::motion::Commands;
use crate::replay::Trace;

/// A name that a careless page would obey.
const HOSTILE: &str = "/tmp/a<b&\"c'><script>alert(1)</script>\u{1b}.mcap";
/// Control steps of a motion: three seconds.
const STEPS: usize = 60;

struct Case {
    fitted: Vec<Motion>,
    held_out: Vec<Motion>,
    config: IdentifyConfig,
    before: PhysicalParams,
    after: PhysicalParams,
    identified: Identified,
}

/// All joints swing; the robot is the simulator with the numbers `truth`, and stays two milliradians behind.
fn motion(path: &str, truth: &PhysicalParams) -> Motion {
    let swing = |step: usize, joint: usize| {
        let reach = if joint == RAIL { 0.03 } else { 0.12 };
        reach * (step as f64 * (0.2 + 0.01 * joint as f64)).sin()
    };
    let targets = (0..STEPS).map(|step| std::array::from_fn(|joint| swing(step, joint))).collect();
    let mut motion = Motion {
        path: PathBuf::from(path),
        rig: etude_robot::rig::RigConfig::default(),
        mode: "chirp".to_string(),
        commands: Commands::Targets(targets),
        start: [0.0; JOINTS],
        fingers: Vec::new(),
        rail: Vec::new(),
        noise: [1e-4; JOINTS],
        moves: [true; JOINTS],
        saturates: [false; JOINTS],
        keys: Vec::new(),
    };
    let trace = replay_one(truth, &motion);
    let lag = |joint: usize, secs: f64| {
        let speed = trace.position(joint, secs + 0.005) - trace.position(joint, secs - 0.005);
        trace.position(joint, secs) - 0.002 * speed.signum()
    };
    let times: Vec<f64> = (1..900).map(|i| f64::from(i) / 300.0).collect();
    motion.fingers =
        times.iter().map(|&secs| (secs, std::array::from_fn(|joint| lag(joint, secs)))).collect();
    motion.rail = times.iter().step_by(3).map(|&secs| (secs, lag(RAIL, secs))).collect();
    motion
}

fn replay_one(params: &PhysicalParams, motion: &Motion) -> Trace {
    Replayer::new(&StageConfig::default()).unwrap().replay(params, motion, false).unwrap()
}

fn estimate() -> Estimate {
    let parameter = |path: &str, at_bound, is_identifiable| ParameterEstimate {
        path: path.to_string(),
        value: 0.1234,
        interval: [0.1, 0.15],
        standard_error: 0.0125,
        coordinate: 0.5,
        coordinate_standard_error: 0.01,
        at_bound,
        is_identifiable,
    };
    let parts =
        [("joint.index_0.stiffness", 0.7), ("joint.index_0.damping", 0.6), ("joint.index_0.friction", 0.4)];
    Estimate {
        parameters: vec![
            parameter("joint.index_0.stiffness", None, false),
            parameter("joint.index_0.damping", None, false),
            parameter("joint.index_0.friction", Some(Bound::Low), false),
            parameter("joint.index_0.low_pass", None, true),
        ],
        covariance: vec![vec![0.0; 4]; 4],
        correlation: vec![
            vec![1.0, 0.95, 0.0, 0.0],
            vec![0.95, 1.0, 0.0, -0.5],
            vec![0.0, 0.0, 1.0, f64::NAN],
            vec![0.0, -0.5, f64::NAN, 1.0],
        ],
        singular_values: vec![1000.0, 100.0, 10.0, 0.5],
        condition: 2000.0,
        weak: vec![WeakDirection {
            singular_value: 0.5,
            standard_error: 2.0,
            parts: parts.map(|(path, component)| (path.to_string(), -component)).to_vec(),
        }],
        blocks: vec![BlockStatistics {
            name: "0.index_0".to_string(),
            samples: 300,
            effective_samples: 30.0,
            rms: 20.0,
        }],
        residual_variance: 400.0,
    }
}

fn case() -> Case {
    let before = PhysicalParams::default();
    let mut after = before.clone();
    for joint in 0..RAIL {
        after.set_joint(Joint::LowPass, joint, 0.03);
    }
    let stages = vec![StageEnd { stage: Stage::Joints, replays: 321, secs: 12.5, rms: [60.0, 20.0] }];
    Case {
        fitted: vec![motion("/tmp/fitted.mcap", &after)],
        held_out: vec![motion(HOSTILE, &after)],
        config: IdentifyConfig {
            method: MethodConfig::Lm(LmConfig::default()),
            seed: 77,
            start: BTreeMap::new(),
        },
        identified: Identified {
            physics: BTreeMap::new(),
            before: BTreeMap::new(),
            stages,
            estimates: vec![("index".to_string(), estimate())],
        },
        before,
        after,
    }
}

impl Case {
    fn assess(&self) -> [Assessment; 2] {
        [&self.fitted, &self.held_out]
            .map(|motions| Assessment::new(motions, &self.before, &self.after).unwrap())
    }

    fn input<'a>(&'a self, [fit_errors, held_out_errors]: &'a [Assessment; 2]) -> ReportInput<'a> {
        ReportInput {
            fitted: &self.fitted,
            held_out: &self.held_out,
            config: &self.config,
            before: &self.before,
            after: &self.after,
            identified: &self.identified,
            fit_errors,
            held_out_errors,
        }
    }

    fn report(&self) -> Report {
        Report::new(&self.input(&self.assess())).unwrap()
    }
}

/// Refuses text that is not well formed: every tag closed in order, attributes in quotes, no loose `<`, `>`
/// or `&`.
fn check_markup(page: &str) {
    let mut rest = page.strip_prefix("<!DOCTYPE html>").unwrap();
    let mut open: Vec<&str> = Vec::new();
    while let Some(begin) = rest.find('<') {
        check_text(&rest[..begin]);
        // A `>` inside an attribute is written as an entity, so the next one ends the tag.
        let end = begin + rest[begin..].find('>').unwrap();
        let tag = &rest[begin + 1..end];
        rest = &rest[end + 1..];
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(name), "closed out of order");
            continue;
        }
        let inner = tag.strip_suffix('/').unwrap_or(tag);
        let (name, mut attributes) = inner.split_once(' ').unwrap_or((inner, ""));
        assert!(name.chars().all(|c| c.is_ascii_alphanumeric()), "<{tag}>");
        while !attributes.trim().is_empty() {
            let (key, value) = attributes.split_once("=\"").unwrap_or_else(|| panic!("<{tag}>"));
            assert!(
                key.trim().chars().all(|c| c.is_ascii_alphabetic() || c == '-' || c.is_ascii_digit()),
                "{tag}"
            );
            let (value, more) = value.split_once('"').unwrap_or_else(|| panic!("<{tag}>"));
            check_text(value);
            attributes = more;
        }
        if !tag.ends_with('/') {
            open.push(name);
        }
    }
    check_text(rest);
    assert!(open.is_empty(), "left open: {open:?}");
}

fn check_text(text: &str) {
    assert!(!text.contains(['<', '>']) && !text.chars().any(|c| c.is_control() && c != '\n'), "{text}");
    for (at, _) in text.match_indices('&') {
        let known = ["&amp;", "&lt;", "&gt;", "&quot;", "&#39;"];
        assert!(known.iter().any(|entity| text[at..].starts_with(entity)), "{text}");
    }
}

/// Cells of the table with this caption.
fn cells(page: &str, caption: &str) -> Vec<Vec<String>> {
    let from = page.find(&format!("<caption>{caption}</caption>")).unwrap();
    let body = page[from..].split("<tbody>").nth(1).unwrap().split("</tbody>").next().unwrap();
    let cell = |cell: &str| cell.split_once('>').unwrap().1.replace("</td>", "").replace("</tr>", "");
    body.split("<tr>")
        .skip(1)
        .map(|row| row.split("<td").skip(1).map(|c| cell(c).trim().to_string()).collect())
        .collect()
}

#[test]
fn the_page_is_well_formed_stands_alone_and_is_small() {
    let page = case().report().html();
    check_markup(&page);
    assert!(page.len() < 1_000_000, "{} bytes", page.len());
    for foreign in ["<script", "http://", "https://", "@import", "url(", "src=", "href="] {
        let own = "http://www.w3.org/2000/svg";
        assert!(!page.replace(own, "").contains(foreign), "{foreign}");
    }
    assert_eq!(page.matches("<figure>").count(), JOINTS + 1);
    assert!(
        page.contains("/tmp/a&lt;b&amp;&quot;c&#39;&gt;&lt;script&gt;alert(1)&lt;/script&gt;\u{fffd}.mcap")
    );
}

#[test]
fn a_checker_that_passes_everything_would_be_none() {
    for wrong in
        ["<p>a<b</p>", "<p><b></p></b>", "<p>", "<p class=x></p>", "<p>a & b</p>", "<p title=\"<\"></p>"]
    {
        let page = format!("<!DOCTYPE html>{wrong}");
        assert!(std::panic::catch_unwind(|| check_markup(&page)).is_err(), "{wrong}");
    }
    check_markup("<!DOCTYPE html><p class=\"n\">a &amp; b<br/></p>");
}

#[test]
fn its_errors_are_those_of_the_assessment() {
    let case = case();
    let errors = case.assess();
    let report = Report::new(&case.input(&errors)).unwrap();
    for (caption, errors) in [("Fitted recordings", &errors[0]), ("Held-out recordings", &errors[1])] {
        let rows = cells(&report.html(), caption);
        assert_eq!(rows.len(), JOINTS + 1);
        let pooled = [("fingers together", errors.fingers[0], errors.fingers[1], errors.fingers_noise)];
        let joints =
            errors.joints.iter().map(|joint| (joint.joint.as_str(), joint.before, joint.after, joint.noise));
        for (row, (name, before, after, noise)) in rows.iter().zip(joints.chain(pooled)) {
            assert_eq!(row[0], name);
            for (cell, value) in [
                (&row[2], 1e3 * before),
                (&row[3], 1e3 * after),
                (&row[4], before / after),
                (&row[5], 1e3 * noise),
                (&row[6], after / noise),
            ] {
                let shown: f64 = cell.parse().unwrap();
                assert!((shown - value).abs() <= 1e-3 * value.abs(), "{name}: {cell} is not {value}");
                assert!(report.text().contains(cell.as_str()));
            }
        }
    }
}

#[test]
fn what_the_robot_stays_behind_is_found_to_go_with_direction() {
    let rows = cells(&case().report().html(), "Shares of the mean square error after the fit");
    for row in rows.iter().take(RAIL) {
        // The numbers are the truth, and what is left is the two milliradians.
        let size: f64 =
            row[9].strip_prefix("direction, ").unwrap().strip_suffix(" mrad").unwrap().parse().unwrap();
        assert!((size - 2.0).abs() < 0.2, "{row:?}");
    }
}

#[test]
fn parameters_weak_directions_and_advice_are_named() {
    let report = case().report();
    let rows = cells(&report.html(), "index");
    assert_eq!(
        rows[0],
        ["joint.index_0.stiffness", "N·m/rad", "3", "0.1234", "0.1", "0.15", "", "no"].map(str::to_string)
    );
    assert_eq!(rows[2][6], "lower");
    assert_eq!(rows[3][7], "yes");
    let weak = cells(&report.html(), "What is not identifiable, the weakest of each group first");
    let direction = "+0.70 index_0.stiffness, +0.60 index_0.damping, +0.40 index_0.friction";
    assert_eq!(weak, [["index", direction, "3.92", "1"].map(str::to_string)]);
    let text = report.text();
    let advice = cells(&report.html(), "Which motion would make it so");
    assert!(advice.len() == 1 && advice[0][2] == "index_0" && advice[0][3].contains("one scale of torque"));
    assert!(text.contains("index_0.stiffness and index_0.damping") && text.contains("+0.950"));
    assert!(
        text.contains(
            "1 of 4 estimated numbers are told by these recordings, 3 are not, and 1 are at a bound"
        )
    );
    assert!(text.contains("seed 77") && text.contains("321"));
    assert!(text.lines().all(|line| line.chars().count() <= 110));
}

#[test]
fn nothing_weak() {
    let mut case = case();
    case.identified.estimates[0].1.weak.clear();
    let report = case.report();
    check_markup(&report.html());
    assert!(report.text().contains("every direction of the parameters shows in these recordings"));
}

#[test]
fn nothing_held_out() {
    let mut case = case();
    case.held_out.clear();
    let report = case.report();
    check_markup(&report.html());
    let text = report.text();
    assert!(text.contains("No recording was held out") && text.contains("none was held out"));
    assert!(!text.contains("Held-out recordings"));
    assert_eq!(report.html().matches("<figure>").count(), JOINTS + 1);
}

#[test]
fn worlds_that_diverged() {
    let case = case();
    let mut errors = case.assess();
    let infinite = |errors: &mut Assessment, which: usize| {
        errors.fingers[which] = f64::INFINITY;
        for joint in &mut errors.joints {
            *(if which == 0 { &mut joint.before } else { &mut joint.after }) = f64::INFINITY;
        }
    };
    for diverged in [0, 1] {
        infinite(&mut errors[1], diverged);
        let replayed: Vec<Replayed<'_>> = (case.held_out.iter())
            .map(|motion| {
                let mut traces = [&case.before, &case.after].map(|params| Some(replay_one(params, motion)));
                traces[..=diverged].fill(None);
                Replayed { motion, traces }
            })
            .collect();
        let document = sections::document(&case.input(&errors), &[], &replayed);
        let (page, text) = (html::html(&document), text::text(&document));
        check_markup(&page);
        assert!(!page.contains("NaN") && !page.contains("inf"), "{page}");
        assert!(page.contains("before (diverged)"));
        assert_eq!(cells(&page, "Held-out recordings")[0][2], "diverged");
        if diverged == 0 {
            assert!(text.contains("Before the fit the world diverged"));
        } else {
            assert!(text.contains("do not use it") && page.contains("after (diverged)"));
            assert!(text.contains("There is nothing to take apart"));
        }
    }
}

#[test]
fn a_motion_of_the_rail_alone() {
    let mut case = case();
    for motion in case.held_out.iter_mut().chain(&mut case.fitted) {
        motion.moves = std::array::from_fn(|joint| joint == RAIL);
    }
    let report = case.report();
    check_markup(&report.html());
    assert!(!report.html().contains("NaN"));
    assert_eq!(cells(&report.html(), "Held-out recordings")[0][0], JOINT_NAMES[RAIL]);
}

#[test]
fn the_drawing_is_of_the_stretch_with_the_most_motion() {
    let still = Motion { commands: Commands::Targets(vec![[0.0; JOINTS]; 160]), ..case().held_out.remove(0) };
    let with_swing = |path: &str, reach: f64| {
        let at =
            |secs: f64| if (3.0..5.0).contains(&secs) { reach * (6.0 * (secs - 3.0)).sin() } else { 0.0 };
        let times = (1..2400).map(|i| f64::from(i) / 300.0);
        Motion {
            path: PathBuf::from(path),
            fingers: times.map(|secs| (secs, [at(secs); RAIL])).collect(),
            ..still.clone()
        }
    };
    let motions = [with_swing("less.mcap", 0.1), with_swing("more.mcap", 0.2)];
    let replayed = motions.each_ref().map(|motion| Replayed { motion, traces: [None, None] });
    let picture = super::overlay::overlay(4, &replayed.each_ref()).unwrap();
    let times = picture.caption.strip_prefix("middle_0 in more.mcap, ").unwrap();
    let begin: f64 = times.split(' ').next().unwrap().parse().unwrap();
    assert!((begin - 3.0).abs() < 0.1, "{times}");
    check_markup(&format!("<!DOCTYPE html>{}", picture.svg));
}
