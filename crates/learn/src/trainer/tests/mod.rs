mod toy;
mod warm_start;

use std::{fs, path::Path};

use super::*;
use crate::{files::encode_tensors, random::Stream};
use toy::{Grid, Tracking, Watch, assert_same_files, config, droq, files, inputs, raw};

#[test]
fn the_toy_is_solved() {
    let folder = tempfile::tempdir().unwrap();
    let mut watch = Watch::default();
    let mut trainer = Trainer::start(folder.path(), &droq(), &config(6_000), inputs(), None).unwrap();
    let outcome = trainer.run(&mut watch).unwrap();
    let best = outcome.best.unwrap();
    assert!(best.scores[0].value > 0.95, "{best:?}");
    assert_eq!((outcome.step, outcome.stopped, outcome.updates), (6_000, None, 2 * (6_000 - 100) / 4));
    assert_eq!((watch.logs.len(), watch.evaluations.len()), (40, 15));
    let (first, last) = (&watch.logs[0], &watch.logs[39]);
    let get = |row: &LogRow, name: &str| row.values.iter().find(|(key, _)| key == name).unwrap().1;
    assert!(get(last, "charts/reward_per_step") > get(first, "charts/reward_per_step") + 0.1);
    assert_eq!(get(last, "reward/bonus"), 1.0);
    assert_eq!(get(last, "charts/episodic_length"), 10.0);
    for name in
        ["losses/critic", "losses/actor", "charts/entropy", "charts/temperature", "perf/steps_per_sec"]
    {
        assert!(get(last, name).is_finite(), "{name}");
    }
    let mut policy = Policy::load(&folder.path().join("policy-best.safetensors")).unwrap();
    assert_eq!(policy.header().notes["training"]["toy"], 1);
    let score = Grid.evaluate(&mut |observations, actions| policy.act(observations, actions))[0].value;
    assert_eq!(score, best.scores[0].value);
}

#[test]
fn the_score_that_the_configuration_names_decides_which_policy_is_the_best() {
    let run = |best_by: &str| {
        let folder = tempfile::tempdir().unwrap();
        let config = TrainerConfig { best_by: best_by.to_string(), ..config(4_000) };
        let mut watch = Watch::default();
        let outcome =
            Trainer::start(folder.path(), &droq(), &config, inputs(), None).unwrap().run(&mut watch);
        outcome.map(|outcome| (outcome.best.unwrap(), watch.evaluations))
    };
    let value = |scores: &[Score], name: &str| scores.iter().find(|score| score.name == name).unwrap().value;
    for best_by in ["closeness", "distance"] {
        let (best, evaluations) = run(best_by).unwrap();
        let highest = evaluations.iter().map(|row| value(&row.scores, best_by)).fold(f64::MIN, f64::max);
        assert_eq!(value(&best.scores, best_by), highest, "{best_by}");
    }
    let refused = run("f2").err().unwrap().to_string();
    assert!(refused.contains("`f2` (trainer.best_by)") && refused.contains("closeness"), "{refused}");
}

/// A learner whose batch is two shards.
fn two_shards() -> DroqConfig {
    DroqConfig { batch: 200, ..droq() }
}

fn start_or_resume(folder: &Path, droq: &DroqConfig, config: &TrainerConfig) -> Trainer {
    let made = match Trainer::exists(folder) {
        true => Trainer::resume(folder, droq, config, inputs()),
        false => Trainer::start(folder, droq, config, inputs(), None),
    };
    made.unwrap()
}

/// Continues a training for a hundred vector steps, which end in a checkpoint.
fn hundred_steps(trainer: Result<Trainer, TrainError>) -> Trainer {
    let mut trainer = trainer.unwrap();
    trainer.run(&mut Watch { stop_at: Some(100), ..Watch::default() }).unwrap();
    trainer
}

