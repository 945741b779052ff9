//! Levenberg–Marquardt: perturbing together, delays, outliers, failures.

use std::cell::Cell;

use etude_identify::{
    Block, Differences, Fit, LmConfig, Loss, MethodConfig, Parameter, Problem, Space, StopReason,
};

use crate::problems::{estimated, evaluate, fitted, oscillate, problem, run};

const JOINTS: usize = 13;
const SAMPLES: usize = 60;

fn lm() -> MethodConfig {
    MethodConfig::Lm(LmConfig::default())
}

/// Thirteen oscillators with three parameters each, and one that all share; with or without the
/// parameters' influences.
fn joints(grouped: bool) -> Problem {
    let mut parameters = vec![Parameter::new("world.gain", 0.5, 2.0, 1.0)];
    for joint in 0..JOINTS {
        for (name, low, high, start) in
            [("stiffness", 5.0, 60.0, 20.0), ("damping", 0.05, 5.0, 0.3), ("cubic", 0.0, 20.0, 1.0)]
        {
            let parameter = Parameter::new(&format!("joint.{joint}.{name}"), low, high, start);
            parameters.push(if grouped {
                parameter.influencing([format!("joint.{joint}")])
            } else {
                parameter
            });
        }
    }
    let blocks = (0..JOINTS).map(|joint| Block::new(&format!("joint.{joint}"), SAMPLES)).collect();
    Problem::new(Space::new(parameters).unwrap(), blocks, Loss::Squared).unwrap()
}

fn joints_residuals(x: &[f64]) -> Vec<f64> {
    let of_joint = |joint: usize| {
        let truth = oscillate(&[20.0 + joint as f64, 0.8, 6.0], 0.03, SAMPLES);
        let given = oscillate(&x[1 + 3 * joint..4 + 3 * joint], 0.03, SAMPLES);
        given.into_iter().zip(truth).map(|(a, b)| (x[0] * a - 1.2 * b) / 0.01).collect::<Vec<f64>>()
    };
    (0..JOINTS).flat_map(of_joint).collect()
}

#[test]
fn a_jacobian_perturbed_together_is_the_one_perturbed_one_by_one() {
    let (together, single) = (joints(true), joints(false));
    let point = together.space().start();
    let [a, b] = [&together, &single].map(|problem| estimated(problem, &point, &joints_residuals));
    assert_eq!(a.covariance, b.covariance);
    assert_eq!(a.singular_values, b.singular_values);
    assert!(a.singular_values.iter().all(|value| *value > 0.0));
    // The batch has one column for the shared gain and three for all joints.
    let mut fits = [together, single].map(|problem| Fit::new(problem, &lm(), 0).unwrap());
    let batches = fits.each_mut().map(|fit| {
        let start = evaluate(&fit.ask(), &joints_residuals);
        fit.tell(&start).unwrap();
        fit.ask().len()
    });
    assert_eq!(batches, [4, 40]);
}

#[test]
fn perturbing_together_finds_the_same_optimum_with_a_tenth_of_the_evaluations() {
    let [(together, _), (single, _)] =
        [true, false].map(|grouped| fitted(&joints(grouped), &lm(), 0, &joints_residuals));
    println!("{} and {} evaluations", together.evaluations(), single.evaluations());
    assert!(together.evaluations() * 7 < single.evaluations());
    for fit in [&together, &single] {
        let values = &fit.best().unwrap().values;
        assert!((values[0] - 1.2).abs() < 1e-5, "{values:?}");
        for joint in 0..JOINTS {
            assert!((values[1 + 3 * joint] - 20.0 - joint as f64).abs() < 1e-3, "{values:?}");
        }
    }
}

/// Reference trajectories of joints: a chirp, delayed as the stage delays and slowed by a low-pass.
fn delayed(delay_secs: f64, low_pass_secs: f64, joint: usize) -> Vec<f64> {
    let steps = delay_secs / 0.005;
    let target = |k: f64| {
        let t = k.max(0.0) * 0.005;
        ((3.0 + 0.3 * joint as f64 + 4.0 * t) * t).sin()
    };
    let mut y = 0.0;
    (0..400u16)
        .map(|k| {
            let (whole, rest) = (f64::from(k) - steps.floor(), steps.fract());
            let wanted = (1.0 - rest) * target(whole) + rest * target(whole - 1.0);
            y += (wanted - y) * (0.005 / (0.005 + low_pass_secs));
            y
        })
        .collect()
}

