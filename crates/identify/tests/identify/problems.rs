//! Problems that several tests fit, and the loop that fits them.

use etude_identify::{
    Block, Candidate, Estimate, Evaluation, Fit, JacobianPlan, Linearisation, Loss, MethodConfig, Parameter,
    Problem, Space, StopReason,
};

/// Residuals of a candidate's physical values.
pub type Residuals<'a> = dyn Fn(&[f64]) -> Vec<f64> + 'a;

/// Continuous parameters p0, p1, … between these bounds, and one block.
pub fn problem(bounds: &[[f64; 2]], start: &[f64], samples: usize) -> Problem {
    let parameter = |(i, ([low, high], start)): (usize, (&[f64; 2], &f64))| {
        Parameter::new(&format!("p{i}"), *low, *high, *start)
    };
    let parameters = bounds.iter().zip(start).enumerate().map(parameter).collect();
    Problem::new(Space::new(parameters).unwrap(), vec![Block::new("all", samples)], Loss::Squared).unwrap()
}

pub fn evaluate(candidates: &[Candidate], residuals: &Residuals<'_>) -> Vec<Evaluation> {
    candidates.iter().map(|candidate| Some(residuals(&candidate.values))).collect()
}

/// Runs a fit to its end.
pub fn run(fit: &mut Fit, residuals: &Residuals<'_>) -> StopReason {
    while fit.finished().is_none() {
        let evaluations = evaluate(&fit.ask(), residuals);
        fit.tell(&evaluations).unwrap();
    }
    fit.finished().unwrap()
}

/// A fit run to its end.
pub fn fitted(
    problem: &Problem,
    method: &MethodConfig,
    seed: u64,
    residuals: &Residuals<'_>,
) -> (Fit, StopReason) {
    let mut fit = Fit::new(problem.clone(), method, seed).unwrap();
    let reason = run(&mut fit, residuals);
    (fit, reason)
}

pub fn linearised(problem: &Problem, point: &[f64], step: f64, residuals: &Residuals<'_>) -> Linearisation {
    let plan = JacobianPlan::new(problem, point, step);
    plan.finish(problem, &evaluate(&plan.candidates(problem), residuals)).unwrap()
}

pub fn estimated(problem: &Problem, point: &[f64], residuals: &Residuals<'_>) -> Estimate {
    Estimate::new(problem, &linearised(problem, point, 1e-5, residuals)).unwrap()
}

/// Positions of a damped oscillator (stiffness, damping, cubic stiffness) released at one, by the
/// classical Runge–Kutta method.
pub fn oscillate(values: &[f64], step_secs: f64, steps: usize) -> Vec<f64> {
    let slope = |p: f64, v: f64| (v, -values[0] * p - values[1] * v - values[2] * p * p * p);
    let (mut p, mut v, h) = (1.0, 0.0, step_secs);
    let mut positions = Vec::with_capacity(steps);
    for _ in 0..steps {
        let a = slope(p, v);
        let b = slope(p + 0.5 * h * a.0, v + 0.5 * h * a.1);
        let c = slope(p + 0.5 * h * b.0, v + 0.5 * h * b.1);
        let d = slope(p + h * c.0, v + h * c.1);
        p += h / 6.0 * (a.0 + 2.0 * b.0 + 2.0 * c.0 + d.0);
        v += h / 6.0 * (a.1 + 2.0 * b.1 + 2.0 * c.1 + d.1);
        positions.push(p);
    }
    positions
}

/// Residuals of the oscillator with these parameters against recorded positions.
pub fn oscillator_residuals(values: &[f64], data: &[f64], step_secs: f64, noise: f64) -> Vec<f64> {
    let positions = oscillate(values, step_secs, data.len());
    positions.iter().zip(data).map(|(position, datum)| (position - datum) / noise).collect()
}

/// Rosenbrock's function as residuals.
pub fn rosenbrock(values: &[f64]) -> Vec<f64> {
    let steep = values.windows(2).map(|pair| 10.0 * (pair[1] - pair[0] * pair[0]));
    steep.chain(values[..values.len() - 1].iter().map(|x| 1.0 - x)).collect()
}