#[test]
fn stopping_and_resuming_changes_nothing() {
    let (whole, halves) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    Trainer::start(whole.path(), &two_shards(), &config(1_600), inputs(), None)
        .unwrap()
        .run(&mut ())
        .unwrap();
    // Stops at a checkpoint: 200 vector steps of 4 environments.
    let mut watch = Watch { stop_at: Some(200), ..Watch::default() };
    let mut first = Trainer::start(halves.path(), &two_shards(), &config(1_600), inputs(), None).unwrap();
    assert_eq!(first.run(&mut watch).unwrap().stopped, Some(StopReason::Requested));
    drop(first);
    let mut second = Trainer::resume(halves.path(), &two_shards(), &config(1_600), inputs()).unwrap();
    assert_eq!(second.step(), 800);
    second.run(&mut ()).unwrap();
    assert_same_files(whole.path(), halves.path());
}

#[test]
fn rewards_of_the_next_episode_do_not_count() {
    let folder = tempfile::tempdir().unwrap();
    let mut trainer = Trainer::start(folder.path(), &droq(), &config(400), inputs(), None).unwrap();
    trainer.run(&mut ()).unwrap();
    // Episodes have ten steps: a tenth of the samples is that far from the end of one, for every
    // distance.
    let horizon = crate::replay::Horizon { steps: 10, discount: 0.5 };
    let (observation, action) =
        (trainer.collector.environment.layout(), trainer.collector.environment.action_len());
    let mut batch = crate::replay::Batch::new(observation, action, 2_000);
    trainer.replay.sample(&mut Stream::new(1, "test"), 2_000, horizon, &mut batch);
    for steps in 1..=10 {
        let share = batch.discount.iter().filter(|&&discount| discount == 0.5f32.powi(steps)).count();
        assert!((130..270).contains(&share), "{share} of 2000 samples look {steps} steps ahead");
    }
}

#[test]
fn stopping_between_checkpoints_changes_no_number() {
    let (whole, halves) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    Trainer::start(whole.path(), &droq(), &config(1_200), inputs(), None).unwrap().run(&mut ()).unwrap();
    for stop_at in [37, 50, 100] {
        let mut watch = Watch { stop_at: Some(stop_at), ..Watch::default() };
        start_or_resume(halves.path(), &droq(), &config(1_200)).run(&mut watch).unwrap();
    }
    Trainer::resume(halves.path(), &droq(), &config(1_200), inputs()).unwrap().run(&mut ()).unwrap();
    let (whole, halves) = (files(whole.path()), files(halves.path()));
    // The replay is cut into other segments, and the checkpoint names those; all else is alike.
    for name in ["metrics.jsonl", "policy-best.safetensors", "policy-last.safetensors"] {
        assert!(whole[name] == halves[name], "{name} differs");
    }
}

#[test]
fn threads_and_overlap_change_nothing() {
    let reference = tempfile::tempdir().unwrap();
    Trainer::start(reference.path(), &two_shards(), &config(800), inputs(), None)
        .unwrap()
        .run(&mut ())
        .unwrap();
    for (threads, overlap) in [(1, true), (1, false), (2, false), (4, true)] {
        let folder = tempfile::tempdir().unwrap();
        let config = TrainerConfig { threads, overlap, ..config(800) };
        Trainer::start(folder.path(), &two_shards(), &config, inputs(), None).unwrap().run(&mut ()).unwrap();
        assert_same_files(reference.path(), folder.path());
    }
}

#[test]
fn other_files_among_the_replay_segments_are_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let replay = folder.path().join("checkpoints/replay");
    fs::create_dir_all(replay.join("cannot-be-removed.replay/as-a-file")).unwrap();
    fs::write(replay.join("notes.txt"), "mine").unwrap();
    let small = DroqConfig { replay_capacity: 300, ..droq() };
    Trainer::start(folder.path(), &small, &config(1_200), inputs(), None).unwrap().run(&mut ()).unwrap();
    assert_eq!(fs::read(replay.join("notes.txt")).unwrap(), b"mine");
    assert!(Trainer::resume(folder.path(), &small, &config(1_600), inputs()).is_ok());
}

