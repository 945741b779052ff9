//! Tests of plans.

use super::*;

pub(crate) fn plan(text: &str, config: &ExperimentConfig) -> Vec<Trial> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.toml");
    std::fs::write(&path, text).unwrap();
    Experiment::load(path.to_str().unwrap()).unwrap().plan(config).unwrap()
}

pub(crate) const MINE: &str = r#"
title = "T"
source = "S"
songs = ["twinkle", "c-major-scale"]
seeds = 2
[[variants]]
name = "fences"
[[variants]]
name = "none"
set = ["task.stage.fences=false"]
[grid]
"task.randomisation.intensity" = [0.0, 0.5, 1.0]
[perform]
modes = ["real"]
runs = 3
"#;

#[test]
fn a_plan_is_the_product_of_songs_variants_grid_and_seeds() {
    let trials = plan(MINE, &ExperimentConfig::default());
    assert_eq!(trials.len(), 2 * 2 * 3 * 2);
    let ids: BTreeSet<&str> = trials.iter().map(|trial| trial.id.as_str()).collect();
    assert_eq!(ids.len(), trials.len());
    let labels = &trials[1].labels;
    assert_eq!(labels["song"], "twinkle");
    assert_eq!(labels["variant"], "fences");
    assert_eq!(labels["intensity"], "0.5");
    assert_eq!(plan(MINE, &ExperimentConfig { seeds: Some(1), ..ExperimentConfig::default() }).len(), 12);
}

#[test]
fn a_corpus_is_learned_once_a_seed() {
    let mine = "title = 'T'\nsource = 'S'\npreset = 'sight-reader'\nseeds = 2\n";
    let trials = plan(mine, &ExperimentConfig::default());
    assert_eq!(trials.len(), 2);
    for (seed, trial) in trials.iter().enumerate() {
        let TrialWork::Train { training, perform: None, .. } = &trial.work else { panic!("{trial:?}") };
        assert_eq!(training.song, None);
        assert_eq!(training.resolve().unwrap().trainer.seed, seed as u64);
        assert!(trial.id.starts_with(&format!("train__corpus__{seed}__")), "{}", trial.id);
    }
    let refused = |text: String| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mine.toml");
        std::fs::write(&path, text).unwrap();
        let experiment = Experiment::load(path.to_str().unwrap()).unwrap();
        experiment.plan(&ExperimentConfig::default()).unwrap_err().to_string()
    };
    // With songs the preset trains on each of them.
    let songs = plan(&format!("{mine}songs = ['twinkle', 'ode-to-joy']\n"), &ExperimentConfig::default());
    assert_eq!(songs.len(), 4);
    assert!(refused(format!("{mine}[perform]\nmodes = ['real']\nruns = 1\n")).contains("`players`"));
    assert!(refused(mine.replace("sight-reader", "fast")).contains("name at least one song"));
}

#[test]
fn another_corpus_is_another_trial() {
    let folder = tempfile::tempdir().unwrap();
    let set = format!("set = ['corpus.folder={}']", folder.path().display());
    let mine = format!("title = 'T'\nsource = 'S'\npreset = 'sight-reader'\nseeds = 1\n{set}\n");
    let id = |seed: u64| {
        etude_music::melody(seed).save(folder.path().join("one.mid")).unwrap();
        plan(&mine, &ExperimentConfig::default())[0].id.clone()
    };
    let [first, second, again] = [1, 2, 1].map(id);
    assert!(first != second && first == again);
}

#[test]
fn ids_are_those_of_the_work_whoever_asks_for_it() {
    let trials = plan(MINE, &ExperimentConfig::default());
    assert_eq!(plan(MINE, &ExperimentConfig::default()), trials);
    // Said in other words, it is the same work.
    let other = MINE
        .replace("name = \"none\"", "name = \"without\"")
        .replace("seeds = 2", "seeds = 2\nset = [\"task.stage.fences=true\"]");
    let others = plan(&other, &ExperimentConfig::default());
    let ids = |trials: &[Trial]| trials.iter().map(|trial| trial.id.clone()).collect::<Vec<_>>();
    assert_eq!(ids(&others), ids(&trials));
    let threads =
        ExperimentConfig { set: vec!["trainer.threads=1".to_string()], ..ExperimentConfig::default() };
    assert_eq!(ids(&plan(MINE, &threads)), ids(&trials));
    let steps =
        ExperimentConfig { set: vec!["trainer.total_steps=1000".to_string()], ..ExperimentConfig::default() };
    assert!(ids(&plan(MINE, &steps)).iter().all(|id| !ids(&trials).contains(id)));
}