#[test]
fn a_delay_and_a_low_pass_are_separated() {
    for grouped in [true, false] {
        let joints = 5;
        let delay = |j: usize| 0.0125 + 0.014 * j as f64;
        let mut parameters = Vec::new();
        for joint in 0..joints {
            let block = [format!("joint.{joint}")];
            let path = |name: &str| format!("joint.{joint}.{name}");
            let two = [
                Parameter::new(&path("delay"), 0.0, 0.1, 0.0),
                Parameter::new(&path("low_pass"), 0.0, 0.2, 0.05),
            ];
            parameters.extend(two.map(|p| if grouped { p.influencing(block.clone()) } else { p }));
        }
        let blocks = (0..joints).map(|joint| Block::new(&format!("joint.{joint}"), 400)).collect();
        let problem = Problem::new(Space::new(parameters).unwrap(), blocks, Loss::Squared).unwrap();
        let residuals = |x: &[f64]| -> Vec<f64> {
            let of_joint = |joint: usize| {
                let given = delayed(x[2 * joint], x[2 * joint + 1], joint);
                let truth = delayed(delay(joint), 0.02, joint);
                given.into_iter().zip(truth).map(|(a, b)| (a - b) / 0.002).collect::<Vec<f64>>()
            };
            (0..joints).flat_map(of_joint).collect()
        };
        let (fit, reason) = fitted(&problem, &lm(), 0, &residuals);
        println!("grouped {grouped}: {reason:?} after {} evaluations", fit.evaluations());
        let values = &fit.best().unwrap().values;
        for joint in 0..joints {
            assert!((values[2 * joint] - delay(joint)).abs() < 1e-6, "{grouped} {values:?}");
            assert!((values[2 * joint + 1] - 0.02).abs() < 1e-6, "{grouped} {values:?}");
        }
    }
}

#[test]
fn the_huber_loss_bounds_the_influence_of_an_outlier() {
    let line = |x: &[f64]| -> Vec<f64> {
        let datum = |k: usize| 0.3 * k as f64 + if k == 15 { 500.0 } else { 0.0 };
        (0..20).map(|k| x[0] * k as f64 - datum(k)).collect()
    };
    let slope = |loss: Loss| {
        let space = Space::new(vec![Parameter::new("slope", -10.0, 10.0, 5.0)]).unwrap();
        let problem = Problem::new(space, vec![Block::new("all", 20)], loss).unwrap();
        let config = LmConfig { cost_tolerance: 1e-14, ..LmConfig::default() };
        let (fit, _) = fitted(&problem, &MethodConfig::Lm(config), 0, &line);
        fit.best().unwrap().values[0]
    };
    assert!((slope(Loss::Squared) - 0.3).abs() > 1.0);
    // The outlier adds a constant slope of 1.345 · 15, divided by Σ k² of the others.
    let others: f64 = (0..20).filter(|k| *k != 15).map(|k| f64::from(k * k)).sum();
    let expected = 0.3 + 1.345 * 15.0 / others;
    assert!((slope(Loss::Huber(1.345)) - expected).abs() < 1e-6);
}

#[test]
fn failures_near_the_optimum_and_before_it_do_not_end_the_fit() {
    // Beyond 0.7 in the first parameter the simulation fails; the optimum is just below.
    let problem = problem(&[[0.0, 1.0], [0.0, 1.0]], &[0.1, 0.1], 3);
    for differences in [Differences::Forward, Differences::Central] {
        let config = LmConfig { differences, ..LmConfig::default() };
        let mut fit = Fit::new(problem.clone(), &MethodConfig::Lm(config), 0).unwrap();
        while fit.finished().is_none() {
            let simulate = |x: &[f64]| match x[0] > 0.7 {
                true => None,
                false => Some(vec![x[0] - 0.699_999, (x[0] * x[1]).exp() - 1.3, 0.3 * x[1]]),
            };
            let evaluations: Vec<_> = fit.ask().iter().map(|c| simulate(&c.values)).collect();
            fit.tell(&evaluations).unwrap();
        }
        println!("{differences:?}: {:?} {:?}", fit.finished(), fit.best());
        assert!(fit.best().unwrap().cost < 0.02 && fit.evaluations() < 200);
    }
}

#[test]
fn a_start_that_fails_ends_the_fit() {
    let mut fit = Fit::new(problem(&[[0.0, 1.0]], &[0.5], 1), &lm(), 0).unwrap();
    fit.tell(&[None]).unwrap();
    assert_eq!(fit.finished(), Some(StopReason::Failures));
    assert!(fit.ask().is_empty() && fit.tell(&[]).is_err());
}

#[test]
fn a_parameter_without_influence_stays_where_it_is() {
    let problem = problem(&[[0.0, 1.0], [0.0, 1.0]], &[0.1, 0.6], 2);
    let (fit, _) = fitted(&problem, &lm(), 0, &|x: &[f64]| vec![x[0] - 0.4, 2.0 * x[0] - 0.8]);
    let values = &fit.best().unwrap().values;
    assert!((values[0] - 0.4).abs() < 1e-6 && values[1] == 0.6, "{values:?}");
}

#[test]
fn the_budget_ends_a_fit_after_the_batch_under_way() {
    let calls = Cell::new(0u64);
    let residuals = |x: &[f64]| {
        calls.set(calls.get() + 1);
        joints_residuals(x)
    };
    let config = LmConfig { max_evaluations: 5, ..LmConfig::default() };
    let mut fit = Fit::new(joints(false), &MethodConfig::Lm(config), 0).unwrap();
    assert_eq!(run(&mut fit, &residuals), StopReason::Budget);
    assert_eq!((fit.evaluations(), calls.get()), (41, 41));
}