#[test]
fn a_better_policy_from_after_the_checkpoint_is_not_lost() {
    let folder = tempfile::tempdir().unwrap();
    let trainer = hundred_steps(Trainer::start(folder.path(), &droq(), &config(1_200), inputs(), None));
    // As an evaluation leaves it that is killed before the next checkpoint.
    let mut policy = trainer.policy();
    drop(trainer);
    policy.set_notes(
        serde_json::json!({ "step": 444, "scores": { Grid.evaluate(&mut |_, _| ())[0].name.clone(): 9.0 } }),
    );
    policy.save(&folder.path().join(evaluation::BEST_POLICY)).unwrap();
    let better = fs::read(folder.path().join(evaluation::BEST_POLICY)).unwrap();
    Trainer::resume(folder.path(), &droq(), &config(1_200), inputs()).unwrap().run(&mut ()).unwrap();
    assert!(fs::read(folder.path().join("policy-best-444.safetensors")).unwrap() == better);
    assert!(Policy::load(&folder.path().join(evaluation::BEST_POLICY)).is_ok());
}

#[test]
fn a_replay_beyond_the_address_space_does_not_fit() {
    let layout = inputs().environment.layout();
    assert!(crate::replay::Replay::fits(layout, 1, 1_000));
    assert!(!crate::replay::Replay::fits(layout, 1, 1 << 50));
}

#[test]
fn a_kill_at_any_write_leaves_a_checkpoint_that_resumes() {
    // Rebuilds every state that the folder can be in between two checkpoints, from copies of both.
    let small = DroqConfig { replay_capacity: 300, ..droq() };
    let folder = tempfile::tempdir().unwrap();
    hundred_steps(Trainer::start(folder.path(), &small, &config(1_200), inputs(), None));
    let before = raw(folder.path());
    hundred_steps(Trainer::resume(folder.path(), &small, &config(1_200), inputs()));
    let after = raw(folder.path());
    let finished = tempfile::tempdir().unwrap();
    Trainer::start(finished.path(), &small, &config(1_200), inputs(), None).unwrap().run(&mut ()).unwrap();

    let new: Vec<_> = after.keys().filter(|name| !before.contains_key(*name)).collect();
    let gone: Vec<_> = before.keys().filter(|name| !after.contains_key(*name)).collect();
    assert!(new.iter().any(|name| name.ends_with(".replay")) && !gone.is_empty(), "{new:?} {gone:?}");
    for stage in 0..4 {
        let killed = tempfile::tempdir().unwrap();
        fs::create_dir_all(killed.path().join("checkpoints/replay")).unwrap();
        let write = |name: &str, bytes: &[u8]| fs::write(killed.path().join(name), bytes).unwrap();
        for (name, bytes) in &before {
            write(name, bytes);
        }
        for name in ["metrics.jsonl", "events.out.tfevents.etude", "policy-best.safetensors"] {
            write(name, &after[name]);
        }
        write("checkpoints/replay/.0-1.replay.Xh3kQ9", b"half");
        if stage >= 1 {
            new.iter().for_each(|name| write(name, &after[*name]));
        }
        if stage >= 2 {
            write("checkpoints/last.safetensors", &after["checkpoints/last.safetensors"]);
        }
        if stage >= 3 {
            gone.iter().for_each(|name| fs::remove_file(killed.path().join(name)).unwrap());
        }
        let mut trainer = Trainer::resume(killed.path(), &small, &config(1_200), inputs()).unwrap();
        assert_eq!(trainer.step(), if stage >= 2 { 800 } else { 400 });
        trainer.run(&mut ()).unwrap();
        for name in ["policy-best.safetensors", "policy-last.safetensors"] {
            assert!(
                fs::read(killed.path().join(name)).unwrap() == raw(finished.path())[name],
                "{name}, {stage}"
            );
        }
    }
}

/// Not a test by itself: the process that the next test kills.
#[test]
fn a_training_to_be_killed() {
    let Some(folder) = std::env::var_os("ETUDE_LEARN_CHILD") else { return };
    let folder = Path::new(&folder);
    let config = TrainerConfig { checkpoint_every_steps: 100, ..config(4_000) };
    start_or_resume(folder, &droq(), &config).run(&mut ()).unwrap();
}

