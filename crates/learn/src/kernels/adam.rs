//! One pass over a network's contiguous parameters: Adam (Kingma and Ba 2015) and the Polyak
//! average of the target.
#![allow(unsafe_code)] // Calls of the copies that `kernel!` compiles for wider vectors.

use super::{fma, kernel};

const BETA_MEAN: f32 = 0.9;
const BETA_SQUARE: f32 = 0.999;
const EPSILON: f32 = 1e-8;

/// The factors of the `step`-th Adam step (counted from 1), bias corrections included.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AdamStep {
    rate: f32,
    root: f32,
}

impl AdamStep {
    pub(crate) fn new(learning_rate: f64, step: u64) -> Self {
        let exponent = i32::try_from(step).unwrap_or(i32::MAX);
        let mean = 1.0 - f64::from(BETA_MEAN).powi(exponent);
        let square = 1.0 - f64::from(BETA_SQUARE).powi(exponent);
        Self { rate: (learning_rate / mean) as f32, root: (1.0 / square.sqrt()) as f32 }
    }

    /// Moves one parameter; returns its new value.
    #[inline(always)]
    fn apply<const FMA: bool>(self, parameter: f32, gradient: f32, mean: &mut f32, square: &mut f32) -> f32 {
        *mean = fma::<FMA>(BETA_MEAN, *mean, (1.0 - BETA_MEAN) * gradient);
        *square = fma::<FMA>(BETA_SQUARE, *square, (1.0 - BETA_SQUARE) * (gradient * gradient));
        parameter - self.rate * *mean / fma::<FMA>(square.sqrt(), self.root, EPSILON)
    }
}

kernel! {
    /// One Adam step. All slices have the same length.
    fn adam(step: AdamStep, parameters: &mut [f32], gradient: &[f32], mean: &mut [f32], square: &mut [f32]) {
        for (((parameter, &gradient), mean), square) in parameters.iter_mut().zip(gradient).zip(mean).zip(square) {
            *parameter = step.apply::<FMA>(*parameter, gradient, mean, square);
        }
    }
}

kernel! {
    /// One Adam step, and `target += polyak * (new parameter - target)`. All slices have the same
    /// length.
    fn adam_polyak(
        step: AdamStep,
        polyak: f32,
        parameters: &mut [f32],
        gradient: &[f32],
        mean: &mut [f32],
        square: &mut [f32],
        target: &mut [f32],
    ) {
        let moments = mean.iter_mut().zip(square);
        for (((parameter, &gradient), (mean, square)), target) in
            parameters.iter_mut().zip(gradient).zip(moments).zip(target)
        {
            *parameter = step.apply::<FMA>(*parameter, gradient, mean, square);
            *target = fma::<FMA>(polyak, *parameter - *target, *target);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn follows_the_published_formula() {
        let (mut p, mut m, mut v, mut t) = ([0.5f32], [0.0f32], [0.0f32], [0.5f32]);
        let (mut pe, mut me, mut ve, mut te) = (0.5f64, 0.0f64, 0.0f64, 0.5f64);
        for step in 1..=50u64 {
            let g = (step as f64 * 0.7).sin();
            adam_polyak(AdamStep::new(3e-4, step), 0.005, &mut p, &[g as f32], &mut m, &mut v, &mut t);
            me = 0.9 * me + 0.1 * g;
            ve = 0.999 * ve + 0.001 * g * g;
            let mean = me / (1.0 - 0.9f64.powi(step as i32));
            let square = ve / (1.0 - 0.999f64.powi(step as i32));
            pe -= 3e-4 * mean / (square.sqrt() + 1e-8);
            te += 0.005 * (pe - te);
        }
        assert!((f64::from(p[0]) - pe).abs() < 1e-6 && (f64::from(t[0]) - te).abs() < 1e-6);
    }
}
