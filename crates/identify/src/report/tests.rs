//! A report of a small identification with known results: its tables hold them, and foreign text is
//! escaped.

use std::collections::BTreeMap;
use std::path::PathBuf;

use etude_stage::params::JointRow;
use etude_stage::{DRIVEN_JOINTS, JOINT_NAMES, PhysicalParams, RAIL, StageConfig};

use super::*;
use crate::assessment::{Assessment, Replayed};
use crate::config::{LmConfig, MethodConfig};
use crate::estimate::{BlockStatistics, Bound, Estimate, ParameterEstimate, WeakDirection};
use crate::identification::{Identified, IdentifyConfig, Pass, PassEnd};
use crate::motion::{Commands, RecordedMotion};
use crate::replay::{Replayer, Trace};

/// A file name with markup and a control character.
const HOSTILE: &str = "/tmp/a<b&\"c'><script>alert(1)</script>\u{1b}.mcap";
/// Control steps of a motion: three seconds.
const STEPS: usize = 60;

struct Case {
    fitted: Vec<RecordedMotion>,
    held_out: Vec<RecordedMotion>,
    config: IdentifyConfig,
    before: PhysicalParams,
    after: PhysicalParams,
    identified: Identified,
}

/// All joints swing. The robot is the simulator with the parameters `expected`, two milliradians
/// behind.
fn motion(path: &str, expected: &PhysicalParams) -> RecordedMotion {
    let swing = |step: usize, joint: usize| {
        let reach = if joint == RAIL { 0.03 } else { 0.12 };
        reach * (step as f64 * (0.2 + 0.01 * joint as f64)).sin()
    };
    let targets = (0..STEPS).map(|step| std::array::from_fn(|joint| swing(step, joint))).collect();
    let mut motion = RecordedMotion {
        path: PathBuf::from(path),
        rig: etude_robot::rig_file::RigConfig::default(),
        rig_label: "lab".to_string(),
        mode: "chirp".to_string(),
        commands: Commands::Targets(targets),
        start: [0.0; DRIVEN_JOINTS],
        fingers: Vec::new(),
        pwm: Vec::new(),
        rail: Vec::new(),
        noise: [1e-4; DRIVEN_JOINTS],
        moves: [true; DRIVEN_JOINTS],
        keys: Vec::new(),
    };
    let trace = replay_one(expected, &motion);
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

fn replay_one(params: &PhysicalParams, motion: &RecordedMotion) -> Trace {
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
        [("joint.index_0.stiffness", 0.7), ("joint.index_0.viscosity", 0.6), ("joint.index_0.friction", 0.4)];
    Estimate {
        parameters: vec![
            parameter("joint.index_0.stiffness", None, false),
            parameter("joint.index_0.viscosity", None, false),
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
        after.set_joint(JointRow::LowPass, joint, 0.03);
    }
    let passes = vec![PassEnd { pass: Pass::Joints, replays: 321, secs: 12.5, rms: [60.0, 20.0] }];
    Case {
        fitted: vec![motion("/tmp/fitted.mcap", &after)],
        held_out: vec![motion(HOSTILE, &after)],
        config: IdentifyConfig {
            method: MethodConfig::Lm(LmConfig::default()),
            seed: 77,
            start: BTreeMap::new(),
        },
        identified: Identified {
            measured: Vec::new(),
            physics: BTreeMap::new(),
            before: BTreeMap::new(),
            passes,
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

/// Rows of the table with this caption.
fn rows(report: &Report, caption: &str) -> Vec<Vec<String>> {
    let (_, table) = report.markdown.split_once(&format!("**{caption}**\n\n")).unwrap();
    let cells = |line: &str| {
        let inside = line.strip_prefix("| ").unwrap().strip_suffix(" |").unwrap().replace('\\', "");
        inside.split(" | ").map(str::to_string).collect::<Vec<_>>()
    };
    let mut lines = table.lines().take_while(|line| line.starts_with('|')).map(cells);
    let columns = lines.next().unwrap().len();
    let rows: Vec<_> = lines.skip(1).collect();
    assert!(rows.iter().all(|row| row.len() == columns));
    rows
}

#[test]
fn the_markdown_is_small_and_shows_foreign_text_as_text() {
    let report = case().report();
    let text = &report.markdown;
    assert!(text.len() < 100_000, "{} bytes", text.len());
    assert!(text.match_indices('<').all(|(at, _)| text[..at].ends_with('\\')));
    assert!(!text.contains(|c: char| c.is_control() && c != '\n'));
    let name = "/tmp/a\\<b\\&\"c'\\>\\<script\\>alert(1)\\</script\\>\u{fffd}.mcap";
    assert!(text.contains(name), "{text}");
    // Every row of a table has as many cells as its header.
    let cells = |line: &str| line.replace("\\|", "").matches('|').count();
    for (line, next) in text.lines().zip(text.lines().skip(1)) {
        assert!(!(line.starts_with('|') && next.starts_with('|')) || cells(line) == cells(next), "{line}");
    }
    assert_eq!(report.figures.len(), DRIVEN_JOINTS);
    for figure in &report.figures {
        let svg = figure.svg();
        assert!(text.contains(&format!("]({}.svg)", figure.name)));
        assert!(
            svg.starts_with("<svg")
                && svg.ends_with("</svg>\n")
                && !svg.contains("NaN")
                && !svg.contains("inf")
        );
        for colour in ["#BBBBBB", "#D55E00", "#0072B2"] {
            let curves = svg.lines().filter(|line| line.contains("<polyline") && line.contains(colour));
            assert_eq!(curves.filter(|line| line.len() > 300).count(), 1, "{svg}");
        }
    }
    assert!(text.contains("\n## In short\n"));
}

#[test]
fn its_errors_are_those_of_the_assessment() {
    let case = case();
    let errors = case.assess();
    let report = Report::new(&case.input(&errors)).unwrap();
    let text = &report.markdown;
    for (caption, errors) in [("Fitted recordings", &errors[0]), ("Held-out recordings", &errors[1])] {
        let rows = rows(&report, caption);
        assert_eq!(rows.len(), DRIVEN_JOINTS + 1);
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
                assert!(text.contains(cell.as_str()));
            }
        }
    }
}

#[test]
fn a_constant_lag_is_attributed_to_the_direction_of_motion() {
    let rows = rows(&case().report(), "Shares of the mean square error after the fit");
    for row in rows.iter().take(RAIL) {
        // The parameters are the true ones, so the two milliradians remain.
        let size: f64 =
            row[8].strip_prefix("direction, ").unwrap().strip_suffix(" mrad").unwrap().parse().unwrap();
        assert!((size - 2.0).abs() < 0.2, "{row:?}");
    }
}

#[test]
fn parameters_weak_directions_and_advice_are_named() {
    let report = case().report();
    let index = rows(&report, "index");
    assert_eq!(
        index[0],
        ["joint.index_0.stiffness", "N·m/rad", "3", "0.1234", "0.1", "0.15", "", "no"].map(str::to_string)
    );
    assert_eq!(index[2][6], "lower");
    assert_eq!(index[3][7], "yes");
    let weak = rows(&report, "What is not identifiable, the weakest direction of each group first");
    let direction = "+0.70 index_0.stiffness, +0.60 index_0.viscosity, +0.40 index_0.friction";
    assert_eq!(weak, [["index", direction, "3.92", "1"].map(str::to_string)]);
    let text = &report.markdown;
    let advice = rows(&report, "Which motion would make it identifiable");
    assert!(advice.len() == 1 && advice[0][2] == "index_0" && advice[0][3].contains("one scale of torque"));
    assert!(text.contains("index_0.stiffness and index_0.viscosity") && text.contains("+0.950"));
    assert!(
        text.contains("1 of 4 estimated parameters are identifiable from these recordings; 1 are at a bound")
    );
    assert!(text.contains("seed 77") && text.contains("321"));
}

#[test]
fn nothing_weak() {
    let mut case = case();
    case.identified.estimates[0].1.weak.clear();
    let report = case.report();
    assert!(report.markdown.contains("Every direction of the estimated parameters is identifiable"));
}

#[test]
fn nothing_held_out() {
    let mut case = case();
    case.held_out.clear();
    let report = case.report();
    let text = &report.markdown;
    assert!(text.contains("No recording was held out") && text.contains("none was held out"));
    assert!(!text.contains("Held-out recordings"));
    assert_eq!(report.figures.len(), DRIVEN_JOINTS);
}

#[test]
fn simulations_that_diverged() {
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
        let report = build::report(&case.input(&errors), &replayed);
        let text = &report.markdown;
        let svg = report.figures[0].svg();
        assert!(
            !text.contains("NaN") && !text.contains("inf") && !svg.contains("NaN") && !svg.contains("inf"),
            "{text}"
        );
        assert!(svg.contains("before (diverged)"));
        assert_eq!(rows(&report, "Held-out recordings")[0][2], "diverged");
        if diverged == 0 {
            assert!(text.contains("Before the fit the simulation diverged"));
        } else {
            assert!(text.contains("do not use it") && svg.contains("after (diverged)"));
            assert!(text.contains("There is no error to analyse"));
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
    assert!(!report.markdown.contains("NaN"));
    assert_eq!(rows(&report, "Held-out recordings")[0][0], JOINT_NAMES[RAIL]);
}

#[test]
fn the_drawing_is_of_the_stretch_with_the_most_motion() {
    let still = RecordedMotion {
        commands: Commands::Targets(vec![[0.0; DRIVEN_JOINTS]; 160]),
        ..case().held_out.remove(0)
    };
    let with_swing = |path: &str, reach: f64| {
        let at =
            |secs: f64| if (3.0..5.0).contains(&secs) { reach * (6.0 * (secs - 3.0)).sin() } else { 0.0 };
        let times = (1..2400).map(|i| f64::from(i) / 300.0);
        RecordedMotion {
            path: PathBuf::from(path),
            fingers: times.map(|secs| (secs, [at(secs); RAIL])).collect(),
            ..still.clone()
        }
    };
    let motions = [with_swing("less.mcap", 0.1), with_swing("more.mcap", 0.2)];
    let replayed = motions.each_ref().map(|motion| Replayed { motion, traces: [None, None] });
    let picture = super::overlay::overlay(4, &replayed).unwrap();
    let times = picture.caption.strip_prefix("middle_0 in more.mcap, ").unwrap();
    let begin: f64 = times.split(' ').next().unwrap().parse().unwrap();
    assert!((begin - 3.0).abs() < 0.1, "{times}");
}
