//! Warm starts: what comes over, what does not, and that what does not fit leaves nothing behind.

use std::{fs, path::Path};

use super::{
    super::{checkpoint::Origin, *},
    toy::{Tracking, Watch, assert_same_files, config, droq, files, inputs},
};
use crate::{
    env::{ObservationLayout, StepBatch},
    files::FileError,
    random::Stream,
};

/// A training of 800 steps to begin with.
fn source() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    Trainer::start(folder.path(), &droq(), &config(800), inputs(), None).unwrap().run(&mut ()).unwrap();
    folder
}

/// Actions of a policy for a few observations.
fn actions(policy: &mut Policy) -> Vec<f32> {
    let observations: Vec<f32> =
        (0..20).flat_map(|i| [i as f32 / 10.0 - 1.0, 1.0, 0.0, (i % 2) as f32, 0.0]).collect();
    let mut actions = vec![0.0; 20];
    policy.act(&observations, &mut actions);
    actions
}

#[test]
fn at_step_0_the_policy_is_the_sources_and_the_optimiser_is_new() {
    let source = source();
    for (name, warm, origin) in [
        ("policy-last.safetensors", WarmStart::from_run(source.path()).unwrap(), Origin::Run),
        (
            "policy-best.safetensors",
            { WarmStart::from_policy(&source.path().join("policy-best.safetensors")).unwrap() },
            Origin::Policy,
        ),
    ] {
        assert_eq!(warm.notes()["toy"], 1);
        let mut theirs = Policy::load(&source.path().join(name)).unwrap();
        let folder = tempfile::tempdir().unwrap();
        // Other draws and physics would be other seeds here.
        let config = TrainerConfig { seed: 77, ..config(400) };
        let mut trainer = Trainer::start(folder.path(), &droq(), &config, inputs(), Some(&warm)).unwrap();
        assert_eq!((trainer.step(), trainer.droq.updates(), trainer.replay.len()), (0, 0, 0));
        assert_eq!(trainer.origin, origin);
        assert_eq!(actions(&mut trainer.policy()), actions(&mut theirs), "{name}");
        let saved = Policy::load(&folder.path().join("policy-last.safetensors")).unwrap();
        assert_eq!(actions(&mut saved.clone()), actions(&mut theirs), "{name}");

        // Tensor by tensor: as in the source, or as in a learner that has not learned anything.
        let mut theirs = Trainer::resume(source.path(), &droq(), &self::config(800), inputs()).unwrap();
        let mut fresh = Trainer::learner(&droq(), &config, &*trainer.collector.environment);
        let [ours, theirs, fresh] = [&mut trainer.droq, &mut theirs.droq, &mut fresh].map(Droq::tensors);
        for ((ours, theirs), fresh) in ours.iter().zip(&theirs).zip(&fresh) {
            let kind = ours.name.as_str();
            if kind.contains(".adam_") {
                assert!(ours.values.iter().all(|value| *value == 0.0), "{kind}");
            } else if kind == "temperature.log" {
                let settled = fresh.values[0] + 0.05f32.ln();
                let value = if origin == Origin::Run { theirs.values[0] } else { settled };
                assert_eq!(ours.values, [value, 0.0, 0.0]);
            } else if origin == Origin::Run {
                assert_eq!(ours.values, theirs.values, "{kind}");
            } else if kind.starts_with("critic") {
                assert_eq!(ours.values, fresh.values, "{kind}");
            }
        }
        drop(trainer);
    }
}