#[test]
fn a_smoke_test_does_everything_once() {
    let trials = plan(MINE, &ExperimentConfig { smoke: true, ..ExperimentConfig::default() });
    assert_eq!(trials.len(), 2 * 2);
    let TrialWork::Train { training, perform, .. } = &trials[0].work else { panic!("{trials:?}") };
    assert_eq!(training.resolve().unwrap().trainer.total_steps, 480);
    assert_eq!(perform.as_ref().unwrap().runs, 1);
}

#[test]
fn other_twin_parameters_under_the_same_name_are_another_trial() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("standard.toml");
    let text = include_str!("../../../../configs/twin-params/standard.toml");
    let experiment = Experiment::load("identification").unwrap();
    let fingerprint_of = |text: &str| {
        std::fs::write(&file, text).unwrap();
        experiment.fingerprint_of_twin(file.to_str().unwrap()).unwrap()
    };
    let built_in = experiment.fingerprint_of_twin("standard").unwrap();
    assert_eq!(fingerprint_of(text), built_in, "the content counts, not where it is stored");
    let edited = format!("{text}\n[[faults]]\nkind = \"arm-silent\"\nat_secs = 30.0\n");
    assert_ne!(fingerprint_of(&edited), built_in);
}

#[test]
fn twin_parameters_are_part_of_the_work_and_each_set_has_its_rehearsal() {
    let config = ExperimentConfig::default();
    let ids = |trials: &[Trial]| trials.iter().map(|trial| trial.id.clone()).collect::<BTreeSet<_>>();
    let [one, both] =
        ["", "twin_params = ['standard', 'worn']"].map(|line| plan(&format!("{MINE}{line}\n"), &config));
    assert_eq!(one.len(), both.len(), "a policy is trained once and plays on each");
    assert!(ids(&one).is_disjoint(&ids(&both)));
    let rehearse =
        MINE.replace("[perform]", "[rehearse]\niterations = 1\ntwin_params = ['standard', 'worn']");
    let rehearsals = plan(&rehearse, &config);
    assert_eq!(rehearsals.len(), one.len(), "a policy is trained once and rehearsed on each");
    for trial in &rehearsals {
        let TrialWork::Train { perform: None, rehearse: Some(rehearse), .. } = &trial.work else {
            panic!("{trial:?}")
        };
        assert_eq!(rehearse.twin_params, ["standard", "worn"]);
    }
    let other_fit = plan(&rehearse.replace("iterations = 1", "iterations = 1\nfits = ['bo']"), &config);
    assert!(ids(&rehearsals).is_disjoint(&ids(&other_fit)));
    // A variant may be played on other twins, or be trained alone.
    let alone = plan(&rehearse.replace("name = \"none\"", "name = \"none\"\ntwin_params = []"), &config);
    let twins = |trial: &Trial| match &trial.work {
        TrialWork::Train { rehearse, .. } => rehearse.as_ref().map_or(0, |on| on.twin_params.len()),
        _ => panic!("{trial:?}"),
    };
    for (trial, before) in alone.iter().zip(&rehearsals) {
        assert_eq!(twins(trial), if trial.labels["variant"] == "none" { 0 } else { 2 });
        assert_eq!(trial.id == before.id, trial.labels["variant"] != "none");
    }
}

#[test]
fn every_experiment_that_comes_with_us_can_be_planned() {
    for name in crate::config::names() {
        for smoke in [false, true] {
            let config = ExperimentConfig { smoke, ..ExperimentConfig::default() };
            assert!(!Experiment::load(name).unwrap().plan(&config).unwrap().is_empty(), "{name}");
        }
    }
}