#[test]
fn killed_again_and_again_it_still_arrives_at_the_same_policy() {
    let (whole, killed) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let child = |folder: &Path| {
        std::process::Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "trainer::tests::a_training_to_be_killed"])
            .env("ETUDE_LEARN_CHILD", folder)
            .stdout(std::process::Stdio::null())
            .spawn()
            .unwrap()
    };
    assert!(child(whole.path()).wait().unwrap().success());
    let mut stream = Stream::new(9, "kills");
    let mut kills = 0;
    loop {
        let mut child = child(killed.path());
        // The waits grow, so that the training gets to its end on a machine of any speed.
        std::thread::sleep(std::time::Duration::from_millis(30 + stream.below(60 + 20 * kills) as u64));
        match child.try_wait().unwrap() {
            Some(status) => {
                assert!(status.success());
                break;
            }
            None => {
                child.kill().unwrap();
                child.wait().unwrap();
                kills += 1;
            }
        }
    }
    assert!(kills > 0, "the training was too quick to be killed");
    let (whole, killed) = (files(whole.path()), files(killed.path()));
    for name in ["metrics.jsonl", "policy-best.safetensors", "policy-last.safetensors"] {
        assert!(whole[name] == killed[name], "{name} differs after {kills} kills");
    }
}

#[test]
fn numbers_that_are_not_finite_stop_the_training_and_spare_the_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let mut environment = Tracking::new(4);
    environment.poison_at = Some(150);
    let poisoned = TrainingInputs { environment: Box::new(environment), ..inputs() };
    let mut trainer = Trainer::start(folder.path(), &droq(), &config(1_200), poisoned, None).unwrap();
    let error = trainer.run(&mut ()).unwrap_err();
    assert!(error.to_string().contains("not a finite number"), "{error}");
    assert_eq!(Trainer::resume(folder.path(), &droq(), &config(1_200), inputs()).unwrap().step(), 400);

    let folder = tempfile::tempdir().unwrap();
    // No policy has so high an entropy: the temperature grows e-fold with each update, on any
    // processor.
    let wild = DroqConfig { target_entropy_per_action: 100.0, temperature_learning_rate: 1.0, ..droq() };
    let result = Trainer::start(folder.path(), &wild, &config(100_000), inputs(), None).unwrap().run(&mut ());
    assert!(matches!(result, Err(TrainError::NotFinite { .. })), "{result:?}");
    assert!(Trainer::resume(folder.path(), &wild, &config(100_000), inputs()).is_ok());
}

#[test]
fn a_failed_write_stops_the_training_and_spares_the_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    hundred_steps(Trainer::start(folder.path(), &droq(), &config(1_200), inputs(), None));
    let path = folder.path().join("checkpoints/last.safetensors");
    let before = fs::read(&path).unwrap();
    let replay = folder.path().join("checkpoints/replay");
    let mut trainer = Trainer::resume(folder.path(), &droq(), &config(1_200), inputs()).unwrap();
    // No new segment of the replay can be written.
    fs::rename(&replay, folder.path().join("away")).unwrap();
    let error = trainer.run(&mut ()).unwrap_err();
    assert!(matches!(error, TrainError::File(_)), "{error}");
    assert!(error.to_string().contains("cannot write") && error.to_string().contains(".replay"), "{error}");
    fs::rename(folder.path().join("away"), &replay).unwrap();
    assert_eq!(fs::read(&path).unwrap(), before);
    assert_eq!(Trainer::resume(folder.path(), &droq(), &config(1_200), inputs()).unwrap().step(), 400);
}

