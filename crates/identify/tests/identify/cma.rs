//! CMA-ES where there is no reference to count against: bounds, grids, restarts, failures.

use etude_identify::{
    Block, CmaConfig, Evaluation, Fit, Loss, MethodConfig, Parameter, Problem, Reason, Space,
};

use crate::problems::{fitted, problem};

fn cma(config: CmaConfig) -> MethodConfig {
    MethodConfig::Cma(config)
}

#[test]
fn an_optimum_on_two_bounds_is_found() {
    let problem = problem(&[[0.0, 1.0], [0.0, 1.0], [0.0, 1.0]], &[0.5, 0.5, 0.5], 3);
    let residuals = |x: &[f64]| vec![x[0] + 0.2, x[1] - 1.3, x[2] - 0.4 + 0.3 * x[0]];
    let (fit, reason) = fitted(&problem, &cma(CmaConfig::default()), 3, &residuals);
    let values = &fit.best().unwrap().values;
    assert!(values[0] < 1e-4 && values[1] > 1.0 - 1e-4 && (values[2] - 0.4).abs() < 1e-3, "{values:?}");
    assert!(matches!(reason, Reason::Spread | Reason::Cost));
}

#[test]
fn a_delay_on_a_grid_is_found_beside_a_continuous_parameter() {
    let delay = Parameter::new("delay", 0.0, 0.1, 0.0).stepped(0.005);
    let gain = Parameter::new("gain", 0.1, 10.0, 0.2).logarithmic();
    let space = Space::new(vec![delay, gain]).unwrap();
    let problem = Problem::new(space, vec![Block::new("all", 100)], Loss::Squared).unwrap();
    let wave = |delay: f64, gain: f64| (0..100).map(move |k| gain * (0.05 * k as f64 - 20.0 * delay).sin());
    let residuals =
        |x: &[f64]| wave(x[0], x[1]).zip(wave(0.035, 3.0)).map(|(a, b)| (a - b) / 0.01).collect::<Vec<_>>();
    for seed in 0..5 {
        let (fit, _) = fitted(&problem, &cma(CmaConfig::default()), seed, &residuals);
        let values = &fit.best().unwrap().values;
        assert!((values[0] - 0.035).abs() < 1e-9 && (values[1] - 3.0).abs() < 1e-3, "{values:?}");
    }
}

#[test]
fn restarts_leave_a_wrong_valley() {
    // A wide valley around 0.2 and a deeper, narrower one around 0.85.
    let problem = problem(&[[0.0, 1.0], [0.0, 1.0]], &[0.2, 0.2], 1);
    let away = |x: &[f64], c: f64| (x[0] - c).powi(2) + (x[1] - c).powi(2);
    let residuals = |x: &[f64]| vec![(0.5 + away(x, 0.2)).min(30.0 * away(x, 0.85)).sqrt()];
    let depth = |restarts, seed| {
        let config = CmaConfig { restarts, initial_spread: 0.1, ..CmaConfig::default() };
        fitted(&problem, &cma(config), seed, &residuals).0.best().unwrap().cost
    };
    let found = |restarts| (0..5).filter(|&seed| depth(restarts, seed) < 1e-3).count();
    assert_eq!((found(0), found(6)), (0, 5));
}

#[test]
fn where_nothing_can_be_evaluated_it_gives_up() {
    let mut fit = Fit::new(problem(&[[0.0, 1.0]], &[0.5], 1), &cma(CmaConfig::default()), 0).unwrap();
    while fit.finished().is_none() {
        let failed = vec![Evaluation::Failed("diverged".into()); fit.ask().len()];
        fit.tell(&failed).unwrap();
    }
    assert_eq!(fit.finished(), Some(Reason::Failures));
    assert!(fit.best().is_none() && fit.failures() == fit.evaluations());
}
