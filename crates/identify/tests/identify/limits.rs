//! Properties of all problems: candidates inside the bounds, finite numbers, clear refusals.

use etude_identify::{
    Block, BoConfig, Evaluation, Fit, LmConfig, Loss, MethodConfig, Parameter, Problem, Space,
};
use proptest::prelude::*;

use crate::problems::problem;

fn parameter() -> impl Strategy<Value = Parameter> {
    let bounds = (-1e3..1e3f64, 1e-3..1e3f64, 0.0..=1.0f64);
    (bounds, prop::bool::ANY).prop_map(|((low, width, at), log)| {
        let low = if log { low.abs() + 1e-6 } else { low };
        let high = low + width;
        let parameter = Parameter::new("p", low, high, (low + at * width).clamp(low, high));
        if log { parameter.logarithmic() } else { parameter }
    })
}

fn space() -> impl Strategy<Value = Space> {
    prop::collection::vec(parameter(), 1..5).prop_map(|mut parameters| {
        parameters.iter_mut().enumerate().for_each(|(i, p)| p.path = format!("p{i}"));
        Space::new(parameters).unwrap()
    })
}

fn method() -> impl Strategy<Value = MethodConfig> {
    prop_oneof![
        4 => Just(MethodConfig::Lm(LmConfig { difference_step: 1e-3, ..LmConfig::default() })),
        1 => Just(MethodConfig::Bo(BoConfig::default())),
    ]
}

/// Residuals that are smooth, rough, NaN or missing, depending on the point.
fn hostile(point: &[f64], seed: u64) -> Evaluation {
    let mix = point
        .iter()
        .fold(seed, |mix, u| (mix ^ u.to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29));
    let sum: f64 = point.iter().sum();
    match mix % 11 {
        0 => None,
        1 => Some(vec![f64::NAN, sum, 1.0]),
        2 => Some(vec![f64::NEG_INFINITY, sum, -1e308]),
        3 => Some(vec![1e99, -1e99, 1e99]),
        _ => Some(vec![1e6 * (sum - 0.3), (mix % 1000) as f64, sum * sum]),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(120))]

    #[test]
    fn candidates_lie_inside_and_a_nan_is_never_best(
        space in space(), method in method(), seed in any::<u64>(),
    ) {
        let problem = Problem::new(space.clone(), vec![Block::new("all", 3)], Loss::Huber(10.0)).unwrap();
        let mut fit = Fit::new(problem.clone(), &method, seed).unwrap();
        let mut lowest = f64::INFINITY;
        for _ in 0..8 {
            let batch = fit.ask();
            prop_assert_eq!(batch.is_empty(), fit.finished().is_some());
            prop_assert_eq!(fit.max_evaluations_left() == 0, fit.finished().is_some());
            if batch.is_empty() {
                break;
            }
            let mut told = Vec::new();
            for candidate in &batch {
                let numbers = candidate.values.iter().zip(&candidate.point);
                for (p, (value, u)) in space.parameters().iter().zip(numbers) {
                    prop_assert!((p.low..=p.high).contains(value) && (0.0..=1.0).contains(u));
                }
                let evaluation = hostile(&candidate.point, seed);
                if let Some(residuals) = &evaluation
                    && residuals.iter().all(|r| r.abs() <= 1e100)
                {
                    lowest = lowest.min(problem.cost(residuals));
                }
                told.push(evaluation);
            }
            fit.tell(&told).unwrap();
            prop_assert_eq!(fit.best().map_or(f64::INFINITY, |best| best.cost), lowest);
        }
    }

    #[test]
    fn normalisation_is_inverted(space in space(), shares in prop::collection::vec(-0.5..1.5f64, 5)) {
        let values = space.to_physical(&shares[..space.len()]);
        let point: Vec<f64> = shares[..space.len()].iter().map(|share| share.clamp(0.0, 1.0)).collect();
        for ((a, b), p) in space.to_normalised(&values).iter().zip(&point).zip(space.parameters()) {
            prop_assert!((a - b).abs() < 1e-9, "{a} {b} {p:?}");
        }
        prop_assert_eq!(space.to_physical(&vec![f64::NAN; space.len()]).len(), space.len());
    }
}

#[test]
fn a_logarithmic_scale_goes_by_ratios() {
    let space = Space::new(vec![Parameter::new("p", 0.01, 100.0, 1.0).logarithmic()]).unwrap();
    assert!((space.start()[0] - 0.5).abs() < 1e-12);
    assert!((space.to_physical(&[0.75])[0] - 10.0).abs() < 1e-9);
}

#[test]
fn what_cannot_be_fitted_is_refused_with_the_reason() {
    let p = |low, high, start| Parameter::new("joint.index_1.delay", low, high, start);
    let refused = |parameters: Vec<Parameter>| Space::new(parameters).unwrap_err().to_string();
    assert!(refused(vec![]).contains("no parameter"));
    for wrong in [p(1.0, 0.0, 0.5), p(0.0, f64::INFINITY, 0.5), p(0.0, 1.0, f64::NAN)] {
        assert!(refused(vec![wrong]).contains("not in order"));
    }
    assert!(refused(vec![p(0.0, 1.0, 0.5).logarithmic()]).contains("logarithmic scale"));
    for blocks in [vec![], vec![Block::new("thumb", 0)]] {
        let space = Space::new(vec![p(0.0, 1.0, 0.5)]).unwrap();
        let said = Problem::new(space, blocks, Loss::Squared).unwrap_err().to_string();
        assert!(said.contains("no residual"), "{said}");
    }
}

#[test]
fn the_number_of_evaluations_is_checked() {
    let fit = |method: MethodConfig| Fit::new(problem(&[[0.0, 1.0]], &[0.5], 1), &method, 0);
    let lm = |max_evaluations| fit(MethodConfig::Lm(LmConfig { max_evaluations, ..LmConfig::default() }));
    let bo = |max_evaluations| fit(MethodConfig::Bo(BoConfig { max_evaluations }));
    assert!(lm(0).is_err() && lm(1).is_ok() && lm(u64::MAX).is_ok());
    assert!(bo(0).is_err() && bo(2000).is_ok());
    let said = bo(2001).unwrap_err().to_string();
    assert!(said.contains("from 1 to 2000"), "{said}");
}

#[test]
fn evaluations_that_do_not_answer_the_batch_change_nothing() {
    let mut fit =
        Fit::new(problem(&[[0.0, 1.0]], &[0.5], 2), &MethodConfig::Bo(BoConfig::default()), 0).unwrap();
    let batch = fit.ask();
    assert!(fit.tell(&[]).unwrap_err().to_string().starts_with("0 evaluations were given"));
    assert_eq!((fit.evaluations(), fit.best()), (0, None));
    assert_eq!(fit.ask(), batch);
}
