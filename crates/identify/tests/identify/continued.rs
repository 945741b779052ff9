//! A fit saved after any tell and resumed ends with the same result, bit for bit.

use etude_identify::{
    Block, BoConfig, Evaluation, Fit, LmConfig, Loss, MethodConfig, Parameter, Problem, Space,
};

fn methods() -> [MethodConfig; 2] {
    [MethodConfig::Lm(LmConfig::default()), MethodConfig::Bo(BoConfig { max_evaluations: 16 })]
}

/// Two joints with a delay each, in separate blocks; a corner of the space cannot be simulated.
fn problem() -> Problem {
    let joint = |j: usize| {
        let path = |name: &str| format!("joint.{j}.{name}");
        let delay = Parameter::new(&path("delay"), 0.0, 0.05, 0.02);
        let gain = Parameter::new(&path("gain"), 0.1, 10.0, 0.5).logarithmic();
        [delay, gain].map(|parameter| parameter.influencing([format!("joint.{j}")]))
    };
    let space = Space::new([joint(0), joint(1)].concat()).unwrap();
    let blocks = vec![Block::new("joint.0", 40), Block::new("joint.1", 40)];
    Problem::new(space, blocks, Loss::Huber(3.0)).unwrap()
}

fn simulate(x: &[f64]) -> Evaluation {
    if x[1] > 5.0 && x[3] > 5.0 {
        return None;
    }
    let wave = |delay: f64, gain: f64| (0..40).map(move |k| gain * (0.2 * k as f64 - 30.0 * delay).sin());
    let joint = |x: &[f64], truth: [f64; 2]| {
        let off = wave(x[0], x[1]).zip(wave(truth[0], truth[1]));
        off.enumerate().map(|(k, (a, b))| (a - b) / 0.1 + 0.3 * (k as f64).cos()).collect::<Vec<_>>()
    };
    Some([joint(&x[..2], [0.035, 2.0]), joint(&x[2..], [0.005, 0.7])].concat())
}

fn tell(fit: &mut Fit) {
    let evaluations: Vec<_> = fit.ask().iter().map(|candidate| simulate(&candidate.values)).collect();
    fit.tell(&evaluations).unwrap();
}

#[test]
fn a_fit_stopped_after_any_tell_ends_as_if_it_had_not() {
    for method in methods() {
        let mut straight = Fit::new(problem(), &method, 7).unwrap();
        let mut files = vec![serde_json::to_string(&straight).unwrap()];
        while straight.finished().is_none() {
            tell(&mut straight);
            files.push(serde_json::to_string(&straight).unwrap());
        }
        let end = files.last().unwrap();
        // One tell from each file gives the next file, so all of them lead to the same end.
        for (file, next) in files.iter().zip(&files[1..]) {
            let mut fit: Fit = serde_json::from_str(file).unwrap();
            tell(&mut fit);
            assert_eq!(serde_json::to_string(&fit).unwrap(), *next);
        }
        let ended: Fit = serde_json::from_str(end).unwrap();
        println!("{:?} after {} tells: {:?}", ended.finished(), files.len() - 1, ended.best());
        assert_eq!(ended.finished(), straight.finished());
        assert_eq!(ended.best(), straight.best());
        assert!(files.len() > 4);
    }
}

#[test]
fn another_seed_draws_other_candidates_and_the_same_seed_the_same() {
    for method in &methods()[1..] {
        let second = |seed| {
            let mut fit = Fit::new(problem(), method, seed).unwrap();
            tell(&mut fit);
            fit.ask()
        };
        assert_eq!(second(1), second(1));
        assert_ne!(second(1), second(2));
    }
}