#[test]
fn wrong_starts_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let resume = |droq: &DroqConfig, config: &TrainerConfig| match Trainer::resume(
        folder.path(),
        droq,
        config,
        inputs(),
    ) {
        Ok(_) => String::new(),
        Err(error) => error.to_string(),
    };
    assert!(resume(&droq(), &config(800)).contains("start a training there first"));
    let start = |config: &TrainerConfig| {
        Trainer::start(folder.path(), &droq(), config, inputs(), None).err().map(|e| e.to_string())
    };
    assert!(start(&TrainerConfig { num_envs: 5, ..config(8) }).unwrap().contains("trainer.num_envs"));
    assert_eq!(start(&config(8)), None);
    assert!(start(&config(8)).unwrap().contains("holds a training already"));
    assert!(resume(&DroqConfig { discount: 0.9, ..droq() }, &config(800)).contains("droq"));
    assert!(resume(&droq(), &TrainerConfig { seed: 6, ..config(800) }).contains("trainer.seed = 5, not 6"));
    assert_eq!(resume(&droq(), &TrainerConfig { threads: 1, ..config(900) }), "");
    let path = folder.path().join("checkpoints/last.safetensors");
    let other = encode_tensors(&serde_json::json!({ "schema": "etude-checkpoint-1" }), &[]).unwrap();
    fs::write(&path, other).unwrap();
    assert!(resume(&droq(), &config(800)).contains("its schema is `etude-checkpoint-1`"));
    fs::write(folder.path().join("checkpoints/last.safetensors"), b"not a checkpoint").unwrap();
    assert!(resume(&droq(), &config(800)).contains("not a safetensors file"));
    // Its results are not overwritten because the checkpoint is gone.
    fs::remove_dir_all(folder.path().join("checkpoints")).unwrap();
    let before = files(folder.path());
    assert!(start(&config(8)).unwrap().contains("without its checkpoint"));
    assert!(files(folder.path()) == before);
}

#[test]
fn a_checkpoint_that_is_refused_leaves_the_rows_after_it() {
    let folder = tempfile::tempdir().unwrap();
    hundred_steps(Trainer::start(folder.path(), &droq(), &config(1_200), inputs(), None));
    let last = folder.path().join("checkpoints/last.safetensors");
    let checkpoint = fs::read(&last).unwrap();
    let segment =
        fs::read_dir(folder.path().join("checkpoints/replay")).unwrap().next().unwrap().unwrap().path();
    hundred_steps(Trainer::resume(folder.path(), &droq(), &config(1_200), inputs()));
    // As after a kill before the second checkpoint, on a disk that has lost some of the replay.
    fs::write(&last, checkpoint).unwrap();
    let whole = fs::read(&segment).unwrap();
    fs::write(&segment, &whole[..whole.len() / 2]).unwrap();
    let before = raw(folder.path());
    let error = Trainer::resume(folder.path(), &droq(), &config(1_200), inputs()).err().unwrap();
    assert!(error.to_string().contains(".replay"), "{error}");
    assert!(raw(folder.path()) == before);
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig::with_cases(64))]
    #[test]
    fn hostile_checkpoints_never_panic(at in proptest::prelude::any::<proptest::sample::Index>(), value: u8, in_header: bool) {
        thread_local! {
            static RUN: tempfile::TempDir = {
                let folder = tempfile::tempdir().unwrap();
                Trainer::start(folder.path(), &droq(), &config(8), inputs(), None).unwrap();
                folder
            };
        }
        RUN.with(|folder| {
            let path = folder.path().join("checkpoints/last.safetensors");
            let whole = fs::read(&path).unwrap();
            let header = u64::from_le_bytes(whole[..8].try_into().unwrap()) as usize + 8;
            let mut bytes = whole.clone();
            bytes[at.index(if in_header { header } else { whole.len() })] = value;
            fs::write(&path, bytes).unwrap();
            let error = Trainer::resume(folder.path(), &droq(), &config(8), inputs()).err();
            fs::write(&path, whole).unwrap();
            // Accepted, because the byte still makes sense there; or refused with a reason.
            if let Some(error) = error {
                let kinds = "File, Refused or Environment";
                let expected = matches!(
                    error,
                    TrainError::File(_) | TrainError::Refused(_) | TrainError::Environment(_)
                );
                assert!(expected, "{error:?} is not {kinds}");
                assert!(!error.to_string().is_empty());
            }
        });
    }
}