#[test]
fn what_was_taken_over_is_evaluated_first_and_acts_in_the_warm_up() {
    let source = source();
    let warm = WarmStart::from_run(source.path()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let mut watch = Watch::default();
    let mut trainer = Trainer::start(folder.path(), &droq(), &config(100), inputs(), Some(&warm)).unwrap();
    trainer.run(&mut watch).unwrap();
    assert_eq!(trainer.droq.updates(), 0, "all of it is the warm-up");
    let first = &watch.evaluations[0];
    assert_eq!((first.step, first.best), (0, true));
    let mut policy = Policy::load(&source.path().join("policy-last.safetensors")).unwrap();
    let theirs = super::toy::Grid.evaluate(&mut |observations, actions| policy.act(observations, actions));
    assert_eq!(first.scores[0], theirs[0]);
    // Random actions are 0.6 off the target on average; those of a policy that has learned are not.
    let distance = |trainer: &mut Trainer| {
        let mut batch = crate::replay::Batch::new(trainer.collector.environment.layout(), 1, 500);
        let horizon = crate::replay::Horizon { steps: 1, discount: 0.5 };
        trainer.replay.sample(&mut Stream::new(1, "test"), 500, horizon, &mut batch);
        1.0 - f64::from(batch.reward.iter().sum::<f32>()) / 500.0
    };
    let other = tempfile::tempdir().unwrap();
    let mut fresh = Trainer::start(other.path(), &droq(), &config(100), inputs(), None).unwrap();
    fresh.run(&mut ()).unwrap();
    let (warm, fresh) = (distance(&mut trainer), distance(&mut fresh));
    assert!(warm < 0.6 * fresh, "{warm} and {fresh}");
}

/// New critics first learn to judge the old actor; then it learns, and better than it was.
#[test]
fn an_actor_without_critics_waits_for_them() {
    let source = source();
    let warm = WarmStart::from_policy(&source.path().join("policy-last.safetensors")).unwrap();
    let whole = WarmStart::from_run(source.path()).unwrap();
    assert_eq!([warm.origin(), whole.origin()], [Origin::Policy, Origin::Run]);
    let folder = tempfile::tempdir().unwrap();
    // Two updates in four steps, after 100 of warm-up: 2,500 are made at step 5,100.
    let config = TrainerConfig { total_steps: 5_400, ..config(0) };
    let config = TrainerConfig { checkpoint_every_steps: 100, ..config };
    let mut trainer = Trainer::start(folder.path(), &droq(), &config, inputs(), Some(&warm)).unwrap();
    let before = actions(&mut trainer.policy());
    let (temperature, critic) = (trainer.droq.temperature(), critic(&mut trainer));
    let mut watch = Watch { stop_at: Some(5_100 / 4), ..Watch::default() };
    trainer.run(&mut watch).unwrap();
    assert_eq!(trainer.droq.updates(), 2_500);
    assert_eq!((actions(&mut trainer.policy()), trainer.droq.temperature()), (before.clone(), temperature));
    assert_ne!(self::critic(&mut trainer), critic);
    drop(trainer);
    // The wait is part of the checkpoint.
    let mut trainer = Trainer::resume(folder.path(), &droq(), &config, inputs()).unwrap();
    let outcome = trainer.run(&mut ()).unwrap();
    assert_ne!(actions(&mut trainer.policy()), before);
    assert!(outcome.best.unwrap().scores[0].value > 0.9);
}

fn critic(trainer: &mut Trainer) -> Vec<f32> {
    let tensors = trainer.droq.tensors();
    tensors.iter().find(|tensor| tensor.name.starts_with("critic0.parameters")).unwrap().values.to_vec()
}

#[test]
fn stopping_and_resuming_changes_nothing() {
    let source = source();
    for warm in [
        WarmStart::from_run(source.path()).unwrap(),
        WarmStart::from_policy(&source.path().join("policy-last.safetensors")).unwrap(),
    ] {
        let (whole, halves) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let start =
            |folder: &Path| Trainer::start(folder, &droq(), &config(1_600), inputs(), Some(&warm)).unwrap();
        start(whole.path()).run(&mut ()).unwrap();
        // Before the first step, within the warm-up, at a checkpoint; the last one leaves the same
        // segments of replay.
        drop(start(halves.path()));
        for stop_at in [0, 200] {
            let mut watch = Watch { stop_at: Some(stop_at), ..Watch::default() };
            let mut trainer = Trainer::resume(halves.path(), &droq(), &config(1_600), inputs()).unwrap();
            trainer.run(&mut watch).unwrap();
        }
        // The source is not needed any more, whatever becomes of it.
        Trainer::resume(halves.path(), &droq(), &config(1_600), inputs()).unwrap().run(&mut ()).unwrap();
        assert_same_files(whole.path(), halves.path());
        let rows = files(whole.path()).remove("metrics.jsonl").unwrap();
        assert!(String::from_utf8(rows).unwrap().lines().next().unwrap().contains("eval/closeness"));
    }
}

#[test]
fn what_does_not_fit_is_refused_and_nothing_is_written() {
    let source = source();
    let warm = WarmStart::from_run(source.path()).unwrap();
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("run");
    let refused = |droq: &DroqConfig, inputs: TrainingInputs, words: &[&str]| {
        let said = Trainer::start(&folder, droq, &config(8), inputs, Some(&warm)).err().unwrap().to_string();
        assert!(words.iter().all(|word| said.contains(word)), "{said}");
        assert!(said.contains("use the same configuration, or start without them"), "{said}");
        assert!(!folder.exists(), "{said}");
    };
    let wider = DroqConfig { hidden: vec![32, 48], ..droq() };
    refused(&wider, inputs(), &["[32, 32]", "[32, 48]", "droq.hidden"]);
    let other = TrainingInputs { environment: Box::new(Wider(Tracking::new(4))), ..inputs() };
    refused(&droq(), other, &["1 real and 4 binary", "1 real and 5 binary"]);

    // Damaged sources.
    assert!(WarmStart::from_run(parent.path()).is_err());
    assert!(WarmStart::from_policy(&source.path().join("checkpoints/last.safetensors")).is_err());
    let path = source.path().join("checkpoints/last.safetensors");
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() - 9]).unwrap();
    let said = WarmStart::from_run(source.path()).err().unwrap().to_string();
    assert!(said.contains("last.safetensors cannot be used"), "{said}");
}

