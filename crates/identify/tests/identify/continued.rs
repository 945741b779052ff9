//! Stop after any tell, write, read, go on: the same end, bit for bit. And files that no fit has written.

use etude_identify::{
    Block, BoConfig, Evaluation, Fit, LmConfig, Loss, MethodConfig, Parameter, Problem, Space,
};
use proptest::prelude::*;

fn methods() -> [MethodConfig; 2] {
    [
        MethodConfig::Lm(LmConfig::default()),
        MethodConfig::Bo(BoConfig { max_evaluations: 16, batch: 2, ..BoConfig::default() }),
    ]
}

/// Two joints with a delay each, told apart; a corner of the space cannot be simulated.
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
        return Evaluation::Failed("diverged".into());
    }
    let wave = |delay: f64, gain: f64| (0..40).map(move |k| gain * (0.2 * k as f64 - 30.0 * delay).sin());
    let joint = |x: &[f64], truth: [f64; 2]| {
        let off = wave(x[0], x[1]).zip(wave(truth[0], truth[1]));
        off.enumerate().map(|(k, (a, b))| (a - b) / 0.1 + 0.3 * (k as f64).cos()).collect::<Vec<_>>()
    };
    Evaluation::Residuals([joint(&x[..2], [0.035, 2.0]), joint(&x[2..], [0.005, 0.7])].concat())
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
        // Each file's next is the next file: so every one of them leads to the same end.
        for (file, next) in files.iter().zip(&files[1..]) {
            let mut fit: Fit = serde_json::from_str(file).unwrap();
            tell(&mut fit);
            assert_eq!(serde_json::to_string(&fit).unwrap(), *next);
        }
        let ended: Fit = serde_json::from_str(end).unwrap();
        println!("{:?} after {} tells: {:?}", ended.finished(), files.len() - 1, ended.best());
        assert_eq!(ended.finished(), straight.finished());
        assert_eq!(ended.best(), straight.best());
        assert!(straight.failures() < straight.evaluations() && files.len() > 4);
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

fn saved(method: usize) -> &'static [String; 3] {
    static FILES: std::sync::OnceLock<Vec<[String; 3]>> = std::sync::OnceLock::new();
    let files = FILES.get_or_init(|| {
        methods()
            .iter()
            .map(|method| {
                let mut fit = Fit::new(problem(), method, 3).unwrap();
                std::array::from_fn(|_| {
                    tell(&mut fit);
                    serde_json::to_string(&fit).unwrap()
                })
            })
            .collect()
    });
    &files[method]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    /// A number somewhere in a file is changed or cut out: it is refused, or goes on inside the bounds.
    #[test]
    fn a_damaged_file_is_refused_or_goes_on_inside_the_bounds(
        method in 0..2usize, tells in 0..3usize, place in 0.0..1.0f64, kind in 0..5usize,
    ) {
        let text = &saved(method)[tells];
        let numbers: Vec<(usize, &str)> = text
            .split(|c: char| !(c.is_ascii_digit() || ".-e".contains(c)))
            .filter(|token| token.parse::<f64>().is_ok())
            .map(|token| (token.as_ptr() as usize - text.as_ptr() as usize, token))
            .collect();
        let (start, token) = numbers[(place * numbers.len() as f64) as usize];
        let with = ["-1", "1e300", "0", "7", "2.5"][kind];
        let damaged = format!("{}{with}{}", &text[..start], &text[start + token.len()..]);
        if let Ok(mut fit) = serde_json::from_str::<Fit>(&damaged) {
            for _ in 0..2 {
                // A file may ask for more than a test wants to evaluate, or be of another problem than ours.
                let batch = fit.ask();
                if batch.len() > 1000 || fit.problem() != &problem() || fit.finished().is_some() {
                    break;
                }
                prop_assert!(batch.iter().all(|c| c.point.iter().all(|u| (0.0..=1.0).contains(u))));
                tell(&mut fit);
            }
        }
    }
}
