//! Each layer's backward pass against finite differences, one at a time.

use super::*;
use crate::{
    env::ObservationLayout,
    kernels::{at_every_level, norm_backward, norm_forward},
    random::Stream,
};

fn normal(stream: &mut Stream, len: usize) -> Vec<f32> {
    let mut values = vec![0.0; len];
    stream.fill_normal(&mut values);
    values
}

/// Central differences of `loss` in each of `values`, next to `gradient`.
fn check(name: &str, values: &[f32], gradient: &[f32], mut loss: impl FnMut(&[f32]) -> f64) {
    let mut moved = values.to_vec();
    for index in 0..values.len() {
        let step = 4e-3;
        moved[index] = values[index] + step;
        let above = loss(&moved);
        moved[index] = values[index] - step;
        let below = loss(&moved);
        moved[index] = values[index];
        let numeric = (above - below) / f64::from(2.0 * step);
        let exact = f64::from(gradient[index]);
        assert!(
            (numeric - exact).abs() < 3e-3 * exact.abs().max(1.0),
            "{name}[{index}]: {numeric} numerically, {exact}"
        );
    }
}

#[test]
fn norm_layer_gradients_match_finite_differences() {
    at_every_level(check_norm_layer);
}

fn check_norm_layer() {
    for (width, drops) in [(5, vec![]), (16, vec![3, 17, 40]), (37, vec![0, 36, 37, 73, 110])] {
        let (rows, keep_scale) = (3, if drops.is_empty() { 1.0 } else { 1.25 });
        let mut stream = Stream::new(width as u64, "norm");
        let input = normal(&mut stream, rows * width);
        let [bias, shift, scale] = [0, 1, 2].map(|_| normal(&mut stream, width));
        let weights = normal(&mut stream, rows * width);
        let run = |input: &[f32], bias: &[f32], scale: &[f32], shift: &[f32], kept: [&mut [f32]; 3]| -> f64 {
            let mut values = input.to_vec();
            let [normalised, slope, inverse_deviation] = kept;
            norm_forward(
                &mut values,
                bias,
                scale,
                shift,
                &drops,
                keep_scale,
                normalised,
                slope,
                inverse_deviation,
            );
            values.iter().zip(&weights).map(|(&v, &w)| f64::from(v) * f64::from(w)).sum()
        };
        let (mut normalised, mut slope) = (vec![0.0; rows * width], vec![0.0; rows * width]);
        let mut deviation = vec![0.0; rows];
        let kept = run(&input, &bias, &scale, &shift, [&mut normalised, &mut slope, &mut deviation]);
        let thrown = run(&input, &bias, &scale, &shift, [&mut [], &mut [], &mut []]);
        assert!((kept - thrown).abs() < 1e-4, "with and without keeping");

        let mut error = weights.clone();
        let mut gradients = [vec![9.0; width], vec![9.0; width], vec![9.0; width]];
        let backward = |error: &mut [f32], [bias, scale_gradient, shift]: [&mut [f32]; 3]| {
            norm_backward(
                error,
                &scale,
                &drops,
                keep_scale,
                &normalised,
                &slope,
                &deviation,
                bias,
                scale_gradient,
                shift,
            );
        };
        let [bias_gradient, scale_gradient, shift_gradient] = &mut gradients;
        backward(&mut error, [bias_gradient, scale_gradient, shift_gradient]);
        let mut without = weights.clone();
        backward(&mut without, [&mut [], &mut [], &mut []]);
        assert!(error.iter().zip(&without).all(|(a, b)| (a - b).abs() < 1e-5));
        check("input", &input, &error, |x| run(x, &bias, &scale, &shift, [&mut [], &mut [], &mut []]));
        check("bias", &bias, bias_gradient, |x| run(&input, x, &scale, &shift, [&mut [], &mut [], &mut []]));
        check("scale", &scale, scale_gradient, |x| {
            run(&input, &bias, x, &shift, [&mut [], &mut [], &mut []])
        });
        check("shift", &shift, shift_gradient, |x| {
            run(&input, &bias, &scale, x, [&mut [], &mut [], &mut []])
        });
    }
}

#[test]
fn network_gradients_match_finite_differences() {
    let layout = ObservationLayout { real: 3, binary: 9 };
    let rows = 4;
    for (normalised, hidden) in [(false, vec![7]), (false, vec![6, 5]), (true, vec![7]), (true, vec![6, 17])]
    {
        let network =
            Network::new(Shape { layout, extra: 2, hidden: hidden.clone(), outputs: 3, normalised });
        let mut stream = Stream::new(1, "network");
        let parameters = network.initialise(&mut stream);
        let rate = if normalised { 0.2 } else { 0.0 };
        let mut drops = vec![Vec::new(); hidden.len()];
        for (list, width) in drops.iter_mut().zip(&hidden) {
            stream.fill_drops(rate, rows * width, list);
        }
        let mut inputs = Inputs::new(layout, 2, rows);
        for _ in 0..rows {
            let mut row = normal(&mut stream, layout.len());
            row[layout.real..].iter_mut().for_each(|value| *value = if *value > 0.5 { 1.0 } else { 0.0 });
            inputs.push(&row);
        }
        let extra = normal(&mut stream, rows * 2);
        inputs.set_extra(&extra);
        let weights = normal(&mut stream, rows * 3);
        let mut workspace = network.workspace(rows, true, Arithmetic::F32);
        let mut loss = |parameters: &[f32], inputs: &Inputs| -> f64 {
            let output = network.forward(parameters, inputs, &drops, rate, true, &mut workspace);
            output.iter().zip(&weights).map(|(&v, &w)| f64::from(v) * f64::from(w)).sum()
        };
        loss(&parameters, &inputs);
        let mut gradient = vec![0.0; parameters.len()];
        let mut extra_gradient = vec![0.0; extra.len()];
        let mut backward_workspace = network.workspace(rows, true, Arithmetic::F32);
        for of in [GradientOf::Parameters(&mut gradient), GradientOf::Extra(&mut extra_gradient)] {
            network.forward(&parameters, &inputs, &drops, rate, true, &mut backward_workspace);
            network.backward(&parameters, &inputs, &drops, rate, &weights, of, &mut backward_workspace);
        }
        check("parameters", &parameters, &gradient, |parameters| loss(parameters, &inputs));
        check("extra", &extra, &extra_gradient, |extra| {
            let mut inputs = inputs.clone();
            inputs.set_extra(extra);
            loss(&parameters, &inputs)
        });
    }
}
