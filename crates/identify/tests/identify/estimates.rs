//! Coverage of the intervals, and what is not identifiable.

use etude_identify::{
    Block, Bound, Estimate, Evaluation, Fit, JacobianPlan, Linearisation, LmConfig, Loss, MethodConfig,
    Parameter, Problem, Space, integrated_autocorrelation,
};
use rand::{Rng as _, SeedableRng as _};
use rand_pcg::Pcg64;

use crate::problems::{estimated, linearised, oscillate, oscillator_residuals, problem, run};

const STEP_SECS: f64 = 0.02;
const SAMPLES: usize = 200;
const NOISE: f64 = 0.02;
const TRUTH: [f64; 3] = [25.0, 0.8, 6.0];
const BOUNDS: [[f64; 2]; 3] = [[5.0, 60.0], [0.05, 5.0], [0.0, 20.0]];

fn normal(random: &mut Pcg64) -> f64 {
    let mut uniform = || (random.next_u64() as f64 + 0.5) / 2f64.powi(64);
    (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos()
}

/// Noise of variance one whose neighbours correlate by `persistence`.
fn noise(random: &mut Pcg64, samples: usize, persistence: f64) -> Vec<f64> {
    let mut last = normal(random);
    let mut next = || {
        last = persistence * last + (1.0 - persistence * persistence).sqrt() * normal(random);
        last
    };
    (0..samples).map(|_| next()).collect()
}

/// Share of the 95 % intervals of `fits` fits that hold the truth, over all parameters.
fn coverage(fits: u64, persistence: f64, loss: Loss, outliers: bool) -> f64 {
    let clean = oscillate(&TRUTH, STEP_SECS, SAMPLES);
    let mut held = 0;
    for seed in 0..fits {
        let mut random = Pcg64::seed_from_u64(seed);
        let noise = noise(&mut random, SAMPLES, persistence);
        let mut data: Vec<f64> =
            clean.iter().zip(noise).map(|(position, noise)| position + NOISE * noise).collect();
        if outliers {
            (0..SAMPLES).step_by(23).for_each(|k| data[k] += 20.0 * NOISE * normal(&mut random));
        }
        let parameters =
            (0..3).map(|i| Parameter::new(&format!("p{i}"), BOUNDS[i][0], BOUNDS[i][1], TRUTH[i]));
        let space = Space::new(parameters.collect()).unwrap();
        let problem = Problem::new(space, vec![Block::new("position", SAMPLES)], loss).unwrap();
        let residuals = |x: &[f64]| oscillator_residuals(x, &data, STEP_SECS, NOISE);
        let mut fit = Fit::new(problem.clone(), &MethodConfig::Lm(LmConfig::default()), 0).unwrap();
        run(&mut fit, &residuals);
        let estimate = estimated(&problem, &fit.best().unwrap().point, &residuals);
        held += estimate
            .parameters
            .iter()
            .zip(TRUTH)
            .filter(|(p, t)| p.interval[0] <= *t && *t <= p.interval[1])
            .count();
    }
    held as f64 / (3 * fits) as f64
}

#[test]
fn intervals_hold_the_truth_95_times_in_a_hundred() {
    let share = coverage(200, 0.0, Loss::Squared, false);
    println!("white: {share}");
    assert!((0.90..=0.98).contains(&share), "{share}");
}

#[test]
fn correlated_noise_widens_the_intervals() {
    // Without the correction, coverage would be near that of an interval three times too narrow,
    // about 0.5.
    let share = coverage(200, 0.8, Loss::Squared, false);
    println!("persistence 0.8: {share}");
    assert!((0.88..=1.0).contains(&share), "{share}");
}

#[test]
fn intervals_hold_with_outliers_under_the_huber_loss() {
    let share = coverage(200, 0.0, Loss::Huber(1.345), true);
    println!("outliers: {share}");
    assert!((0.90..=0.99).contains(&share), "{share}");
}

#[test]
fn autocorrelation_time_is_that_of_the_process() {
    for (persistence, expected) in [(0.0, 1.0), (0.5, 3.0), (0.9, 19.0)] {
        let mut random = Pcg64::seed_from_u64(4);
        let time = integrated_autocorrelation(&noise(&mut random, 100_000, persistence));
        assert!((time / expected - 1.0).abs() < 0.1, "{persistence}: {time}");
    }
    let alternating: Vec<f64> = (0..100).map(|k| if k % 2 == 0 { 1.0 } else { -1.0 }).collect();
    for odd in [&[][..], &[1.0, 2.0], &[0.0; 50], &[f64::NAN; 50], &alternating] {
        assert_eq!(integrated_autocorrelation(odd), 1.0);
    }
    assert!(integrated_autocorrelation(&[1e-3; 100]) > 40.0);
}

#[test]
fn weak_directions_name_their_parameters_and_no_others() {
    // Only the sum of the first two matters, the third is identifiable, the fourth has no
    // influence.
    let problem = problem(&[[0.0, 1.0]; 4], &[0.3, 0.4, 0.5, 0.6], 100);
    let residuals = |x: &[f64]| -> Vec<f64> {
        let wiggle = |k: usize| 0.9 * (1.7 * k as f64).sin();
        (0..100)
            .map(|k| 50.0 * (x[0] + x[1]) - 35.0 + (k % 7) as f64 * (x[2] - 0.5) * 20.0 + wiggle(k))
            .collect()
    };
    let estimate = estimated(&problem, &problem.space().start(), &residuals);
    let told: Vec<bool> = estimate.parameters.iter().map(|p| p.is_identifiable).collect();
    assert_eq!(told, [false, false, true, false]);
    assert_eq!(estimate.weak.len(), 2);
    let pair = estimate.weak.iter().find(|w| w.parts.len() == 2).unwrap();
    let (a, b) = (&pair.parts[0], &pair.parts[1]);
    assert!((a.1 + b.1).abs() < 1e-3 && (a.1.abs() - 0.5f64.sqrt()).abs() < 1e-3, "{pair:?}");
    assert!(estimate.correlation[0][1] < -0.999);
    assert_eq!(estimate.parameters[3].interval, [0.0, 1.0]);
    assert!(estimate.condition > 1e6);
    let text = serde_json::to_string(&estimate).unwrap();
    assert_eq!(serde_json::from_str::<Estimate>(&text).unwrap(), estimate);
}

#[test]
fn intervals_follow_the_scale_and_end_at_the_bounds() {
    let log = Parameter::new("log", 0.01, 100.0, 1.0).logarithmic();
    let low = Parameter::new("low", 0.0, 1.0, 0.0);
    let space = Space::new(vec![log, low]).unwrap();
    let problem = Problem::new(space, vec![Block::new("a", 50), Block::new("b", 50)], Loss::Squared).unwrap();
    let sign = |k: usize| if k.is_multiple_of(2) { 1.0 } else { -1.0 };
    let residuals = |x: &[f64]| -> Vec<f64> {
        (0..50)
            .map(|k| 3.0 * x[0].ln() + sign(k))
            .chain((0..50).map(|k| 10.0 * x[1] + 2.0 * sign(k)))
            .collect()
    };
    let estimate = estimated(&problem, &problem.space().start(), &residuals);
    let [log, low] = [&estimate.parameters[0], &estimate.parameters[1]];
    assert!((log.interval[0] * log.interval[1] - 1.0).abs() < 1e-9, "{log:?}");
    // Each block has its own noise, of one and two standard deviations; 98 of 100 degrees of
    // freedom are left.
    let expected = |deviation: f64, slope: f64| deviation / slope * (100.0 / 98.0f64).sqrt() / 50f64.sqrt();
    assert!((log.standard_error - expected(1.0, 3.0)).abs() < 1e-6, "{log:?}");
    assert!((low.standard_error - expected(2.0, 10.0)).abs() < 1e-6, "{low:?}");
    assert_eq!((low.at_bound, low.interval[0], log.at_bound), (Some(Bound::Low), 0.0, None));
    assert!((estimate.blocks[1].rms - 2.0).abs() < 1e-12 && estimate.blocks[1].effective_samples == 50.0);
}

#[test]
fn invalid_estimates_are_refused() {
    let small = problem(&[[0.0, 1.0]; 2], &[0.5; 2], 2);
    let identity = |x: &[f64]| x.to_vec();
    let linear = linearised(&small, &[0.5, 0.5], 1e-5, &identity);
    let said =
        |problem: &Problem, linear: &Linearisation| Estimate::new(problem, linear).unwrap_err().to_string();
    assert!(said(&small, &linear).starts_with("2 residuals cannot identify 2 parameters"));
    let huge = |x: &[f64]| vec![1e100 * (2.0 * x[0] - 1.0), 1e100 * (2.0 * x[1] - 1.0), 1e100];
    let three = problem(&[[0.0, 1.0]; 2], &[0.5; 2], 3);
    let linear = linearised(&three, &[0.3, 0.6], 1e-5, &huge);
    assert!(said(&three, &linear).contains("too large to square"));

    let plan = JacobianPlan::new(&three, &[0.5, 1.0], 1e-5);
    assert_eq!(plan.candidates(&three).len(), 1 + 2 + 1);
    let said = |evaluations: &[Evaluation]| plan.finish(&three, evaluations).unwrap_err().to_string();
    assert!(said(&[]).starts_with("0 evaluations were given for 4 candidates"));
    let mut evaluations = vec![Some(vec![0.0; 3]); 4];
    evaluations[3] = None;
    assert!(said(&evaluations).contains("along `p1`"));
    evaluations[0] = Some(vec![f64::NAN; 3]);
    assert!(said(&evaluations).starts_with("the point could not be evaluated"));
}
