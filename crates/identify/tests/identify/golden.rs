//! Against SciPy (`scripts/golden_identify.py`).

use etude_identify::{Differences, LmConfig, MethodConfig, Problem};
use serde::Deserialize;

use crate::problems::{estimated, fitted, oscillator_residuals, problem, rosenbrock};

#[derive(Deserialize)]
struct Golden {
    least_squares: Vec<LeastSquares>,
}

#[derive(Deserialize)]
struct LeastSquares {
    name: String,
    #[serde(default)]
    times_secs: Vec<f64>,
    #[serde(default)]
    step_secs: f64,
    #[serde(default)]
    noise: f64,
    #[serde(default)]
    pull: f64,
    #[serde(default)]
    data: Vec<f64>,
    start: Vec<f64>,
    bounds: Vec<[f64; 2]>,
    optimum: Vec<f64>,
    cost: f64,
    covariance: Vec<Vec<f64>>,
}

fn golden() -> Golden {
    serde_json::from_str(include_str!("../golden/fits.json")).unwrap()
}

impl LeastSquares {
    fn residuals(&self, x: &[f64]) -> Vec<f64> {
        match self.name.as_str() {
            "decay" => {
                let at = |(t, datum): (&f64, &f64)| (x[0] * (-x[1] * t).exp() + x[2] - datum) / self.noise;
                self.times_secs.iter().zip(&self.data).map(at).collect()
            }
            "oscillator" => oscillator_residuals(x, &self.data, self.step_secs, self.noise),
            "rosenbrock" => {
                rosenbrock(x).into_iter().chain(x.iter().map(|v| self.pull * (v + 1.0))).collect()
            }
            other => panic!("no such problem: {other}"),
        }
    }

    fn problem(&self) -> Problem {
        problem(&self.bounds, &self.start, self.residuals(&self.start).len())
    }
}

#[test]
fn optima_are_those_of_scipy_with_bounds_active_and_not() {
    for case in golden().least_squares {
        for differences in [Differences::Central, Differences::Forward] {
            // The error of one-sided differences is about the step, relative to the curvature of
            // each residual.
            let (difference_step, tolerance) = match differences {
                Differences::Central => (1e-5, 1e-7),
                Differences::Forward => (1e-7, 1e-5),
            };
            let config =
                LmConfig { differences, difference_step, cost_tolerance: 1e-13, ..LmConfig::default() };
            let (fit, reason) =
                fitted(&case.problem(), &MethodConfig::Lm(config), 0, &|x: &[f64]| case.residuals(x));
            let best = fit.best().unwrap();
            println!("{} {differences:?}: {reason:?} after {}", case.name, fit.evaluations());
            assert!(fit.evaluations() < 250, "{}: {}", case.name, fit.evaluations());
            assert!((best.cost / case.cost - 1.0).abs() < 1e-9, "{}: {} {}", case.name, best.cost, case.cost);
            for ((value, expected), [low, high]) in best.values.iter().zip(&case.optimum).zip(&case.bounds) {
                assert!((value - expected).abs() < tolerance * (high - low), "{}: {best:?}", case.name);
            }
        }
    }
}

#[test]
fn covariances_are_those_of_scipys_jacobian() {
    for case in golden().least_squares {
        let problem = case.problem();
        let point = problem.space().to_normalised(&case.optimum);
        let estimate = estimated(&problem, &point, &|x: &[f64]| case.residuals(x));
        // SciPy's covariance assumes independent residuals.
        let block = &estimate.blocks[0];
        let white = block.samples as f64 / block.effective_samples;
        let ranges: Vec<f64> = case.bounds.iter().map(|[low, high]| high - low).collect();
        for (i, row) in case.covariance.iter().enumerate() {
            for (j, expected) in row.iter().enumerate() {
                let given = estimate.covariance[i][j] * ranges[i] * ranges[j] / white;
                let scale = (case.covariance[i][i] * case.covariance[j][j]).sqrt();
                assert!((given - expected).abs() < 1e-5 * scale, "{} {i} {j}: {given} {expected}", case.name);
            }
            let error = estimate.parameters[i].standard_error;
            assert!((error / (row[i] * white).sqrt() - 1.0).abs() < 1e-5);
        }
        assert!(estimate.weak.is_empty(), "{:?}", estimate.weak);
        assert!(
            (estimate.residual_variance / (2.0 * case.cost) * (block.samples - 3) as f64 - 1.0).abs() < 1e-9
        );
    }
}
