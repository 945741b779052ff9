//! CMA-ES where there is no reference to count against: bounds, restarts, failures.

use etude_identify::{CmaConfig, Evaluation, Fit, MethodConfig, Reason};

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
