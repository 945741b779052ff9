//! Bayesian optimisation on the field's usual function, and its limits.

use etude_identify::{BoConfig, Fit, MethodConfig, StopReason};

use crate::problems::{evaluate, fitted, problem};

/// Least cost of Branin's function (Dixon and Szegő 1978).
const LEAST: f64 = 0.397_887;

fn branin(x: &[f64]) -> Vec<f64> {
    let (a, b) = (x[0], x[1]);
    let pi = std::f64::consts::PI;
    let valley = b - 5.1 / (4.0 * pi * pi) * a * a + 5.0 / pi * a - 6.0;
    let cost = valley * valley + 10.0 * (1.0 - 1.0 / (8.0 * pi)) * a.cos() + 10.0;
    vec![(2.0 * cost).sqrt()]
}

#[test]
fn branins_least_cost_is_found_in_forty_evaluations() {
    let problem = problem(&[[-5.0, 10.0], [0.0, 15.0]], &[0.0, 10.0], 1);
    for seed in 0..5 {
        let config = BoConfig { max_evaluations: 40 };
        let (fit, reason) = fitted(&problem, &MethodConfig::Bo(config), seed, &branin);
        println!("{seed}: {:?}", fit.best());
        assert_eq!((reason, fit.evaluations()), (StopReason::Budget, 40));
        assert!(fit.best().unwrap().cost < LEAST + 0.01, "{seed}: {:?}", fit.best());
    }
}

#[test]
fn threads_change_nothing() {
    let problem = problem(&[[-5.0, 10.0], [0.0, 15.0]], &[0.0, 10.0], 1);
    let trace = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let config = BoConfig { max_evaluations: 15 };
            let mut fit = Fit::new(problem.clone(), &MethodConfig::Bo(config), 9).unwrap();
            let mut asked = Vec::new();
            while fit.finished().is_none() {
                let batch = fit.ask();
                fit.tell(&evaluate(&batch, &branin)).unwrap();
                asked.extend(batch);
            }
            asked
        })
    };
    let alone = trace(1);
    assert_eq!(alone.len(), 15);
    assert_eq!(alone, trace(4));
}

#[test]
fn twelve_parameters_are_not_too_many() {
    let many = |n: usize| problem(&vec![[0.0, 1.0]; n], &vec![0.5; n], 1);
    let config = BoConfig { max_evaluations: 28 };
    let bowl = |x: &[f64]| vec![1.0 + x.iter().map(|v| (v - 0.3).powi(2)).sum::<f64>()];
    let (fit, _) = fitted(&many(12), &MethodConfig::Bo(config), 0, &bowl);
    assert_eq!(fit.evaluations(), 28);
}

#[test]
fn a_fit_without_any_successful_evaluation_ends() {
    let config = MethodConfig::Bo(BoConfig::default());
    let mut fit = Fit::new(problem(&[[0.0, 1.0]], &[0.5], 1), &config, 0).unwrap();
    while fit.finished().is_none() {
        let failed = vec![Some(vec![f64::NAN]); fit.ask().len()];
        fit.tell(&failed).unwrap();
    }
    assert_eq!(fit.finished(), Some(StopReason::Failures));
}