/// A toy that shows a column more.
struct Wider(Tracking);

impl VectorEnvironment for Wider {
    fn num_envs(&self) -> usize {
        self.0.num_envs()
    }
    fn layout(&self) -> ObservationLayout {
        ObservationLayout { binary: self.0.layout().binary + 1, ..self.0.layout() }
    }
    fn action_len(&self) -> usize {
        self.0.action_len()
    }
    fn reward_term_names(&self) -> Vec<String> {
        self.0.reward_term_names()
    }
    fn reset(&mut self, _: &mut [f32]) {}
    fn step(&mut self, _: &[f32], _: &mut StepBatch) {}
    fn save_state(&self) -> Vec<u8> {
        self.0.save_state()
    }
    fn load_state(&mut self, state: &[u8]) -> Result<(), crate::env::EnvironmentError> {
        self.0.load_state(state)
    }
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig::with_cases(64))]
    #[test]
    fn hostile_sources_never_panic(at in proptest::prelude::any::<proptest::sample::Index>(), value: u8, policy: bool) {
        thread_local! {
            static RUN: tempfile::TempDir = {
                let folder = tempfile::tempdir().unwrap();
                Trainer::start(folder.path(), &droq(), &config(8), inputs(), None).unwrap();
                folder
            };
        }
        RUN.with(|folder| {
            let name = if policy { "policy-last.safetensors" } else { "checkpoints/last.safetensors" };
            let path = folder.path().join(name);
            let whole = fs::read(&path).unwrap();
            let mut bytes = whole.clone();
            bytes[at.index(whole.len())] = value;
            fs::write(&path, bytes).unwrap();
            let source = WarmStart::from_run(folder.path());
            fs::write(&path, whole).unwrap();
            match source.map(|source| source.check(&droq(), &Tracking::new(4))) {
                // The byte still makes sense there.
                Ok(Ok(())) => {}
                Ok(Err(error)) => assert!(matches!(error, TrainError::Refused(_)), "{error:?}"),
                Err(error) => assert!(matches!(error, FileError::Content { .. }), "{error:?}"),
            }
        });
    }
}
